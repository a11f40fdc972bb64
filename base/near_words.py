"""The word that somebody meant, among those that there are."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable


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
