"""Keeping a calibration true: history, drift, sensor health, recalibration."""

from .drift import PlaceMetrics as PlaceMetrics
from .history import Generation as Generation
from .history import History as History
from .recalibration import Outcome as Outcome
from .recalibration import activate as activate
from .recalibration import adopt as adopt
from .recalibration import buttons_of as buttons_of
from .recalibration import calibrations_of as calibrations_of
from .recalibration import recalibrate as recalibrate
