"""Vibration maps: responses over the table's grid."""

from .calibrated import with_map
from .folder import MapFolder
from .map import ALL, VibrationMap
from .measuring import map_plan, measure_map

__all__ = ["ALL", "MapFolder", "VibrationMap", "map_plan", "measure_map", "with_map"]
