"""Simulated vibrometers: twins and wires."""

from .ofv5000 import Controller
from .pdv100 import pdv100

__all__ = ["Controller", "pdv100"]
