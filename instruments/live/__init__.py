"""Live views of the blocks streamed on a rig, in the same program or in another one."""

from .levels import Level, levels, quantities, signals
from .publisher import Publisher
from .tap import Feed, LiveBlock, Run, Tap
from .watching import watch_live

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
