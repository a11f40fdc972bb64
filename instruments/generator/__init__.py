"""Function generators: the role, and its drivers."""

from .role import Generator, Sweep

__all__ = ["Generator", "Sweep"]
