"""Contents of a digital button, as a table, as JSON values and as a figure."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from rich.box import SIMPLE
from rich.table import Table

from haploop.calibration import DigitalButton
from haploop.figures.plotting import active, colour, legend_above, letter, new_figure, style
from haploop.show.formatting import json_number

__all__ = ["contents", "figure"]


def contents(button: DigitalButton) -> tuple[dict[str, Any], Table]:
    """JSON values, and a table."""
    drive, check, learning = button.drive, button.check, button.learning
    response = button.calibration.response
    values: dict[str, Any] = {
        "kind": "button",
        "simulated": button.simulated,
        "button": button.press.button,
        "passed": button.passed,
        "reasons": list(check.reasons),
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
        "nrmse": json_number(check.nrmse),
        "floor": json_number(check.floor),
        "beyond_noise": json_number(check.beyond_noise),
        "correlation": json_number(check.correlation),
        "envelope_correlation": json_number(check.envelope_correlation),
        "third_octave_error_db": json_number(check.third_octave_error_db),
        "plays": check.plays,
        "iterations": [
            {
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
        title=f"Digital {button.press.button} button, {'pass' if button.passed else 'FAIL'}",
        title_justify="left",
        show_header=False,
    )
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    for reason in check.reasons:
        table.add_row("Fails because", reason)
    table.add_row("Made", f"{button.created} on {drive.rig}, patch {drive.patch} at the {drive.point} point")
    carrier = f" with {drive.carrier_hz:.2f} Hz" if drive.carrier_hz else ""
    table.add_row(
        "Drive", f"{drive.method}{carrier}, {drive.peak:.1f} V peak, {len(drive.volts) / drive.rate_hz:.2f} s"
    )
    table.add_row(
        "Error",
        f"{check.nrmse:.1%} over {check.plays} plays; repeatability floor {check.floor:.1%}, error without "
        f"noise {check.beyond_noise:.1%}",
    )
    table.add_row(
        "Similarity",
        f"correlation {check.correlation:.3f}, of envelopes {check.envelope_correlation:.3f}, third octaves "
        f"{check.third_octave_error_db:.1f} dB",
    )
    if drive.unreached:
        table.add_row("Not reached", drive.unreached)
    for index, iteration in enumerate(learning.iterations):
        kept = "kept" if iteration.kept else "not kept"
        table.add_row(
            "Learning" if index == 0 else "",
            f"{index}: {iteration.nrmse:.1%}, {kept}: {iteration.reason}",
        )
    table.add_row("", learning.stopped)
    table.add_row("Calibration", f"{response.created}, SHA-256 {drive.calibration}")
    for name, content in drive.sources:
        table.add_row("Recording", f"{name}, SHA-256 {content}")
    table.add_row("Content", f"SHA-256 {values['content_sha256']}")
    return values, table


def figure(button: DigitalButton) -> Figure:
    """Target and measured acceleration, third octaves, and each iteration's error over the floor."""
    check, drive = button.check, button.drive
    with style():
        drawn = new_figure(2.6)
        whole, bands, errors = drawn.subplots(1, 3, width_ratios=[2, 1, 1])
        begin, end = active(drive.target, drive.rate_hz)
        part = slice(max(0, round(begin * drive.rate_hz)), round(end * drive.rate_hz))
        milliseconds = 1e3 * np.arange(part.start, part.stop)[: len(drive.target[part])] / drive.rate_hz
        whole.plot(milliseconds, drive.target[part], color=colour(0), label="target")
        whole.plot(milliseconds, check.measured[part], color=colour(1), linestyle="--", label="measured")
        whole.set_xlabel("Time (ms)")
        whole.set_ylabel("Acceleration (m/s²)")
        legend_above(whole, 2)
        bands.semilogx(check.octaves_hz, check.target_db, "o-", color=colour(0), markersize=3)
        bands.semilogx(check.octaves_hz, check.measured_db, "s--", color=colour(1), markersize=3)
        bands.set_xlabel("Third octave (Hz)")
        bands.set_ylabel("Level (dB re 1 m/s²)")
        _learning(errors, button)
        for index, axes in enumerate((whole, bands, errors)):
            letter(axes, index)
    return drawn


def _learning(axes: Axes, button: DigitalButton) -> None:
    tried = button.learning.iterations
    numbers = np.arange(len(tried))
    values = np.array([100 * i.nrmse for i in tried])
    kept = np.array([i.kept for i in tried])
    axes.plot(numbers[kept], values[kept], "o-", color=colour(0), markersize=4, label="kept")
    axes.plot(numbers[~kept], values[~kept], "x", color=colour(0), markersize=4, label="not kept")
    axes.plot(numbers, [100 * i.floor for i in tried], "--", color=colour(1), label="floor")
    axes.set_ylim(bottom=0)
    axes.set_xlabel("Iteration")
    axes.set_ylabel("Error (%)")
    axes.set_xticks(numbers)
    legend_above(axes, 2)
