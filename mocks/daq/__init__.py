"""Simulated DAQ cards: the twin, and NI's device server as the wire."""
