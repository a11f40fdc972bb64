"""Simulated relay boxes: plant part, twins and wires."""
