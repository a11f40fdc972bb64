"""Simulated function generators: twins and wires."""

from haploop.mocks.generator.box import Box
from haploop.mocks.generator.products import DG1000Z, KEYSIGHT_33500, Product

__all__ = ["DG1000Z", "KEYSIGHT_33500", "Box", "Product"]
