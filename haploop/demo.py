"""The complete workflow on a simulated rig: record, representative press, calibrate, drive, check, report."""

from __future__ import annotations

import json
import math
import platform
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from haploop.acquisition import (
    ButtonPress,
    Recording,
    Representative,
    accepted_presses,
    record,
    representative,
)
from haploop.calibration import Calibration, Check, calibrate, drive_for
from haploop.calibration.drive import check
from haploop.figures import figures
from haploop.instruments import ConfigurationError, Rig, load_rig_file, open_rig
from haploop.instruments.arrays import ComplexArray
from haploop.instruments.clock import Clock, RealClock
from haploop.instruments.driver import Mode
from haploop.live import published
from haploop.report.report import CaptionedFigure, render

__all__ = ["BUTTONS", "PRESSES", "ButtonResult", "Demo", "Progress", "claim_folder", "run_demo"]

BUTTONS = ("latch", "toggle", "push")
"""The paper's three (figure 2)."""
PRESSES = 10
"""Of each button by each participant; paper, "Data Collection"."""

Progress = Callable[[str, float, float], None]
"""Told the step, how much of it is done, and how much it is in all."""

_RESULTS = ("recordings", "presses", "drives", "calibration.h5", "summary.json", "report.html")
"""What a demo writes into its folder."""


@dataclass(frozen=True, eq=False)
class ButtonResult:
    """What the loop found for one button."""

    button: str
    recordings: tuple[Recording, ...]
    presses: tuple[tuple[ButtonPress, ...], ...]
    """Of each recording."""
    press: Representative
    check: Check
    true_forces: tuple[float, ...]
    """Force (N) at each activation, as the plant knows it."""


@dataclass(frozen=True, eq=False)
class Demo:
    """One run of the loop, whole."""

    out: Path
    rig: str
    rig_file: str
    mode: str
    simulation: Mapping[str, Any]
    limits: tuple[float, float]
    buttons: tuple[ButtonResult, ...]
    calibration: Calibration
    true_response: ComplexArray
    true_resonance_hz: float
    notes: tuple[str, ...]
    """What the rig cannot record or render, as sentences."""
    simulated_s: float
    wall_s: float

    @property
    def passed(self) -> bool:
        """Whether every button passed its check."""
        return all(result.check.passed for result in self.buttons)


def run_demo(
    out: str | Path | None = None,
    rig: str | Path = "simulated",
    *,
    seed: int | None = None,
    participants: int = 1,
    mode: Mode | None = None,
    progress: Progress = lambda _step, _done, _of: None,
    clock: Clock | None = None,
) -> dict[str, Any]:
    """Run the loop on a simulated rig and write all that it made into a folder (see `claim_folder`).

    A lab's rig file is simulated too, as twins unless `mode` says wires: nothing real moves.
    `seed` overrides the file's own. Returns the summary, which is also written as `summary.json`
    beside `report.html`, `calibration.h5`, `recordings/`, `presses/` and `drives/`.

    Raises ConfigurationError when `out` holds a demo already or cannot be written, and whatever
    the steps raise.
    """
    clock = clock or RealClock()
    began = clock.now()
    file = load_rig_file(rig)
    folder = claim_folder(out)
    overrides = {} if seed is None else {"seed": seed}
    simulate = mode or file.simulate or "twin"
    with open_rig(file, simulate=simulate, simulation=overrides) as opened, published(opened):
        demo = _loop(opened, folder, participants, str(rig), progress, lambda: clock.now() - began)
    step = "Write the report"
    progress(step, 0, 1)
    summary = _summary(demo)
    (folder / "summary.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    (folder / "report.html").write_text(
        render(summary, _captioned_figures(demo)), encoding="utf-8", newline="\n"
    )
    progress(step, 1, 1)
    return summary


def claim_folder(out: str | Path | None) -> Path:
    """The folder to write to, made if need be; None takes a new `haploop-demo`, `haploop-demo-2`, ...

    Raises ConfigurationError when it holds a demo's files already, or cannot be made or written.
    """
    if out is None:
        number, out = 1, Path("haploop-demo")
        while out.exists():
            number += 1
            out = Path(f"haploop-demo-{number}")
    out = Path(out)
    taken = [name for name in _RESULTS if (out / name).exists()]
    if taken:
        raise ConfigurationError(
            f"The folder {out} already holds {taken[0]} of an earlier demo, which is not overwritten: "
            "choose another folder, or omit --out to create a new one."
        )
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=out):
            pass
    except OSError as error:
        raise ConfigurationError(
            f"The folder {out} cannot be written ({error.strerror or error}): choose another one with --out."
        ) from None
    return out


