"""Relay boxes: the role, the logic common to all boards, and the drivers."""

from .board import BoardSettings, ChannelRelay, ChannelState
from .direct import LOST, DirectWire
from .role import Relay

__all__ = ["LOST", "BoardSettings", "ChannelRelay", "ChannelState", "DirectWire", "Relay"]
