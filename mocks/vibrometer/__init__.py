"""Simulated vibrometers: twins and wires."""

from haploop.mocks.vibrometer.ofv5000 import Controller
from haploop.mocks.vibrometer.pdv100 import pdv100

__all__ = ["Controller", "pdv100"]