def _loop(
    rig: Rig, out: Path, participants: int, source: str, progress: Progress, wall: Callable[[], float]
) -> Demo:
    assert rig.simulation is not None
    truth = rig.simulation.truth  # for the report; no step below is given it
    start = rig.clock.now()
    names = [f"P{number:02d}" for number in range(1, participants + 1)]

    recordings: dict[str, list[Recording]] = {}
    for button in BUTTONS:
        step = f"Record the {button} button"
        for index, name in enumerate(names):

            def each(done: int, _of: int, step: str = step, before: int = index * PRESSES) -> None:
                progress(step, before + done, participants * PRESSES)

            recorded = record(rig, button, name, PRESSES, out / "recordings", each)
            recordings.setdefault(button, []).append(recorded)
        progress(step, 1, 1)

    presses: dict[str, Representative] = {}
    (out / "presses").mkdir()
    for button in BUTTONS:
        step = f"Compute the representative press of the {button} button"
        progress(step, 0, 1)
        presses[button] = representative(recordings[button])
        presses[button].save(out / "presses" / f"{button}.h5")
        progress(step, 1, 1)

    step = "Calibrate the table at the button point, patch A"
    calibration = calibrate(rig, "A", "button", lambda done, of: progress(step, done, of))
    calibration.save(out / "calibration.h5")
    progress(step, 1, 1)

    checks: dict[str, Check] = {}
    (out / "drives").mkdir()
    for button in BUTTONS:
        step = f"Drive, play and check the {button} button"
        progress(step, 0, 1)
        drive = drive_for(presses[button], calibration, rig.limits)
        drive.save(out / "drives" / f"{button}.h5")
        checks[button] = check(rig, drive, progress=_told(progress, step))
        progress(step, 1, 1)

    response = calibration.response
    return Demo(
        out=out,
        rig=rig.name,
        rig_file=source,
        mode=str(rig.mode),
        simulation=rig.file.simulation.model_dump(),
        limits=(
            max(rig.limits.min, -rig.limits.peak_to_peak / 2),
            min(rig.limits.max, rig.limits.peak_to_peak / 2),
        ),
        buttons=tuple(
            ButtonResult(
                button,
                tuple(recordings[button]),
                tuple(accepted_presses(recording) for recording in recordings[button]),
                presses[button],
                checks[button],
                tuple(
                    p.activation_force
                    for p in truth.presses
                    if p.button == button and not p.flaw and p.activation_force is not None
                ),
            )
            for button in BUTTONS
        ),
        calibration=calibration,
        true_response=truth.velocity_response(response.patch, response.point, response.frequencies),
        true_resonance_hz=truth.resonance_hz,
        notes=tuple(n for n in [_loss(rig, calibration.model.resonance_hz)] if n),
        simulated_s=rig.clock.now() - start,
        wall_s=wall(),
    )


def _told(progress: Progress, step: str) -> Callable[[float, float], None]:
    return lambda done, of: progress(step, done, of)


def _loss(rig: Rig, resonance_hz: float) -> str | None:
    sensor = rig.sensors.acceleration
    return sensor.loss(resonance_hz) if sensor else None


def _summary(demo: Demo) -> dict[str, Any]:
    """What `summary.json` holds: finite numbers, or null where nothing was measured."""
    model, response = demo.calibration.model, demo.calibration.response
    low, high = _band(demo)
    inside = (response.frequencies >= low) & (response.frequencies <= high)
    return {
        "simulated": True,
        "mode": demo.mode,
        "rig": demo.rig,
        "rig_file": demo.rig_file,
        "seed": demo.simulation["seed"],
        "simulation": dict(demo.simulation),
        "participants": len(demo.buttons[0].recordings),
        "buttons": {result.button: _button(result) for result in demo.buttons},
        "patch": response.patch,
        "point": response.point,
        "resonance_hz": _number(model.resonance_hz),
        "resonance_true_hz": _number(demo.true_resonance_hz),
        "model_error": _number(model.error),
        "coherence_min_in_band": _number(float(np.min(response.coherence[inside]))) if inside.any() else None,
        "band_hz": [_number(low), _number(high)],
        "notes": list(demo.notes),
        "simulated_s": _number(demo.simulated_s),
        "wall_s": _number(demo.wall_s),
        "folder": str(demo.out),
        "report": str(demo.out / "report.html"),
        "software": _software(),
        "date": response.created,
        "passed": demo.passed,
    }


