"""Amplifiers: the role, and its drivers."""

from .role import Amplifier

__all__ = ["Amplifier"]
