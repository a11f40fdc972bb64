"""Simulated function generators: twins and wires."""
