"""The result of one check, on standard output."""

from __future__ import annotations

from haploop.acquisition import Representative
from haploop.calibration import Check
from haploop.progress import print_json, print_line, print_table
from haploop.show.formatting import SIMULATED, json_number, percent, property_table, verdict

__all__ = ["show_check"]


def show_check(press: Representative, result: Check, as_json: bool) -> None:
    """Print the result of one check."""
    drive = result.drive
    values = {
        "simulated": result.simulated,
        "button": drive.button,
        "patch": drive.patch,
        "presses": press.members,
        "drive_peak_v": json_number(drive.peak),
        "drive_measured_peak_v": json_number(result.drive_measured_peak),
        "scale": json_number(drive.scale),
        "in_band": json_number(drive.in_band),
        "plays": result.plays,
        "nrmse": json_number(result.nrmse),
        "tolerance": json_number(result.tolerance),
        "correlation": json_number(result.correlation),
        "envelope_correlation": json_number(result.envelope_correlation),
        "third_octave_error_db": json_number(result.third_octave_error_db),
        "floor": json_number(result.floor),
        "passed": bool(result.passed),
        "reasons": list(result.reasons),
    }
    if as_json:
        print_json(values)
        return
    table = property_table(f"Check of the {drive.button} button, {result.plays} plays")
    table.add_row("Error", f"{percent(result.nrmse)}, at most {percent(result.tolerance)}")
    table.add_row(
        "Correlation", f"{result.correlation:.4f}, of the envelopes {result.envelope_correlation:.4f}"
    )
    table.add_row("Third octaves", f"{result.third_octave_error_db:.2f} dB")
    table.add_row("Repeatability floor", percent(result.floor))
    table.add_row("Drive", f"{drive.peak:.1f} V peak at patch {drive.patch}")
    table.add_row("Scale", f"{drive.scale:.4f} of the recorded acceleration")
    table.add_row("Energy in the band", percent(drive.in_band))
    table.add_row("Verdict", verdict(result.passed))
    print_table(table)
    if result.simulated:
        print_line(SIMULATED)
    for reason in result.reasons:
        print_line(reason)
