"""Live views of the blocks streamed on a rig, in the same program or in another one."""

from haploop.instruments.live.levels import Level, levels, quantities, signals
from haploop.instruments.live.publisher import Publisher
from haploop.instruments.live.tap import Feed, LiveBlock, Run, Tap
from haploop.instruments.live.watching import watch_live

__all__ = [
    "Feed",
    "Level",
    "LiveBlock",
    "Publisher",
    "Run",
    "Tap",
    "levels",
    "quantities",
    "signals",
    "watch_live",
]
