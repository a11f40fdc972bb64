"""Amplifiers: the role, and its drivers."""

from .role import Amplifier, ReadOnce

__all__ = ["Amplifier", "ReadOnce"]
