"""Keeping a calibration true: history, drift, sensor health, recalibration."""

from .adoption import activate as activate
from .adoption import adopt as adopt
from .adoption import buttons_of as buttons_of
from .adoption import calibrations_of as calibrations_of
from .drift import PlaceMetrics as PlaceMetrics
from .history import Generation as Generation
from .history import History as History
from .outcome import Outcome as Outcome
from .outcome import note_unopened as note_unopened
from .recalibration import recalibrate as recalibrate
