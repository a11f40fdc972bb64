"""Simulated function generators: twins and wires."""

from haploop.mocks.generator.box import DG1000Z, KEYSIGHT_33500, Box, Product

__all__ = ["DG1000Z", "KEYSIGHT_33500", "Box", "Product"]
