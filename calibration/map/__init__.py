"""Vibration maps: responses over the table's grid."""

from haploop.calibration.map.folder import MapFolder
from haploop.calibration.map.map import ALL, VibrationMap
from haploop.calibration.map.measuring import map_plan, measure_map

__all__ = ["ALL", "MapFolder", "VibrationMap", "map_plan", "measure_map"]
