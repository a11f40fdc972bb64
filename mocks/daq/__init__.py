"""Simulated DAQ cards: the twin, and NI's device server as the wire (in `ni`)."""

from .products import PRODUCTS, Product
from .twin import DaqTwin

__all__ = ["PRODUCTS", "DaqTwin", "Product"]
