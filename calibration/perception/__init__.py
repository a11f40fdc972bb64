"""Perception: thresholds of vibrotactile detection by act, levels above them, and what people feel."""

from .feeling import Answer as Answer
from .feeling import Feeling as Feeling
from .feeling import Pressed as Pressed
from .feeling import Sensation as Sensation
from .feeling import feeling_of as feeling_of
from .feeling import sensations_of as sensations_of
from .feeling import shares as shares
from .levels import SHORT as SHORT
from .levels import Levels as Levels
from .levels import event_levels as event_levels
from .levels import levels_of as levels_of
from .levels import pressing as pressing
from .levels import running_level as running_level
from .thresholds import Act as Act
from .thresholds import Curve as Curve
from .thresholds import Difference as Difference
from .thresholds import LabThreshold as LabThreshold
from .thresholds import Thresholds as Thresholds
from .thresholds import lab_threshold as lab_threshold
from .thresholds import parse_thresholds as parse_thresholds
from .thresholds import pressing_act as pressing_act
from .thresholds import thresholds as thresholds
