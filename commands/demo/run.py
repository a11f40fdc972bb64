"""The complete workflow on a simulated rig: record, representative press, calibrate, drive, check, report."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ...acquisition import Recording, Representative, record, representative
from ...base.clock import Clock, RealClock
from ...base.errors import ConfigurationError
from ...base.files import new_file
from ...base.progress import Progress, part_of, prefixed, silent
from ...calibration import (
    Calibration,
    Check,
    Drift,
    Drive,
    TradeOff,
    Waveforms,
    calibrate_keeping,
    drive_for,
)
from ...calibration.drive import Method, check, offered
from ...calibration.model import calibration_of
from ...calibration.perception import Sensation, lab_threshold, pressing_act
from ...instruments import Rig, load_rig_file, open_rig
from ...instruments.driver import Mode
from ...instruments.sensors import loss
from ...reports.contents import forces_in
from ..live_views import published
from .report import BUTTONS, PRESSES, ButtonResult, Demo, report, summarise

_RESULTS = (
    "recordings",
    "presses",
    "drives",
    "checks",
    "calibration.h5",
    "calibration-waveforms.h5",
    "summary.json",
    "report.html",
)
"""Files and folders written by a demo."""
_SURE = 1.0
"""Level (dB) by which a drive is planned above what most people feel: up to 0.5 dB less was measured."""
_METHODS: tuple[Method, ...] = ("modulated", "broadband")
"""Methods that several patches play by: the first that most people feel, or else the louder."""
_LOUD = TradeOff(error=0.065, drift=Drift().times(0.1))
"""What several patches are planned for: 8 % of error with what distortion adds, and a tenth of the usual
drift, because they are played minutes after they were calibrated."""


def run_demo(
    out: str | Path | None = None,
    rig: str | Path = "simulated",
    *,
    seed: int | None = None,
    participants: int = 1,
    patches: Sequence[str] | None = None,
    figures: bool = False,
    mode: Mode | None = None,
    progress: Progress = silent,
    clock: Clock | None = None,
) -> dict[str, Any]:
    """Run the workflow on a simulated rig and write all results into a folder (see `claim_folder`).

    A lab's rig file is always simulated, with twins unless `mode` is "wire": no hardware is used.
    `seed` overrides the seed in the file. `patches` play at once; by default all that have an amplifier
    channel of their own, or else A. With `figures` the report shows the paper's, with the true values of the
    simulated plant. Returns the summary, which is also written as `summary.json`
    beside `report.html`, `calibration.h5`, `calibration-waveforms.h5`, `recordings/`, `presses/`, `drives/`
    and `checks/`. Error, floor, verdict and response can be computed again from these files.

    Raises ConfigurationError when `out` holds a demo already or cannot be written, and the
    errors of the steps.
    """
    clock = clock or RealClock()
    began = clock.now()
    file = load_rig_file(rig)
    folder = claim_folder(out)
    overrides = {} if seed is None else {"seed": seed}
    simulate = mode or file.simulate or "twin"
    with open_rig(file, simulate=simulate, simulation=overrides) as opened, published(opened):
        played = _patches(opened, patches)
        demo = _loop(opened, folder, participants, played, str(rig), progress, lambda: clock.now() - began)
    step = "Write the report"
    progress(step, 0, 1, "")
    summary = summarise(demo)
    with new_file(folder / "summary.json") as part:
        part.write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    with new_file(folder / "report.html") as part:
        part.write_text(report(demo, summary, figures), encoding="utf-8", newline="\n")
    progress(step, 1, 1, "")
    return summary


def claim_folder(out: str | Path | None) -> Path:
    """Create the output folder if it is missing; None selects a new `haploop-demo`, `haploop-demo-2`, ...

    Raises ConfigurationError when it already holds a demo's files, or cannot be created or written.
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


