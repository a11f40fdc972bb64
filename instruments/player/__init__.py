"""Audio outputs that play drives: the role, and its driver for sound cards."""

from .role import Player

__all__ = ["Player"]
