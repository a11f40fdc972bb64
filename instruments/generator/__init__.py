"""Function generators: the role, and its drivers."""

from haploop.instruments.generator.role import Generator, Sweep

__all__ = ["Generator", "Sweep"]
