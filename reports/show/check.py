"""The result of one check, as values, as a table, and on standard output."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from rich.table import Table

from ...acquisition import Representative
from ...calibration import Check, check_feeling
from ...terminal.progress import SIMULATED, print_json, print_line, print_table
from .feeling import add_feeling, feeling_values
from .formatting import interval, json_number, percent, property_table, verdict

__all__ = ["check_contents", "show_check"]


def show_check(
    result: Check, as_json: bool, press: Representative | None = None, file: Path | None = None
) -> None:
    """Print what `check_contents` returns."""
    values, table = check_contents(result, press, file)
    if as_json:
        print_json(values)
        return
    print_table(table)
    if result.simulated:
        print_line(SIMULATED)


def check_contents(
    result: Check, press: Representative | None = None, file: Path | None = None
) -> tuple[dict[str, Any], Table]:
    """Return the contents of a check as JSON values and as a table.

    `press`, the recorded one, adds how loud the motion is against it; `file` is where the plays are kept.
    """
    drive, feeling = result.drive, check_feeling(result, press)
    values: dict[str, Any] = {
        "kind": "check",
        "simulated": result.simulated,
        "button": drive.button,
        "patch": drive.patch,
        "drive_peak_v": json_number(drive.peak),
        "scale": json_number(drive.scale),
        "in_band": json_number(drive.in_band),
        **result.summary(),
        "feeling": feeling_values(feeling),
    }
    table = property_table(f"Check of the {drive.button} button, {result.plays} plays")
    table.add_row(
        "Error, whole motion",
        f"{percent(result.wideband_nrmse)} ({interval(result.wideband_interval)}), at most "
        f"{percent(result.tolerance)}; up to {result.judged_hz:.0f} Hz",
    )
    low, high = drive.band
    table.add_row(
        f"Within {low:.0f} to {high:.0f} Hz", f"{percent(result.nrmse)} ({interval(result.nrmse_interval)})"
    )
    table.add_row(
        "Motion outside", f"{percent(result.outside)} of the target ({interval(result.outside_interval)})"
    )
    table.add_row(
        "Correlation", f"{result.correlation:.4f}, of the envelopes {result.envelope_correlation:.4f}"
    )
    table.add_row("Third octaves", f"{result.third_octave_error_db:.2f} dB")
    table.add_row(
        "Noise of the plays' mean",
        f"{percent(result.wideband_floor)}, within the band {percent(result.floor)}",
    )
    table.add_row("Drive", f"{drive.peak:.1f} V peak at patch {drive.patch}")
    table.add_row("Scale", f"{drive.scale:.4f} of the recorded acceleration")
    table.add_row("Energy in the band", percent(drive.in_band))
    add_feeling(table, feeling, result.notes)
    if file is not None:
        values["file"] = str(file)
        table.add_row("Every play is kept in", str(file))
    table.add_row("Verdict", verdict(result.verdict))
    for sentence in (*result.reasons, *result.notes):
        table.add_row("", sentence)
    return values, table
