"""Replies of SCPI instruments: text in, values out, no I/O.

Forms of response data: IEEE 488.2-1992, 8.7 (NR1, NR2, NR3); SCPI-99 volume 1, 7.2.1.3 and 7.2.1.4
for infinity and not-a-number, and volume 2, 21.8 for the error queue.
"""

from __future__ import annotations

import math
import re

_NUMBER = re.compile(r"[+-]?(?:\d{1,40}(?:\.\d{0,40})?|\.\d{1,40})(?:[eE][+-]?\d{1,3})?")
_ERROR = re.compile(r'([+-]?\d{1,6})\s*,\s*(?:"([^"]*(?:""[^"]*)*)"|([^",]*))')
_INFINITE = 9e37
"""SCPI writes infinity as 9.9E+37."""
_NAN = 9.91e37
"""SCPI writes NaN as 9.91E+37."""


def number_of(text: str) -> float:
    """Parse a number; `INF...` and 9.9E+37 are infinity. Raises ValueError otherwise, NaN included."""
    if re.fullmatch(r"INF(INITY|INITE)?", text.upper()):
        return math.inf
    if not _NUMBER.fullmatch(text):
        raise ValueError("not a number")
    value = float(text)
    if not abs(value) > _INFINITE:
        return value
    if math.isclose(value, _NAN, rel_tol=1e-4) or value < 0:
        raise ValueError("SCPI's NaN, or minus infinity")
    return math.inf


def switch_of(text: str) -> bool:
    """Parse the state of a switch: ON or OFF, 1 or 0. Raises ValueError."""
    states = {"0": False, "OFF": False, "1": True, "ON": True}
    if text.upper() not in states:
        raise ValueError("neither ON nor OFF")
    return states[text.upper()]


def error_of(text: str) -> tuple[int, str]:
    """Parse an entry of the error queue; number 0 means that the queue is empty. Raises ValueError."""
    entry = _ERROR.fullmatch(text)
    if entry is None:
        raise ValueError("no entry of an error queue")
    return int(entry[1]), (entry[2] or entry[3] or "").replace('""', '"')


def words_of(text: str) -> tuple[str, str, str, str]:
    """Parse the answer to `*IDN?`: maker, model, serial number and firmware. Raises ValueError."""
    words = [word.strip() for word in text.split(",")]
    if len(words) != 4 or not words[0] or not words[1]:
        raise ValueError("not maker, model, serial number and firmware")
    return words[0], words[1], words[2], words[3]
