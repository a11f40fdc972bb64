"""Wordings of all results: numbers as the reader of a table sees them, and the captions of figures."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence, Sized
from typing import TYPE_CHECKING, Any

from ...base.wording import capital, error_said

if TYPE_CHECKING:
    from ...calibration import Resonance


ANSWERS_SIMULATED = "Simulated participants answered: no person did."


SENSORS: Mapping[str, str] = {
    "acceleration": "accelerometer",
    "velocity": "velocity sensor",
    "displacement": "displacement sensor",
}


def derived(motion: str) -> str:
    """Says of an acceleration what it is from; "" where it was measured."""
    return "" if motion == "acceleration" else f", differentiated from the {motion}"


def told_by(quantity: str) -> str:
    """Says what told the activation of presses."""
    if quantity == "activation":
        return "by the contact"
    if quantity == "stated":
        return "as stated: no contact was read"
    what = "snap in the force" if quantity == "force" else f"click in the {quantity}"
    return f"taken from the {what}: no contact was recorded"


def percent(value: float | None, digits: int = 1) -> str:
    """A fraction as a percentage; "-" for None and NaN."""
    return "-" if value is None or not math.isfinite(value) else f"{100 * value:.{digits}f} %"


_UNIT = r"(?:%|dB|Hz|kHz|kS/s|V|N|m/s²|m/s|mm/s|µm/s|µm|mm|ms|s|g|kg|A)"
_SPACED = re.compile(rf"(?<=\d) (?={_UNIT}(?![\w/]))")
_DATE = re.compile(r"\d{4}-\d\d-\d\d(?: \d\d:\d\d)?")
_WHOLE = str.maketrans({"-": "\N{NON-BREAKING HYPHEN}", " ": "\N{NO-BREAK SPACE}"})


def one_style(text: str) -> str:
    """The same text with a space before each percent sign, however the sentence was made."""
    return re.sub(r"(?<=\d)%", " %", text)


def unbroken(text: str) -> str:
    """The same text for a page: no line breaks between a number and its unit, or within a date and time."""
    dated = _DATE.sub(lambda date: date[0].translate(_WHOLE), one_style(text))
    return _SPACED.sub("\N{NO-BREAK SPACE}", dated)


def measured_error(summary: Mapping[str, Any], brief: bool = False) -> str:
    """What `SharedPower.said` says, or `brief`, of its summary."""
    return error_said(summary["error"], summary["interval"], brief=brief)


def interval(edges: Sequence[float | None]) -> str:
    """A confidence interval as percentages."""
    low, high = edges
    return f"{percent(low)} to {percent(high)}"


def fixed(value: float | None, digits: int, unit: str = "") -> str:
    """A number with fixed decimals and its unit; "-" for None and NaN."""
    return "-" if value is None or not math.isfinite(value) else f"{value:.{digits}f}{unit and ' ' + unit}"


def counted(things: Sized | int, what: str) -> str:
    """A number of things: "1 file", "2 files"."""
    number = things if isinstance(things, int) else len(things)
    return f"{number} {what}{'' if number == 1 else 's'}"


def sentence(parts: Sequence[str], mark: str = "; ") -> str:
    """Parts as one sentence."""
    return f"{capital(mark.join(parts))}."


def damping(resonance: Resonance) -> str:
    """Damping ratio of a resonance in percent, with its interval of 95 %, or the bound that is known."""
    low, high = resonance.damping_interval
    if resonance.damping_is_bound:
        return f"at most {100 * high:.2g} %"
    return f"{100 * resonance.damping:.3g} % ({100 * low:.3g} to {100 * high:.3g} %)"


TRAVEL = (
    "Force in N over the travel of the cap in mm, of a whole press: down along the upper branch, up along "
    "the lower one. The dot is the activation."
)
CURVES = (
    "Force in N over the travel in mm, measured slowly: down (line) and up (dashed). Circle: tactile peak; "
    "square: operating point; triangle: bottom-out."
)
PRESSES = (
    "Vertical acceleration over its peak (thin, blue), force in N (thick, orange) and activation state "
    "(dashed, green; shaded while active), and the power spectral density (PSD) of the acceleration in "
    "(m/s²)²/Hz. After the paper's figure 6."
)
FORCES = (
    "Force in N at the activation of each press (dots), and mean and standard deviation (square, bar) for "
    "each participant and for all together. After the paper's figure 7."
)
RESPONSE = (
    "Velocity in µm/s per volt at the patch, its phase in degrees and its coherence: measured (thick), and "
    "the fitted rational model (thin). The dotted line is the strongest resonance."
)
TREND = "Resonance (Hz), damping, gain and coherence of each place over time; bands are the tolerances."
MODES = (
    "Drift of the frequency of each strong mode in %, since the first night's calibration; one panel a mode, "
    "all on one scale."
)
DRIVES = "Voltage at the patch in V, over time in ms. After the paper's figure 8."
COLUMNS = (
    "Force in N, travel in mm, vertical acceleration in m/s² and activation of an imported file over time in "
    "s; dotted lines are the presses found."
)
COMPARISON = (
    "Left: the recorded press above the measured motion of the surface, each over its peak. Middle: target "
    "(thick) and measured (thin) acceleration in m/s² around the largest peak. Right: power spectral density "
    "(PSD) of the measured motion, of the recorded press to the same scale, and of the noise left in the "
    "mean of the plays, in means over hundredths of the band; the band that the drive uses is shaded. After "
    "the paper's figure 9."
)
FEELING = (
    "Left: third-octave levels in dB re 1 µm/s² in the loudest second of each signal, the noise left in the "
    "mean of the plays, and thresholds of detection: of a finger that presses (line; grey: where it may lie) "
    "and of one at rest (dotted). Right: level in 20 ms over the threshold of a finger that presses (0 dB). "
    "Above each panel: how far the loudest second lies above that threshold, and who feels it."
)
CHECK = (
    "Target (thick) and measured (thin) acceleration in m/s²; third octaves of the measured motion with the "
    "noise left in the mean of the plays; third octaves in the loudest second against thresholds of "
    "detection; level in 20 ms over the threshold of a finger that presses (0 dB)."
)
PLAN = (
    "Expected error in percent over the level above the threshold of a finger that "
    "presses in dB, of what the rig's limits allow: filled marks as calibrated, open ones after a drift of "
    "the table by 1 %, which drives of several patches are planned against. Line: the threshold; grey: where "
    "it may lie, so that it is not known there whether most people feel it. Dotted: the error that a check "
    "tolerates."
)
_ITERATIONS = "Iterations: error within the band of each drive that was tried."
LEARNING = f"{CHECK} {_ITERATIONS}"
ITERATIONS = (
    "Target (thick) and measured (thin) acceleration in m/s²; third octaves of the measured motion with the "
    f"noise left in the mean of the plays. {_ITERATIONS}"
)
BEFORE_AND_AFTER = (
    "Target (orange) and measured acceleration (black) of each button, around the largest acceleration. "
    "Left: the old drive on the drifted table. Right: the new drive. A new drive has a new target, because "
    "its carrier is the present resonance."
)
MAP = (
    "Top: largest displacement in µm per V at the best frequency, for each patch and for all together; the "
    "ring marks the best point. Bottom: the strongest modes, each from −1 to 1, with white lines where it "
    "does not move. Grey: not measured. After the paper's figure 3."
)
CONFUSION = (
    "Answers in percent of the trials in which a button was presented (rows sum to 100), for each group and "
    "day. After the paper's figure 13."
)
RATINGS = (
    "Mean and standard deviation over participants of the rating of each adjective pair; larger is nearer to "
    "the second adjective. After the paper's figure 14."
)
