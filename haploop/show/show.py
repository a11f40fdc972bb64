"""Results on standard output: tables, or one JSON object."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from rich.box import SIMPLE
from rich.table import Table

from haploop.acquisition import Recording, Representative, accepted_presses, find_presses, hdf5
from haploop.calibration import Calibration, Check, DigitalButton, Drive
from haploop.calibration.map import VibrationMap
from haploop.destinations import check_new_picture
from haploop.figures import figures
from haploop.figures.plotting import mark_simulated, png
from haploop.instruments import DataError
from haploop.instruments.files import check_destination, new_file
from haploop.progress import print_json, print_line, print_table
from haploop.show import button as show_button
from haploop.show import map as show_map
from haploop.show.formatting import fixed, json_number, percent, property_table, verdict
from haploop.show.press import recording_contents, recording_figure, representative_contents
from haploop.show.table import calibration_contents, drive_contents

__all__ = ["check", "claim", "demo", "keep", "save", "show"]

_SIMULATED = "Simulated: no real instrument measured this."


def show(path: Path, as_json: bool, plot: Path | None = None) -> None:
    """Print the contents of a file written by haploop, and plot it into `plot` (PNG).

    Raises DataError for a file that is missing, damaged, or of another kind, and
    ConfigurationError when `plot` cannot be written.
    """
    if plot is not None:
        check_new_picture(plot)
    values, table, draw = _contents(path)
    if plot is not None:
        save(draw(), plot, values["simulated"])
        values["plot"] = str(plot)
    if as_json:
        print_json(values)
        return
    print_table(table)
    if values["simulated"]:
        print_line(_SIMULATED)
    if plot is not None:
        print_line(f"Plot: {plot}")


def save(figure: Figure, path: Path, simulated: bool) -> None:
    """Write a figure as a new PNG, marked if it shows simulated data.

    Raises ConfigurationError when it exists or its folder cannot be written, DataError when the disk fails.
    """
    if simulated:
        mark_simulated(figure)
    content = png(figure)
    check_destination(path)
    with new_file(path) as part:
        part.write_bytes(content)


def check(press: Representative, result: Check, as_json: bool) -> None:
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
        print_line(_SIMULATED)
    for reason in result.reasons:
        print_line(reason)


def claim(out: Path, button: str) -> None:
    """Raise ConfigurationError, before anything is played, if `keep` could not write into the folder."""
    for path in _kept(out, button):
        check_destination(path)


def keep(out: Path, press: Representative, result: Check) -> None:
    """Save the inputs and results of a check in a folder. Raises ConfigurationError and DataError."""
    press_file, drive_file, picture = _kept(out, press.button)
    press.save(press_file)
    result.drive.save(drive_file)
    save(figures.comparison([(press, result)]), picture, result.simulated)


def _kept(out: Path, button: str) -> tuple[Path, Path, Path]:
    return out / f"{button}-press.h5", out / f"{button}-drive.h5", out / f"{button}-check.png"


def demo(summary: Mapping[str, Any]) -> None:
    """Print the result of a demo."""
    table = Table(box=SIMPLE, title="From a press to a verified digital button", title_justify="left")
    table.add_column("Button")
    for heading in (
        "Presses",
        "Force",
        "(true)",
        "Drive",
        "In band",
        "Error",
        "Floor",
        "Correlation",
        "Verdict",
    ):
        table.add_column(heading, justify="right", no_wrap=True)
    for name, button in summary["buttons"].items():
        table.add_row(
            name,
            f"{button['presses_detected']}/{button['presses']}",
            fixed(button["activation_force_n"], 2, "N"),
            fixed(button["activation_force_true_n"], 2, "N"),
            fixed(button["drive_peak_v"], 1, "V"),
            percent(button["in_band"]),
            percent(button["nrmse"]),
            percent(button["floor"]),
            fixed(button["correlation"], 4),
            verdict(button["passed"]),
        )
    print_table(table)
    for name, button in summary["buttons"].items():
        for reason in button["reasons"]:
            print_line(f"{name}: {reason}")
    for note in summary["notes"]:
        print_line(note)
    print_line("In band: share of the modulated press's energy within the band that is played and compared.")
    print_line(
        f"Resonance {summary['resonance_hz']:.2f} Hz (true: {summary['resonance_true_hz']:.2f} Hz). "
        f"{summary['simulated_s']:.0f} s of simulated time in {summary['wall_s']:.0f} s."
    )
    print_line(f"Everything here is simulated ({summary['mode']}, seed {summary['seed']}).")
    print_line(f"Report: {summary['report']}")


def _contents(path: Path) -> tuple[dict[str, Any], Table, Any]:
    if path.is_dir():
        mapped = VibrationMap.load(path)
        return *show_map.contents(mapped), lambda: show_map.figure(mapped)
    kind = _kind(path)
    if kind == "recording":
        recording = Recording.open(path)
        pressed = find_presses(recording)
        counted = accepted_presses(recording, pressed)
        return *recording_contents(recording, pressed, counted), lambda: recording_figure(recording, counted)
    if kind == "representative":
        press = Representative.load(path)
        return *representative_contents(press), lambda: figures.profiles([figures.Profile.of(press)])
    if kind == "calibration":
        calibration = Calibration.load(path)
        return *calibration_contents(calibration), lambda: figures.response(calibration)
    if kind == "button":
        button = DigitalButton.load(path)
        return *show_button.contents(button), lambda: show_button.figure(button)
    drive = Drive.load(path)
    return *drive_contents(drive), lambda: figures.drives([drive])


def _kind(path: Path) -> str:
    """The kind of a file: recording, representative, calibration, drive or button. Raises DataError."""
    kind = hdf5.kind_of(path)
    if kind not in ("recording", "representative", "calibration", "drive", "button"):
        raise DataError(f"{path} holds a {kind}, which `haploop show` cannot display.")
    return kind
