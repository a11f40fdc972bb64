"""The simulated sound card."""

from haploop.mocks.player.sound_card import Card, Jack

__all__ = ["Card", "Jack"]
