"""Frequency responses: excitation, estimators, hysteresis, exchange files."""

from .channels import Channels
from .excitation import (
    Excitation,
    LinearSweep,
    Multisine,
    linear_sweep,
    plan_excitation,
)
from .hysteresis import HALF_WIDTHS, Hysteresis, even_terms, operators
from .hysteresis_of_levels import fit_hysteresis
from .measuring import (
    QUICK,
    SWEEP,
    BothSigns,
    Play,
    Spot,
    distortion,
    excite,
    measure_above,
    measure_both_signs,
    measure_response,
    overloaded,
    plausible,
    prepare,
    quick_level,
    quick_response,
    response_from,
)
from .modes import Modes, Plays, fit_modes
from .response import Response
from .settling import RESOLVED, refuse_silent_drive, ringing_of, settle
from .terms import rows, terms_of
from .uff import read_uff, read_uff_sets, write_uff, write_uff_sets
from .waveforms import Waveforms

__all__ = [
    "HALF_WIDTHS",
    "QUICK",
    "RESOLVED",
    "SWEEP",
    "BothSigns",
    "Channels",
    "Excitation",
    "Hysteresis",
    "LinearSweep",
    "Modes",
    "Multisine",
    "Play",
    "Plays",
    "Response",
    "Spot",
    "Waveforms",
    "distortion",
    "even_terms",
    "excite",
    "fit_hysteresis",
    "fit_modes",
    "linear_sweep",
    "measure_above",
    "measure_both_signs",
    "measure_response",
    "operators",
    "overloaded",
    "plan_excitation",
    "plausible",
    "prepare",
    "quick_level",
    "quick_response",
    "read_uff",
    "read_uff_sets",
    "refuse_silent_drive",
    "response_from",
    "ringing_of",
    "rows",
    "settle",
    "terms_of",
    "write_uff",
    "write_uff_sets",
]
