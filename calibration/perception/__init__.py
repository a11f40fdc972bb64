"""Perception: thresholds of vibrotactile detection by act, levels above them, and what people feel."""

from .feeling import Feeling as Feeling
from .feeling import Pressed as Pressed
from .feeling import feeling_of as feeling_of
from .feeling import sensations_of as sensations_of
from .lab import LabThreshold as LabThreshold
from .lab import lab_threshold as lab_threshold
from .lab import pressing_act as pressing_act
from .levels import SHORT as SHORT
from .levels import Levels as Levels
from .levels import event_levels as event_levels
from .levels import levels_of as levels_of
from .levels import pressing as pressing
from .levels import running_level as running_level
from .sensation import Answer as Answer
from .sensation import Sensation as Sensation
from .sensation import shares as shares
from .thresholds import Act as Act
from .thresholds import Curve as Curve
from .thresholds import Difference as Difference
from .thresholds import Thresholds as Thresholds
from .thresholds import parse_thresholds as parse_thresholds
from .thresholds import thresholds as thresholds
