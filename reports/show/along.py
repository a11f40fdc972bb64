"""Data recorded along with presses: extra channels, readings, files, and failures to read them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ...acquisition import Recording
from ...acquisition.recording import Event
from .formatting import json_number

__all__ = ["along_rows", "along_values"]


def along_values(recording: Recording) -> dict[str, Any]:
    """Return JSON values; times are seconds from the first sample."""
    rate_hz = recording.rate_hz
    return {
        "extra": {
            name: {
                "name": sensor.name or name,
                "channel": sensor.channel,
                "unit": sensor.unit,
                **{key: json_number(value) for key, value in _spread(recording, name).items()},
            }
            for name, sensor in recording.sensors.extra.items()
        },
        "readings": [
            {
                "time_s": json_number(reading.sample / rate_hz),
                "instrument": reading.instrument,
                "name": reading.name,
                "value": json_number(reading.value),
                "unit": reading.unit,
            }
            for reading in recording.readings
        ],
        "files": [
            {
                "time_s": json_number(file.sample / rate_hz),
                "instrument": file.instrument,
                "name": file.name,
                "file": file.file,
                "sha256": file.sha256,
            }
            for file in recording.files
        ],
        "along_errors": [
            {"time_s": json_number(event.sample / rate_hz), "error": event.text}
            for event in _failures(recording)
        ],
    }


def along_rows(recording: Recording) -> Iterator[tuple[str, str]]:
    """Yield the heading and the text of each table row."""
    for name, sensor in recording.sensors.extra.items():
        s = _spread(recording, name)
        text = f"{s['mean']:.5g} {sensor.unit}, from {s['min']:.5g} to {s['max']:.5g}" if s else "no samples"
        yield sensor.name or name, text
    read: dict[tuple[str, str], list[float]] = {}
    for reading in recording.readings:
        key = (f"{reading.instrument}: {reading.name}", reading.unit)
        read.setdefault(key, []).append(reading.value)
    for (heading, unit), values in read.items():
        mean, low, high = float(np.mean(values)), min(values), max(values)
        yield heading, f"{mean:.5g} {unit}, from {low:.5g} to {high:.5g} in {_count(values, 'reading')}"
    written: dict[str, list[str]] = {}
    for file in recording.files:
        written.setdefault(f"{file.instrument}: {file.name}", []).append(file.file)
    for heading, names in written.items():
        yield heading, f"{_count(names, 'file')}, {names[0]} to {names[-1]}"
    for event in _failures(recording):
        yield "", f"at {event.sample / recording.rate_hz:.2f} s: {event.text}"


def _spread(recording: Recording, name: str) -> dict[str, float]:
    """Mean, smallest and largest value of an extra channel; empty for a recording without samples."""
    signal = recording.extra[name]
    if not signal.size:
        return {}
    return {"mean": float(signal.mean()), "min": float(signal.min()), "max": float(signal.max())}


def _failures(recording: Recording) -> list[Event]:
    return [event for event in recording.events if event.kind in ("along-error", "along-full")]


def _count(values: list[Any], what: str) -> str:
    return f"{len(values)} {what}{'' if len(values) == 1 else 's'}"
