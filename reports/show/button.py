"""Contents of a digital button, as a table and as JSON values."""

from __future__ import annotations

from typing import Any

from rich.box import SIMPLE
from rich.table import Table

from ...calibration import DigitalButton, check_feeling
from .feeling import add_feeling, feeling_values
from .formatting import interval, json_number, percent, verdict

__all__ = ["button_contents"]


def button_contents(button: DigitalButton) -> tuple[dict[str, Any], Table]:
    """Return the contents as JSON values and as a table."""
    drive, check, learning = button.drive, button.check, button.learning
    response = button.calibration.response
    feeling = check_feeling(check, button.press)
    values: dict[str, Any] = {
        "kind": "button",
        "simulated": button.simulated,
        "button": button.press.button,
        "passed": button.passed,
        "rig": drive.rig,
        "patch": drive.patch,
        "point": drive.point,
        "method": drive.method,
        "carrier_hz": json_number(drive.carrier_hz),
        "band_hz": [json_number(edge) for edge in drive.band],
        "in_band": json_number(drive.in_band),
        "scale": json_number(drive.scale),
        "drive_peak_v": json_number(drive.peak),
        "unreached": drive.unreached,
        "check": check.summary(),
        "feeling": feeling_values(feeling),
        "iterations": [
            {
                "wideband_nrmse": json_number(i.wideband_nrmse),
                "nrmse": json_number(i.nrmse),
                "floor": json_number(i.floor),
                "kept": bool(i.kept),
                "reason": i.reason,
            }
            for i in learning.iterations
        ],
        "best": learning.best,
        "stopped": learning.stopped,
        "created": button.created,
        "software": button.made_with,
        "calibrated": response.created,
        "calibration_sha256": drive.calibration,
        "sources": [{"file": name, "sha256": content} for name, content in drive.sources],
        "content_sha256": button.digest,
    }
    table = Table(
        box=SIMPLE,
        title=f"Digital {button.press.button} button, {verdict(check.verdict)}",
        title_justify="left",
        show_header=False,
    )
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    for reason in check.reasons:
        table.add_row(f"Verdict: {check.verdict}", reason)
    for note in check.notes:
        table.add_row("Note", note)
    table.add_row("Made", f"{button.created} on {drive.rig}, patch {drive.patch} at the {drive.point} point")
    carrier = f" with {drive.carrier_hz:.2f} Hz" if drive.carrier_hz else ""
    table.add_row(
        "Drive", f"{drive.method}{carrier}, {drive.peak:.1f} V peak, {len(drive.volts) / drive.rate_hz:.2f} s"
    )
    table.add_row(
        "Error",
        f"whole motion {percent(check.wideband_nrmse)} ({interval(check.wideband_interval)}) over "
        f"{check.plays} "
        f"plays; within the band {percent(check.nrmse)}; motion outside {percent(check.outside)} of the "
        "target",
    )
    table.add_row(
        "Noise", f"of the plays' mean: {percent(check.wideband_floor)}, in band {percent(check.floor)}"
    )
    table.add_row(
        "Similarity",
        f"correlation {check.correlation:.3f}, of envelopes {check.envelope_correlation:.3f}, third octaves "
        f"{check.third_octave_error_db:.1f} dB",
    )
    add_feeling(table, feeling, check.notes)
    if drive.unreached:
        table.add_row("Not reached", drive.unreached)
    for index, iteration in enumerate(learning.iterations):
        kept = "kept" if iteration.kept else "not kept"
        table.add_row(
            "Learning" if index == 0 else "",
            f"{index}: in band {iteration.nrmse:.1%}, {kept}: {iteration.reason}",
        )
    table.add_row("", learning.stopped)
    table.add_row("Calibration", f"{response.created}, SHA-256 {drive.calibration}")
    for name, content in drive.sources:
        table.add_row("Recording", f"{name}, SHA-256 {content}")
    table.add_row("Content", f"SHA-256 {values['content_sha256']}")
    return values, table
