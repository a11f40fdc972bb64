"""Simulated function generators: twins and wires."""

from .box import Box
from .headers import DG1000Z, KEYSIGHT_33500, Product

__all__ = ["DG1000Z", "KEYSIGHT_33500", "Box", "Product"]
