"""Servers and lines on loopback that simulated instruments speak through."""
