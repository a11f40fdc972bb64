"""The tidy table of a study: one row a press and attempt, whatever became of it."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Iterator, Mapping
from types import MappingProxyType
from typing import TextIO

import numpy as np

from ...base.arrays import FloatArray
from ..recording import PressVerdict, Recording
from .filtering import high_pass
from .segmentation import ButtonPress, find_presses

Cell = str | float | int | bool | None

PRESS_COLUMNS: Mapping[str, str] = MappingProxyType(
    {
        "study": "",
        "session": "",
        "participant": "",
        "button": "",
        "press": "",
        "attempt": "",
        "accepted": "",
        "flags": "",
        "reason": "",
        "onset_s": "s",
        "first_stage_s": "s",
        "activation_s": "s",
        "opened_s": "s",
        "release_s": "s",
        "force_at_activation_n": "N",
        "force_uncertainty_n": "N",
        "peak_force_n": "N",
        "activated_by": "",
        "peak_travel_mm": "mm",
        "peak_acceleration": "m/s^2",
        "rms_acceleration": "m/s^2",
        "centroid_hz": "Hz",
        "started": "",
        "rig": "",
        "simulated": "",
        "file": "",
        "content_hash": "",
    }
)
"""Columns and their units. Times are from the recording's first sample; the acceleration is the vertical one
above 10 Hz, from onset to release; the centroid is its spectrum's, weighted by power. A quantity that was not
measured is missing in its rows; `force_uncertainty_n` is `ButtonPress.force_uncertainty`; `activated_by` says
what told the activation: "activation" (the contact), "force", "displacement", "velocity" or "acceleration".
"""


def press_rows(recordings: Iterable[Recording]) -> Iterator[dict[str, Cell]]:
    """Yield a row for each press of several recordings, in their order. Raises DataError."""
    for recording in recordings:
        yield from _rows(recording)


def _rows(recording: Recording) -> list[dict[str, Cell]]:
    found = list(find_presses(recording)) if recording.sensors.linear else []
    verdicts = recording.verdicts
    moved = None
    if recording.motion is not None and found:
        moved = high_pass(recording.vertical, recording.rate_hz)
    pairs: list[tuple[PressVerdict | None, ButtonPress | None]] = []
    for verdict in verdicts:
        within = [press for press in found if verdict.first <= press.peak < verdict.end]
        # The one that switched stands for an attempt that was pressed twice.
        within.sort(key=lambda press: press.activation is None)
        pairs.append((verdict, within[0] if within else None))
    if not verdicts:
        pairs = [(None, press) for press in found]
    return [
        _row(recording, number, verdict, press, moved) for number, (verdict, press) in enumerate(pairs, 1)
    ]


def _row(
    recording: Recording,
    number: int,
    verdict: PressVerdict | None,
    press: ButtonPress | None,
    moved: FloatArray | None,
) -> dict[str, Cell]:
    header, rate_hz = recording.header, recording.rate_hz
    row: dict[str, Cell] = dict.fromkeys(PRESS_COLUMNS)
    row |= {
        "study": header.study,
        "session": header.session,
        "participant": recording.participant,
        "button": recording.button,
        "press": verdict.number if verdict else number,
        "attempt": verdict.attempt if verdict else 1,
        "accepted": verdict.accepted if verdict else None,
        "flags": " ".join(verdict.flags) if verdict else "",
        "reason": verdict.reason if verdict else "",
        "started": header.started,
        "rig": recording.rig,
        "simulated": recording.simulated,
        "file": recording.path.name,
        "content_hash": recording.content_hash,
    }
    if verdict is not None:
        row |= {"onset_s": verdict.first / rate_hz, "release_s": verdict.end / rate_hz}
    if press is None:
        return row
    row |= {
        "onset_s": press.onset / rate_hz,
        "release_s": press.release / rate_hz,
        "first_stage_s": None if press.first_stage is None else press.first_stage / rate_hz,
        "activation_s": None if press.activation is None else press.activation / rate_hz,
        "opened_s": None if press.opened is None else press.opened / rate_hz,
        "force_at_activation_n": press.force_at_activation,
        "force_uncertainty_n": press.force_uncertainty,
        "activated_by": press.activated_by if press.activation is not None else None,
    }
    within = slice(press.onset, press.release + 1)
    if recording.has("force"):
        row["peak_force_n"] = float(recording.force[within].max())
    if recording.has("displacement"):
        row["peak_travel_mm"] = 1e3 * float(recording.travel[within].max())
    if moved is not None:
        own = moved[within]
        power = np.abs(np.fft.rfft(own)) ** 2
        row |= {
            "peak_acceleration": float(np.abs(own).max()),
            "rms_acceleration": float(np.sqrt(np.mean(own**2))),
            "centroid_hz": float(np.fft.rfftfreq(len(own), 1 / rate_hz) @ power / power.sum()),
        }
    return row


def write_rows(
    file: TextIO, columns: Iterable[str], rows: Iterable[Mapping[str, Cell]], headings: bool = True
) -> None:
    """Write rows into an open file (newline=""), with a line of headings before them or without."""
    writer = csv.DictWriter(file, list(columns))
    if headings:
        writer.writeheader()
    for row in rows:
        writer.writerow({name: _cell(value) for name, value in row.items()})


def _cell(value: Cell) -> Cell:
    """A text that a spreadsheet would take for a formula gets an apostrophe before it."""
    if isinstance(value, str) and value.startswith(("=", "+", "-", "@", "\t", "\r")):
        return f"'{value}"
    return "" if value is None else value
