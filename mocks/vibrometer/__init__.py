"""Simulated vibrometers: twins and wires."""

from .analog import pdv100
from .ofv5000 import Controller

__all__ = ["Controller", "pdv100"]
