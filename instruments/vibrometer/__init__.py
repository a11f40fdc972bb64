"""Laser vibrometers: the role, and its drivers."""

from .role import Vibrometer

__all__ = ["Vibrometer"]
