"""Contents of a recording and of a representative press, as a table and as JSON values."""

from __future__ import annotations

from typing import Any

import numpy as np
from rich.table import Table
from rich.text import Text

from ...acquisition import ButtonPress, Recording, Representative
from .along import along_rows, along_values
from .formatting import json_number, property_table

__all__ = ["recording_contents", "representative_contents"]

_LISTED = 10
"""Most sentences of a kind in a table; JSON has all."""


def recording_contents(
    recording: Recording, found: tuple[ButtonPress, ...], counted: tuple[ButtonPress, ...]
) -> tuple[dict[str, Any], Table]:
    """Return the contents as JSON values and as a table."""
    forces = [p.force_at_activation for p in counted if p.force_at_activation is not None]
    bad = [press for press in recording.verdicts if not press.accepted]
    mean = float(np.mean(forces)) if forces else None
    deviation = float(np.std(forces, ddof=1)) if len(forces) > 1 else None
    saturated = [number for number, p in enumerate(found, 1) if p.saturated]
    rate_hz = recording.rate_hz
    why = ("gap", "overrun", "error", "interrupted", "recovered")
    ended = next((event.text for event in reversed(recording.events) if event.kind in why), None)
    values: dict[str, Any] = {
        "kind": "recording",
        "file": str(recording.path),
        "simulated": recording.simulated,
        "rig": recording.rig,
        "button": recording.button,
        "participant": recording.participant,
        "study": recording.header.study,
        "session": recording.header.session,
        "notes": recording.header.notes,
        "participant_columns": recording.about,
        "rate_hz": json_number(rate_hz),
        "duration_s": json_number(recording.duration),
        "channels": list(recording.channels),
        "complete": bool(recording.complete),
        "in_progress": recording.in_progress,
        "ended": ended,
        "content_hash": recording.content_hash,
        "presses_detected": len(found),
        "presses_accepted": len(counted),
        "activation_force_n": json_number(mean),
        "activation_force_sd_n": json_number(deviation),
        "saturated_presses": saturated,
        "presses": [
            {
                "onset_s": json_number(p.onset / rate_hz),
                "activation_s": json_number(p.activation / rate_hz if p.activation is not None else None),
                "force_at_activation_n": json_number(p.force_at_activation),
                "release_s": json_number(p.release / rate_hz),
                "saturated": bool(p.saturated),
                "accepted": p in counted,
            }
            for p in found
        ],
        "bad_presses": [
            {
                "press": press.number,
                "attempt": press.attempt,
                "flags": list(press.flags),
                "reason": press.reason,
            }
            for press in bad
        ],
    }
    spread = "" if deviation is None else f" ± {deviation:.3f}"
    table = property_table(f"Recording {recording.path.name}")
    table.add_row("Button", f"{recording.button}, pressed by {recording.participant}")
    if recording.header.study:
        table.add_row("Study", Text(f"{recording.header.study}, session {recording.header.session}"))
    for column, value in recording.about.items():
        table.add_row(Text(column), Text(str(value)))
    if recording.header.notes:
        table.add_row("Notes", Text(recording.header.notes))
    table.add_row("Rig", recording.rig)
    table.add_row(
        "Length", f"{recording.duration:.2f} s, {len(recording.channels)} channels at {rate_hz:g} Hz"
    )
    state = "complete" if recording.complete else f"incomplete: {ended or 'the recording ended early.'}"
    table.add_row("State", "in progress" if recording.in_progress else state)
    table.add_row("Presses found", f"{len(found)}, {len(counted)} of them accepted")
    for press in bad:
        table.add_row("", Text(f"press {press.number}, attempt {press.attempt}: {press.reason}"))
    table.add_row("Force at activation", "none" if mean is None else f"{mean:.3f}{spread} N")
    table.add_row(
        "Saturated", f"in presses {', '.join(map(str, saturated))}" if saturated else "never while pressed"
    )
    values |= along_values(recording)
    for heading, text in along_rows(recording):
        table.add_row(Text(heading), Text(text))
    table.add_row("Content", f"SHA-256 {recording.content_hash}")
    return values, table


def representative_contents(press: Representative) -> tuple[dict[str, Any], Table]:
    """Return the contents as JSON values and as a table."""
    peak = float(np.max(np.abs(press.acceleration)))
    force = float(press.force[press.activation_index])
    values: dict[str, Any] = {
        "kind": "representative",
        "simulated": press.simulated,
        "button": press.button,
        "presses": press.members,
        "rate_hz": json_number(press.rate_hz),
        "duration_s": json_number(len(press.acceleration) / press.rate_hz),
        "acceleration_peak": json_number(peak),
        "activation_force_n": json_number(force),
        "bandwidth_hz": json_number(press.bandwidth_hz),
        "corrected": list(press.corrected),
        "left_out": list(press.left_out),
        "method": press.method,
        "reason": press.reason,
        "scores": {name: json_number(score) for name, score in press.scores.items()},
        "undone_hz": press.undone_hz,
        "noise_gain": json_number(press.noise_gain),
        "sources": [{"file": name, "sha256": content} for name, content in press.sources],
    }
    table = property_table(f"Representative press of the {press.button} button")
    table.add_row("Stands for", f"{press.members} presses in {len(press.sources)} recordings")
    for heading, sentences in (("Left out", press.left_out), ("Corrected", press.corrected)):
        for number, sentence in enumerate(sentences[:_LISTED]):
            table.add_row("" if number else heading, Text(sentence))
        if len(sentences) > _LISTED:
            table.add_row("", f"and {len(sentences) - _LISTED} more")
    table.add_row("Length", f"{1e3 * len(press.acceleration) / press.rate_hz:.0f} ms at {press.rate_hz:g} Hz")
    table.add_row("Largest acceleration", f"{peak:.2f} m/s²")
    table.add_row("Force at activation", f"{force:.3f} N")
    table.add_row("Bandwidth", f"{press.bandwidth_hz:g} Hz, the accelerometer's")
    if press.undone_hz is not None:
        low, high = press.undone_hz
        table.add_row("Undone", f"from {low:g} to {high:g} Hz; noise grew {press.noise_gain:.1f} times")
    table.add_row("Method", f"{press.method}: {press.reason}" if press.reason else press.method)
    for name, score in press.scores.items():
        table.add_row("", f"{name} leaves {score:.1%}")
    return values, table
