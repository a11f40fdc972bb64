"""Amplitude and frequency modulation of a simulated function generator.

AM at a depth of 0 halves the amplitude, and reaches it at 100 % (DG1000Z programming guide, 2-117); with a
suppressed carrier it is in proportion to the depth. The peak deviation of FM is at most the carrier's
frequency, and both together at most its highest (DG4000 programming guide, FM). Where a modulating wave
begins was not found: a sine at zero (estimate). Nothing is wired to the input of an external source: 0 V.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...base.arrays import FloatArray
from .scpi import ScpiError

AM, FM = "[:SOURce#]:AM:STATe", "[:SOURce#]:FM:STATe"
DEPTH, DEVIATION = "[:SOURce#]:AM[:DEPTh]", "[:SOURce#]:FM[:DEViation]"
SUPPRESSED = "[:SOURce#]:AM:DSSC"
SOURCE = {kind: f"[:SOURce#]:{kind}:SOURce" for kind in ("AM", "FM")}
WAVE = {kind: f"[:SOURce#]:{kind}:INTernal:FUNCtion" for kind in ("AM", "FM")}
PACE = {kind: f"[:SOURce#]:{kind}:INTernal:FREQuency" for kind in ("AM", "FM")}
_WAVES = ("SINusoid", "SQUare", "TRIangle", "RAMP", "NRAMp")
WORDS = dict.fromkeys(SOURCE.values(), ("INTernal", "EXTernal")) | dict.fromkeys(WAVE.values(), _WAVES)

_CYCLE = np.linspace(0.0, 1.0, 4097)
_CORNERS = {"TRI": (-1, 1, -1), "RAMP": (-1, 1), "NRAM": (1, -1)}
"""Waves of straight lines, at evenly spaced times of a cycle."""


@dataclass(frozen=True)
class Modulation:
    """What modulates a channel."""

    kind: str
    """AM or FM."""
    wave: str
    frequency: float
    """Of the wave (Hz)."""
    amount: float
    """Depth of AM (1 for 100 %), peak deviation of FM (Hz)."""
    suppressed: bool = False
    """True for AM without its carrier."""

    def gain(self, times: FloatArray) -> FloatArray | float:
        """Return (times,) factors of the amplitude at `times` (s)."""
        if self.kind != "AM":
            return 1.0
        wave = np.interp(np.mod(times * self.frequency, 1.0), _CYCLE, _wave(self.wave))
        return np.asarray(self.amount * wave if self.suppressed else (1 + self.amount * wave) / 2)

    def cycles(self, times: FloatArray) -> FloatArray | float:
        """Return (times,) cycles beyond those of the carrier."""
        if self.kind != "FM":
            return 0.0
        wave = _wave(self.wave)
        since = np.concatenate([[0.0], np.cumsum((wave[1:] + wave[:-1]) / 2)]) / (len(wave) - 1)
        since -= since[-1] * _CYCLE  # no wave here has a mean
        phase = np.mod(times * self.frequency, 1.0)
        return np.asarray(self.amount / self.frequency * np.interp(phase, _CYCLE, since))


def _wave(name: str) -> FloatArray:
    if name in _CORNERS:
        corners = _CORNERS[name]
        return np.interp(_CYCLE, np.linspace(0.0, 1.0, len(corners)), corners)
    if name == "SQU":
        return np.where(_CYCLE < 0.5, 1.0, -1.0)
    return np.asarray(np.sin(2 * np.pi * _CYCLE) if name == "SIN" else np.zeros(len(_CYCLE)))


def modulation_of(values: Mapping[str, float], words: Mapping[str, str]) -> Modulation | None:
    """Return the modulation that is on, None without one."""
    kind = "AM" if values[AM] else "FM"
    if not values[AM] and not values[FM]:
        return None
    wave = words[WAVE[kind]] if words[SOURCE[kind]] == "INT" else ""
    amount = values[DEPTH] / 100 if kind == "AM" else values[DEVIATION]
    return Modulation(kind, wave, values[PACE[kind]], amount, bool(values[SUPPRESSED]))


def check_carrier(header: str, shape: str) -> None:
    """Raise ScpiError for a modulation, by its header, that a shape does not take."""
    if header in (AM, FM) and shape in (("DC",) if header == AM else ("DC", "NOIS", "PRBS")):
        raise ScpiError(-221, "Settings conflict; not able to modulate this function")