def _button(result: ButtonResult) -> dict[str, Any]:
    forces = [force for by in _forces(result).values() for force in by]
    measured, drive = result.check, result.check.drive
    return {
        "presses": PRESSES * len(result.recordings),
        "presses_detected": sum(len(found) for found in result.presses),
        "activation_force_n": _number(float(np.mean(forces))) if forces else None,
        "activation_force_true_n": _number(float(np.mean(result.true_forces)))
        if result.true_forces
        else None,
        "drive_peak_v": _number(drive.peak),
        "drive_peak_to_peak_v": _number(float(np.ptp(drive.volts))),
        "drive_measured_peak_v": _number(measured.drive_measured_peak),
        "scale": _number(drive.scale),
        "band_hz": [_number(edge) for edge in drive.band],
        "in_band": _number(drive.in_band),
        "predicted_error": _number(drive.predicted_error),
        "nrmse": _number(measured.nrmse),
        "correlation": _number(measured.correlation),
        "envelope_correlation": _number(measured.envelope_correlation),
        "third_octave_error_db": _number(measured.third_octave_error_db),
        "floor": _number(measured.floor),
        "tolerance": _number(measured.tolerance),
        "plays": measured.plays,
        "passed": bool(measured.passed),
        "reasons": list(measured.reasons),
        "left_out": list(result.press.left_out),
        "sources": [{"file": r.path.name, "sha256": r.content_hash} for r in result.recordings],
    }


def _forces(result: ButtonResult) -> dict[str, list[float]]:
    """Force (N) at activation of each press that has one, by participant."""
    return {
        recording.participant: [
            press.force_at_activation for press in found if press.force_at_activation is not None
        ]
        for recording, found in zip(result.recordings, result.presses, strict=True)
    }


def _band(demo: Demo) -> tuple[float, float]:
    """What the drives use of the response (Hz)."""
    bands = [result.check.drive.band for result in demo.buttons]
    return float(min(low for low, _ in bands)), float(max(high for _, high in bands))


def _captioned_figures(demo: Demo) -> Sequence[CaptionedFigure]:
    """The report's figures, each with the caption that says what is seen and which figure it follows."""
    results = demo.buttons
    response = demo.calibration.response
    forces = {r.button: {p: np.array(f) for p, f in _forces(r).items()} for r in results}
    truth = {r.button: float(np.mean(r.true_forces)) for r in results if r.true_forces}
    carrier = results[0].check.drive.carrier_hz
    return (
        CaptionedFigure(
            figures.profiles([figures.Profile.of(r.press) for r in results]),
            "Representative press of each button",
            "Normalised vertical acceleration (blue; the band is one standard deviation of the aligned "
            "presses), force (red) and activation state (green), and the power spectral density (PSD) of "
            "the acceleration. After the paper's figure 6.",
        ),
        CaptionedFigure(
            figures.activation_forces(forces, truth),
            "Force at activation",
            "Each press (dots), and mean and standard deviation for each participant and for all together "
            "(upper right). The black lines are the true values of the simulated plant. "
            "After the paper's figure 7.",
        ),
        CaptionedFigure(
            figures.response(demo.calibration, demo.true_response),
            f"The table's response, patch {response.patch} to the button point",
            "Velocity per volt measured at the patch (linear sine sweep), the fitted rational model, the "
            "true response of the plant without patch hysteresis (dashed), and the coherence. The dotted "
            "line is the resonance, which is the carrier frequency of the drive.",
        ),
        CaptionedFigure(
            figures.drives([r.check.drive for r in results], demo.limits),
            f"The drives at patch {response.patch}",
            f"Each press modulated onto {carrier:.2f} Hz and divided by the response, as large as the "
            "rig's limits allow. After the paper's figure 8.",
        ),
        CaptionedFigure(
            figures.comparison([(r.press, r.check) for r in results]),
            "Measured motion of the table",
            "Left: the recorded press (blue) and the reconstructed acceleration (grey), each scaled to "
            "its peak. Middle: target and measured acceleration around the largest peak. Right: their "
            "spectra, and that of the recorded press to the same scale; the band that the drive uses is "
            "shaded. After the paper's figure 9.",
        ),
    )


def _software() -> dict[str, str]:
    packages = ("haploop", "numpy", "scipy", "h5py", "nidaqmx", "dtaidistance", "scikit-rf", "matplotlib")
    return {**{name: metadata.version(name) for name in packages}, "python": platform.python_version()}


def _number(value: float | None) -> float | None:
    return float(value) if value is not None and math.isfinite(value) else None
