"""Relay boxes: the role, the logic common to all boards, and the drivers."""

from haploop.instruments.relay.board import BoardSettings, ChannelRelay, ChannelState
from haploop.instruments.relay.role import Relay

__all__ = ["BoardSettings", "ChannelRelay", "ChannelState", "Relay"]
