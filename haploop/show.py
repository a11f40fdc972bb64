"""What the command line says about results: tables on standard output, or one JSON object."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from matplotlib.figure import Figure
from rich.box import SIMPLE
from rich.table import Table
from rich.text import Text

from acquisition import ButtonPress, Recording, Representative, find_presses, high_pass
from acquisition.store import check_target
from calibration import Calibration, Check, Drive
from calibration.files import why
from haploop import figures
from haploop.console import print_json, print_line, print_table
from haploop.plotting import mark_simulated, png
from instruments import ConfigurationError, DataError

__all__ = ["check", "claim", "demo", "keep", "show"]

_SIMULATED = "Simulated: no real instrument measured this."


def show(path: Path, as_json: bool, plot: Path | None = None) -> None:
    """Say what is in a file that haploop wrote, and draw it into `plot` (PNG).

    Raises DataError for a file that is missing, damaged, or of another kind, and
    ConfigurationError when there is nothing to draw to.
    """
    if plot is not None:
        _new_picture(plot)
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


def _new_picture(path: Path) -> None:
    """Refuse a name at which no new PNG can stand: a recording must not become a picture."""
    if path.suffix.lower() != ".png":
        raise ConfigurationError(f"{path} is no name for a picture: it must end with .png.")
    if path.exists():
        raise ConfigurationError(f"{path} exists, and nothing is overwritten: name another file.")
    if not path.parent.is_dir():
        raise ConfigurationError(f"There is no folder {path.parent} to write {path.name} to.")
    check_target(path)


def save(figure: Figure, path: Path, simulated: bool) -> None:
    """Write a figure as a new PNG, which says so if it shows simulated data. Raises ConfigurationError."""
    if simulated:
        mark_simulated(figure)
    content = png(figure)
    try:
        with path.open("xb") as file:
            file.write(content)
    except OSError as error:
        raise _unwritten(path, error) from None


def _unwritten(path: Path, error: OSError | RuntimeError) -> ConfigurationError:
    return ConfigurationError(f"{path} cannot be written: {why(error)}.")


def check(press: Representative, result: Check, as_json: bool) -> None:
    """The outcome of one check."""
    drive = result.drive
    values = {
        "simulated": result.simulated,
        "button": drive.button,
        "patch": drive.patch,
        "presses": press.members,
        "drive_peak_v": _number(drive.peak),
        "drive_measured_peak_v": _number(result.drive_measured_peak),
        "scale": _number(drive.scale),
        "in_band": _number(drive.in_band),
        "plays": result.plays,
        "nrmse": _number(result.nrmse),
        "tolerance": _number(result.tolerance),
        "correlation": _number(result.correlation),
        "envelope_correlation": _number(result.envelope_correlation),
        "third_octave_error_db": _number(result.third_octave_error_db),
        "floor": _number(result.floor),
        "passed": bool(result.passed),
        "reasons": list(result.reasons),
    }
    if as_json:
        print_json(values)
        return
    table = _pairs(f"Check of the {drive.button} button, {result.plays} plays")
    table.add_row("Error", f"{_percent(result.nrmse)}, at most {_percent(result.tolerance)}")
    table.add_row(
        "Correlation", f"{result.correlation:.4f}, of the envelopes {result.envelope_correlation:.4f}"
    )
    table.add_row("Third octaves", f"{result.third_octave_error_db:.2f} dB")
    table.add_row("Repeatability floor", _percent(result.floor))
    table.add_row("Drive", f"{drive.peak:.1f} V peak at patch {drive.patch}")
    table.add_row("Scale", f"{drive.scale:.4f} of the recorded acceleration")
    table.add_row("Energy in the band", _percent(drive.in_band))
    table.add_row("Verdict", _verdict(result.passed))
    print_table(table)
    if result.simulated:
        print_line(_SIMULATED)
    for reason in result.reasons:
        print_line(reason)


def claim(out: Path, button: str) -> None:
    """Refuse, before anything is played, a folder that cannot take what `keep` will write."""
    for path in _kept(out, button):
        check_target(path)


def keep(out: Path, press: Representative, result: Check) -> None:
    """Write what a check used and found into a folder. Raises ConfigurationError and DataError."""
    press_file, drive_file, picture = _kept(out, press.button)
    try:
        press.save(press_file)
    except (OSError, RuntimeError) as error:
        raise _unwritten(press_file, error) from None
    result.drive.save(drive_file)
    save(figures.comparison([(press, result)]), picture, result.simulated)


def _kept(out: Path, button: str) -> tuple[Path, Path, Path]:
    return out / f"{button}-press.h5", out / f"{button}-drive.h5", out / f"{button}-check.png"


def demo(summary: Mapping[str, Any]) -> None:
    """The outcome of a demo."""
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
            _fixed(button["activation_force_n"], 2, "N"),
            _fixed(button["activation_force_true_n"], 2, "N"),
            _fixed(button["drive_peak_v"], 1, "V"),
            _percent(button["in_band"]),
            _percent(button["nrmse"]),
            _percent(button["floor"]),
            _fixed(button["correlation"], 4),
            _verdict(button["passed"]),
        )
    print_table(table)
    for name, button in summary["buttons"].items():
        for reason in button["reasons"]:
            print_line(f"{name}: {reason}")
    for note in summary["notes"]:
        print_line(note)
    print_line("In band: the share of the modulated press's energy that is played and compared.")
    print_line(
        f"Resonance {summary['resonance_hz']:.2f} Hz (true: {summary['resonance_true_hz']:.2f} Hz). "
        f"{summary['simulated_s']:.0f} s of simulated time in {summary['wall_s']:.0f} s."
    )
    print_line(f"Everything here is simulated ({summary['mode']}, seed {summary['seed']}).")
    print_line(f"Report: {summary['report']}")


def _contents(path: Path) -> tuple[dict[str, Any], Table, Any]:
    kind = _kind(path)
    if kind == "recording":
        recording = Recording.open(path)
        found = find_presses(recording)
        return *_recording(recording, found), lambda: _recording_figure(recording, found)
    if kind == "representative":
        press = Representative.load(path)
        return *_representative(press), lambda: figures.profiles([figures.Profile.of(press)])
    if kind == "calibration":
        calibration = Calibration.load(path)
        return *_calibration(calibration), lambda: figures.response(calibration)
    drive = Drive.load(path)
    return *_drive(drive), lambda: figures.drives([drive])


def _kind(path: Path) -> str:
    """What a file says it is: recording, representative, calibration or drive. Raises DataError."""
    if not path.is_file():
        raise DataError(f"There is no file {path}.")
    try:
        with h5py.File(path, "r") as file:
            # A recording says what it is in its format, everything else beside it.
            kind = str(file.attrs.get("kind", file.attrs.get("format", "")))
    except (OSError, KeyError, RuntimeError, ValueError):
        raise DataError(f"{path} is damaged, or not a file that haploop wrote.") from None
    if not kind.startswith("haploop "):
        raise DataError(f"{path} is not a file that haploop wrote.")
    kind = kind.removeprefix("haploop ")
    if kind not in ("recording", "representative", "calibration", "drive"):
        raise DataError(f"{path} holds a {kind}, which `haploop show` does not know.")
    return kind


def _recording(recording: Recording, found: tuple[ButtonPress, ...]) -> tuple[dict[str, Any], Table]:
    forces = [p.force_at_activation for p in found if p.force_at_activation is not None]
    mean = float(np.mean(forces)) if forces else None
    deviation = float(np.std(forces, ddof=1)) if len(forces) > 1 else None
    saturated = [number for number, p in enumerate(found, 1) if p.saturated]
    rate_hz = recording.rate_hz
    values: dict[str, Any] = {
        "kind": "recording",
        "file": str(recording.path),
        "simulated": recording.simulated,
        "rig": recording.rig,
        "button": recording.button,
        "participant": recording.participant,
        "rate_hz": _number(rate_hz),
        "duration_s": _number(recording.duration),
        "channels": list(recording.channels),
        "complete": bool(recording.complete),
        "content_hash": recording.content_hash,
        "presses_detected": len(found),
        "activation_force_n": _number(mean),
        "activation_force_sd_n": _number(deviation),
        "saturated_presses": saturated,
        "presses": [
            {
                "onset_s": _number(p.onset / rate_hz),
                "activation_s": _number(p.activation / rate_hz if p.activation is not None else None),
                "force_at_activation_n": _number(p.force_at_activation),
                "release_s": _number(p.release / rate_hz),
                "saturated": bool(p.saturated),
            }
            for p in found
        ],
    }
    spread = "" if deviation is None else f" ± {deviation:.3f}"
    table = _pairs(f"Recording {recording.path.name}")
    table.add_row("Button", f"{recording.button}, pressed by {recording.participant}")
    table.add_row("Rig", recording.rig)
    table.add_row(
        "Length", f"{recording.duration:.2f} s, {len(recording.channels)} channels at {rate_hz:g} Hz"
    )
    table.add_row("State", "complete" if recording.complete else "cut short; what is here can be read")
    table.add_row("Presses found", str(len(found)))
    table.add_row("Force at activation", "none" if mean is None else f"{mean:.3f}{spread} N")
    table.add_row(
        "Saturated", f"in presses {', '.join(map(str, saturated))}" if saturated else "never while pressed"
    )
    table.add_row("Content", f"SHA-256 {recording.content_hash}")
    return values, table


def _recording_figure(recording: Recording, found: tuple[ButtonPress, ...]) -> Figure:
    """The press whose force at activation is the median, as in the paper's figure 6."""
    whole = [p for p in found if p.activation is not None and p.force_at_activation is not None]
    if not whole:
        raise DataError(
            f"{recording.path} holds no press that switched the button, so there is none to draw."
        )
    press = sorted(whole, key=lambda p: p.force_at_activation or 0.0)[len(whole) // 2]
    assert press.activation is not None
    acceleration = high_pass(recording.acceleration[2], recording.rate_hz)
    part = slice(press.start, press.stop)
    sensor = recording.sensors.acceleration
    profile = figures.Profile(
        button=recording.button,
        time=np.asarray((np.arange(press.start, press.stop) - press.activation) / recording.rate_hz),
        acceleration=acceleration[part],
        force=recording.force[part],
        # A maintained button opens at every other press: what counts is that the state changed.
        activation=np.abs(recording.activation[part] - recording.activation[press.start]),
        rate_hz=recording.rate_hz,
        bandwidth_hz=sensor.bandwidth_hz if sensor else None,
    )
    return figures.profiles([profile])


def _representative(press: Representative) -> tuple[dict[str, Any], Table]:
    peak = float(np.max(np.abs(press.acceleration)))
    force = float(press.force[press.activation_index])
    values: dict[str, Any] = {
        "kind": "representative",
        "simulated": press.simulated,
        "button": press.button,
        "presses": press.members,
        "rate_hz": _number(press.rate_hz),
        "duration_s": _number(len(press.acceleration) / press.rate_hz),
        "acceleration_peak": _number(peak),
        "activation_force_n": _number(force),
        "bandwidth_hz": _number(press.bandwidth_hz),
        "sources": [{"file": name, "sha256": content} for name, content in press.sources],
    }
    table = _pairs(f"Representative press of the {press.button} button")
    table.add_row("Stands for", f"{press.members} presses in {len(press.sources)} recordings")
    table.add_row("Length", f"{1e3 * len(press.acceleration) / press.rate_hz:.0f} ms at {press.rate_hz:g} Hz")
    table.add_row("Largest acceleration", f"{peak:.2f} m/s²")
    table.add_row("Force at activation", f"{force:.3f} N")
    table.add_row("Bandwidth", f"{press.bandwidth_hz:g} Hz, the accelerometer's")
    return values, table


def _calibration(calibration: Calibration) -> tuple[dict[str, Any], Table]:
    response, model = calibration.response, calibration.model
    values: dict[str, Any] = {
        "kind": "calibration",
        "simulated": response.simulated,
        "rig": response.rig,
        "created": response.created,
        "patch": response.patch,
        "point": response.point,
        "band_hz": [_number(response.frequencies[0]), _number(response.frequencies[-1])],
        "repeats": response.repeats,
        "coherence_min": _number(response.coherence.min()),
        "coherence_median": _number(np.median(response.coherence)),
        "resonance_hz": _number(model.resonance_hz),
        "model_error": _number(model.error),
        "stable": bool(model.stable),
        "resonances": [
            {"frequency_hz": _number(frequency), "damping": _number(damping), "strength": _number(strength)}
            for frequency, damping, strength in (
                (r.frequency_hz, r.damping, r.strength) for r in model.resonances
            )
        ],
    }
    table = _pairs(f"Calibration of patch {response.patch} at the {response.point} point")
    table.add_row("Rig", f"{response.rig}, {response.created}")
    table.add_row(
        "Response",
        f"{response.frequencies[0]:.0f} to {response.frequencies[-1]:.0f} Hz, {response.repeats} repeats",
    )
    table.add_row(
        "Coherence", f"median {values['coherence_median']:.4f}, lowest {values['coherence_min']:.4f}"
    )
    table.add_row("Resonance", f"{model.resonance_hz:.2f} Hz (the strongest of {len(model.resonances)})")
    table.add_row(
        "Model", f"{_percent(model.error)} from the response, {'stable' if model.stable else 'UNSTABLE'}"
    )
    return values, table


def _drive(drive: Drive) -> tuple[dict[str, Any], Table]:
    swing = float(np.ptp(drive.volts))
    values: dict[str, Any] = {
        "kind": "drive",
        "simulated": drive.simulated,
        "button": drive.button,
        "patch": drive.patch,
        "rate_hz": _number(drive.rate_hz),
        "duration_s": _number(len(drive.volts) / drive.rate_hz),
        "drive_peak_v": _number(drive.peak),
        "drive_swing_v": _number(swing),
        "carrier_hz": _number(drive.carrier_hz),
        "band_hz": [_number(edge) for edge in drive.band],
        "scale": _number(drive.scale),
        "in_band": _number(drive.in_band),
        "predicted_error": _number(drive.predicted_error),
    }
    table = _pairs(f"Drive of the {drive.button} button at patch {drive.patch}")
    table.add_row("Voltage", f"{drive.peak:.1f} V peak, {swing:.1f} V peak to peak")
    table.add_row("Length", f"{1e3 * len(drive.volts) / drive.rate_hz:.0f} ms at {drive.rate_hz:g} Hz")
    table.add_row("Carrier", f"{drive.carrier_hz:.2f} Hz")
    table.add_row(
        "Band", f"{drive.band[0]:.0f} to {drive.band[1]:.0f} Hz, {_percent(drive.in_band)} of the energy"
    )
    table.add_row("Scale", f"{drive.scale:.4f} of the recorded acceleration")
    table.add_row("Predicted error", _percent(drive.predicted_error))
    return values, table


def _pairs(title: str) -> Table:
    table = Table(box=SIMPLE, title=title, title_justify="left", show_header=False)
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    return table


def _verdict(passed: bool) -> Text:
    return Text("pass", style="bold green") if passed else Text("FAIL", style="bold red")


def _percent(value: float | None) -> str:
    return "-" if value is None or not math.isfinite(value) else f"{100 * value:.1f} %"


def _fixed(value: float | None, digits: int, unit: str = "") -> str:
    return "-" if value is None else f"{value:.{digits}f}{unit and ' ' + unit}"


def _number(value: Any) -> float | None:
    return float(value) if value is not None and math.isfinite(value) else None
