"""The simulated sound card."""

from .sound_card import Card, Jack

__all__ = ["Card", "Jack"]
