"""Simulated DAQ cards: the twin, and NI's device server as the wire (in `ni`)."""

from haploop.mocks.daq.products import PRODUCTS, Product
from haploop.mocks.daq.twin import DaqTwin

__all__ = ["PRODUCTS", "DaqTwin", "Product"]
