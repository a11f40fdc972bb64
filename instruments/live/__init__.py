"""Live views of the blocks streamed on a rig, in the same program or in another one."""

from .publisher import Publisher as Publisher
from .tap import Feed as Feed
from .tap import Level as Level
from .tap import LiveBlock as LiveBlock
from .tap import Run as Run
from .tap import Tap as Tap
from .tap import levels as levels
from .tap import quantities as quantities
from .tap import signals as signals
from .watching import waiting_for as waiting_for
from .watching import watch_live as watch_live
