"""Relay boxes: the role, the logic common to all boards, and the drivers."""

from .board import BoardSettings, ChannelRelay, ChannelState
from .role import LOST, DirectWire, Relay

__all__ = ["LOST", "BoardSettings", "ChannelRelay", "ChannelState", "DirectWire", "Relay"]
