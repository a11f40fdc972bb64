"""Laser vibrometers: the role, and its drivers."""

from haploop.instruments.vibrometer.role import Vibrometer

__all__ = ["Vibrometer"]
