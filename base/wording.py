"""Words that all layers share: the beginning of a sentence, and an error that several plays measured."""

from __future__ import annotations

import math
from collections.abc import Sequence

_SHOWN = 0.0005
"""Error below which "0.0 %" would be shown."""


def capital(text: str) -> str:
    """The text with a capital at its beginning; `str.capitalize` would change "Hz" and names too."""
    return text[:1].upper() + text[1:]


def error_said(
    root: float | None, interval: Sequence[float | None], named: str = "", brief: bool = False
) -> str:
    """An error for people, from the root and interval of a `SharedPower`, or of its `summary`.

    An estimate of zero was within the noise or below it, which measures no error of zero: it says how large
    the error is at most. `named` stands before the interval, which `brief` leaves out.
    """
    low, high = (float("nan") if edge is None else edge for edge in interval)
    if root is None or not math.isfinite(root):
        return "not known"
    if root < _SHOWN:
        return f"at most {100 * max(high, 2 * _SHOWN):.1f} %" if math.isfinite(high) else "not known"
    among = f" ({named}{100 * low:.1f} to {100 * high:.1f} %)" if math.isfinite(high) and not brief else ""
    return f"{100 * root:.1f} %{among}"
