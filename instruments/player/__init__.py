"""Audio outputs that play drives: the role, and its driver for sound cards."""

from haploop.instruments.player.role import Player

__all__ = ["Player"]
