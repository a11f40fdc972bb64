"""Amplifiers: the role, and its drivers."""

from haploop.instruments.amplifier.role import Amplifier

__all__ = ["Amplifier"]
