"""Simulated vibrometers: twins and wires."""
