"""What a finger would feel of a result, as JSON values and as rows of a table."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from rich.table import Table

from ...calibration import Feeling
from .formatting import json_number

__all__ = ["add_feeling", "feeling_values"]


def feeling_values(feeling: Feeling) -> dict[str, Any]:
    """Return levels above threshold, bands, parts and sentences as JSON values."""
    signals = {"target": feeling.target, "measured": feeling.measured, "residual": feeling.residual}
    if feeling.recorded is not None:
        signals["recorded"] = feeling.recorded
    return {
        "felt": feeling.felt,
        "difference_felt": feeling.difference,
        "difference_comparable": feeling.comparable,
        "loudness_db": json_number(feeling.loudness_db),
        "levels": {
            name: [
                {
                    "window_s": level.window,
                    "start_s": json_number(level.start),
                    "above_resting_threshold_db": json_number(level.total),
                    "above_lowest_threshold_db": json_number(level.sensitive),
                    "bands_db": [json_number(band) for band in level.bands],
                }
                for level in pair
            ]
            for name, pair in signals.items()
        },
        "noise_above_resting_threshold_db": json_number(feeling.noise_total),
        "third_octaves_hz": [json_number(f) for f in feeling.octaves_hz],
        "resting_threshold_db": [json_number(level) for level in feeling.resting_db],
        "lowest_threshold_db": [json_number(level) for level in feeling.sensitive_db],
        "reference_m_s2": 1e-6,
        "above_threshold_s": [list(span) for span in feeling.spans],
        "lost_s": [list(span) for span in feeling.lost],
        "notes": list(feeling.notes),
    }


def add_feeling(table: Table, feeling: Feeling, said: Collection[str] = ()) -> None:
    """Add rows to a table of properties: levels above threshold, and the sentences that are not `said`."""
    table.add_row("Above threshold", f"100 ms: {_levels(feeling, 0)}")
    table.add_row("", f"20 ms: {_levels(feeling, 1)}")
    table.add_row("Can be felt", feeling.felt)
    for note in feeling.notes:
        if note not in said:
            table.add_row("", note)


def _levels(feeling: Feeling, window: int) -> str:
    signals = {"target": feeling.target, "measured": feeling.measured, "difference": feeling.residual}
    if feeling.recorded is not None:
        signals["recorded press"] = feeling.recorded
    return ", ".join(f"{name} {pair[window].total:+.1f} dB" for name, pair in signals.items())
