"""XDF, which programs for LSL streams read: a recording with the streams recorded along, on one time."""

from __future__ import annotations

from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from ..acquisition import Recording
from ..base.arrays import FloatArray
from ..base.files import new_file
from ..instruments.streams import FORMATS, XdfWriter, header
from .reading import recording_signals
from .views import About

_CHUNK = 10_000
"""Samples of a chunk."""
_DOUBLE, _TEXT = 2, 3
"""Of `FORMATS`."""


def write_recording(path: Path, out: Path) -> About:
    """Export a recording's channels in SI units, a text at the activation of each accepted press, and the
    streams recorded along, with their own values.

    Stamps are s from the recording's first sample, and need no correction. Raises DataError, and
    ConfigurationError without pyxdf for a recording with streams.
    """
    signals, recording = recording_signals(path), Recording.open(path)
    streams = recording.streams.values()
    with new_file(out) as part, part.open("wb") as file:
        writer = _Streams(XdfWriter(file))
        rows = np.stack([channel.values for channel in signals.channels], axis=1)
        channels = [(channel.name, channel.unit) for channel in signals.channels]
        name = f"haploop {recording.rig} record"
        writer.add(name, "Haptics", recording.rate_hz, _DOUBLE, channels, signals.time, rows, signals.about)
        activations = [
            (v.activation / recording.rate_hz, f"press {v.number} activates") for v in recording.accepted
        ]
        known = [(at, text) for at, text in activations if np.isfinite(at)]
        times, texts = np.array([at for at, _ in known]), [[text] for _, text in known]
        writer.add("haploop presses", "Markers", 0, _TEXT, [("press", "")], times, texts)
        for one in streams:
            form = _form(one.values)
            channels = list(zip(one.labels, one.units, strict=True))
            writer.add(one.sender, one.type, one.rate_hz, form, channels, one.times, one.values)
    return signals.about


class _Streams:
    """Streams one after the other."""

    def __init__(self, file: XdfWriter) -> None:
        self._file, self._number = file, 0

    def add(
        self,
        name: str,
        kind: str,
        rate_hz: float,
        form: int,
        channels: list[tuple[str, str]],
        times: FloatArray,
        values: Any,
        about: About = MappingProxyType({}),
    ) -> None:
        self._number += 1
        self._file.stream(self._number, header(name, kind, rate_hz, form, channels, desc=about))
        for first in range(0, len(times), _CHUNK):
            own = slice(first, first + _CHUNK)
            self._file.samples(self._number, form, times[own], values[own])


def _form(values: np.ndarray[Any, Any]) -> int:
    """Which of `FORMATS` values have."""
    return next((key for key, (_, kind) in FORMATS.items() if kind and np.dtype(kind) == values.dtype), _TEXT)