def _patches(rig: Rig, asked: Sequence[str] | None) -> tuple[str, ...]:
    """The patches that play at once. Raises ConfigurationError for one that the table does not have."""
    if asked is None:
        own = tuple(patch for patch in rig.table.patches if patch in rig.amplifier.inputs)
        return own if len(own) > 1 else ("A",)
    unknown = [patch for patch in asked if patch not in rig.table.patches]
    if unknown:
        raise ConfigurationError(
            f"The table of the rig {rig.name!r} has no patch {unknown[0]!r}: "
            f"{', '.join(rig.table.patches)} are there."
        )
    return tuple(asked)


def _calibrations(rig: Rig, out: Path, patches: Sequence[str], progress: Progress) -> list[Calibration]:
    """Calibrate each patch: into calibration.h5, or several into calibration-A.h5 and so on."""
    found = []
    for patch in patches:
        file = out / "calibration.h5"
        doing = prefixed(progress, "Calibrate the table")
        if len(patches) > 1:
            file, doing = calibration_of(file, patch), prefixed(progress, f"Calibrate patch {patch}")
        calibration, waveforms = calibrate_keeping(rig, patch, "button", doing)
        calibration.save(file)
        waveforms.save(Waveforms.beside(file))
        found.append(calibration)
    return found


def _loop(
    rig: Rig,
    out: Path,
    participants: int,
    patches: Sequence[str],
    source: str,
    progress: Progress,
    wall: Callable[[], float],
) -> Demo:
    assert rig.simulation is not None
    truth = rig.simulation.truth  # for the report only; no step below uses it
    start = rig.clock.now()
    names = [f"P{number:02d}" for number in range(1, participants + 1)]

    recordings: dict[str, list[Recording]] = {}
    for button in BUTTONS:
        step = f"Record the {button} button"
        for index, name in enumerate(names):
            each = part_of(progress, step, index * PRESSES, participants * PRESSES)
            recorded = record(rig, button, name, PRESSES, out / "recordings", progress=each)
            recordings.setdefault(button, []).append(recorded)

    presses: dict[str, Representative] = {}
    (out / "presses").mkdir()
    for button in BUTTONS:
        step = f"Compute the representative press of the {button} button"
        progress(step, 0, 1, "")
        presses[button] = representative(recordings[button])
        presses[button].save(out / "presses" / f"{button}.h5")
        progress(step, 1, 1, "")

    calibrations = _calibrations(rig, out, patches, progress)
    calibration, *others = calibrations
    checks: dict[str, Check] = {}
    (out / "drives").mkdir()
    (out / "checks").mkdir()
    for button in BUTTONS:
        step = f"Compute the drive of the {button} button"
        progress(step, 0, 1, "")
        if others:
            drive = _loud(presses[button], calibrations, rig)
        else:
            drive = drive_for(presses[button], calibration, rig.limits)
        drive.save(out / "drives" / f"{button}.h5")
        progress(step, 1, 1, "")
        checks[button] = check(rig, drive, progress=progress)
        checks[button].save(out / "checks" / f"{button}.h5")

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
                forces_in(recordings[button]).get(button, {}),
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
        notes=tuple(
            n for n in [_loss(rig, calibration.model.resonance_hz), calibration.model.ambiguity] if n
        ),
        simulated_s=rig.clock.now() - start,
        wall_s=wall(),
    )


def _loud(press: Representative, calibrations: Sequence[Calibration], rig: Rig) -> Drive:
    """The drive of several patches by the first method that most people feel, or else by the louder one."""
    lab = lab_threshold(rig)
    found: list[tuple[Drive, float]] = []
    for method in _METHODS:
        drive = drive_for(press, calibrations, rig.limits, method=method, trade=_LOUD)
        level = offered([drive], lab).offers[0].level
        found.append((drive, level))
        if Sensation(pressing_act(lab), level - _SURE).answer == "yes":
            break
    return max(found, key=lambda one: one[1])[0]


def _loss(rig: Rig, resonance_hz: float) -> str | None:
    sensor = rig.sensors.acceleration
    return loss(sensor, resonance_hz) if sensor else None
