"""Numbers as the reader of a table sees them."""

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
