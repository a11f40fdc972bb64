"""Simulated senders of LSL streams, on a clock of their own."""

from .twin import DRIFT, OFFSET

__all__ = ["DRIFT", "OFFSET"]
