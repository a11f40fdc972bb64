"""Words that all layers share: a sentence's beginning, errors with their spread, the word that was meant."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable, Sequence

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


# The word that somebody meant, among those that there are.


def near(word: str, known: Iterable[str]) -> str | None:
    """Return the known word that `word` is nearest to, or None: usb6211 is usb-6211, ni is ni-daqmx."""
    plain = {_plain(one): one for one in sorted(known, reverse=True)}
    written = _plain(word)
    if written in plain:
        return plain[written]
    begun = sorted(one for one in plain if written and one.startswith(written))
    close = difflib.get_close_matches(written, plain, n=1)
    return plain[(begun or close)[0]] if begun or close else None


def did_you_mean(word: str, known: Iterable[str], otherwise: str) -> str:
    """Return a clause with the near word, or `otherwise` and all known words."""
    words = sorted(known)
    found = near(word, words)
    return f"did you mean {found!r}?" if found else f"{otherwise} {', '.join(words) or 'none'}."


def _plain(word: str) -> str:
    return re.sub(r"[^a-z0-9]", "", word.lower())
