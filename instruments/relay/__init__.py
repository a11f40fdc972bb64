"""Relay boxes: the role, the logic common to all boards, and the drivers."""

from .board import BoardSettings, ChannelRelay, ChannelState
from .role import Relay

__all__ = ["BoardSettings", "ChannelRelay", "ChannelState", "Relay"]
