"""The summary and the report of a demo."""

from __future__ import annotations

import math
import platform
from collections.abc import Mapping, Sequence
from importlib import metadata
from typing import Any

import numpy as np

from ...calibration import check_feeling
from ...reports import figures
from ...reports.html import CaptionedFigure, captions, render
from ...reports.show import feeling_values
from .result import PRESSES, ButtonResult, Demo

__all__ = ["report", "summarise"]


def summarise(demo: Demo) -> dict[str, Any]:
    """Summarise a run for `summary.json`: finite numbers, or null where nothing was measured."""
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
        "carriers_hz": [_number(r.frequency_hz) for r in model.carriers],
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
    forces = np.concatenate([np.zeros(0), *result.forces.values()])
    measured, drive = result.check, result.check.drive
    return {
        "presses": PRESSES * len(result.recordings),
        "presses_detected": len(forces),
        "activation_force_n": _number(float(np.mean(forces))) if len(forces) else None,
        "activation_force_true_n": _number(float(np.mean(result.true_forces)))
        if result.true_forces
        else None,
        "drive_peak_v": _number(drive.peak),
        "drive_peak_to_peak_v": _number(float(np.ptp(drive.volts))),
        "scale": _number(drive.scale),
        "band_hz": [_number(edge) for edge in drive.band],
        "in_band": _number(drive.in_band),
        "predicted_error": _number(drive.predicted_error),
        **measured.summary(),
        "feeling": feeling_values(check_feeling(measured, result.press)),
        "left_out": list(result.press.left_out),
        "sources": [{"file": r.path.name, "sha256": r.content_hash} for r in result.recordings],
    }


def _band(demo: Demo) -> tuple[float, float]:
    """Band (Hz) of the response used by the drives."""
    bands = [result.check.drive.band for result in demo.buttons]
    return float(min(low for low, _ in bands)), float(max(high for _, high in bands))


def report(demo: Demo, summary: Mapping[str, Any]) -> str:
    """Render the report of a run as HTML."""
    return render(summary, _captioned_figures(demo))


def _captioned_figures(demo: Demo) -> Sequence[CaptionedFigure]:
    """Draw the report's figures, each with a caption that names the corresponding figure of the paper."""
    results = demo.buttons
    response = demo.calibration.response
    forces = {r.button: r.forces for r in results if r.forces}
    truth = {r.button: float(np.mean(r.true_forces)) for r in results if r.true_forces}
    carrier = results[0].check.drive.carrier_hz
    drawn = (
        (
            figures.profiles([figures.Profile.of(r.press) for r in results]),
            "Representative press of each button",
            f"{captions.PRESSES} The band is one standard deviation of the aligned presses. {_counts(demo)}",
        ),
        (
            figures.activation_forces(forces, truth),
            "Force at activation",
            f"{captions.FORCES} The black lines are the true values of the simulated plant. {_counts(demo)}",
        ),
        (
            figures.response(demo.calibration, demo.true_response),
            f"The table's response, patch {response.patch} to the button point",
            f"{captions.RESPONSE} Dashed: the true response of the plant without patch hysteresis. "
            f"n = {response.repeats} repeats.",
        ),
        (
            figures.drives([r.check.drive for r in results], demo.limits),
            f"The drives at patch {response.patch}",
            f"{captions.DRIVES} Each press modulated onto {carrier:.2f} Hz and divided by the response, as "
            "large as the rig's limits allow.",
        ),
        (
            figures.comparison([(r.press, r.check) for r in results]),
            "Measured motion of the table",
            f"{captions.COMPARISON} n = {results[0].check.plays} plays of each drive.",
        ),
        (
            figures.feeling_figure([(r.button, check_feeling(r.check, r.press)) for r in results]),
            "What a finger would feel",
            f"{captions.FEELING} n = {results[0].check.plays} plays of each drive.",
        ),
    )
    return [CaptionedFigure(*one, simulated=True) for one in drawn]


def _counts(demo: Demo) -> str:
    participants = len(demo.buttons[0].recordings)
    told = ", ".join(f"{r.button} n = {r.press.members}" for r in demo.buttons)
    return f"{told.capitalize()} presses by {participants} participant{'' if participants == 1 else 's'}."


def _software() -> dict[str, str]:
    packages = ("haploop", "numpy", "scipy", "h5py", "nidaqmx", "dtaidistance", "matplotlib")
    return {**{name: metadata.version(name) for name in packages}, "python": platform.python_version()}


def _number(value: float | None) -> float | None:
    return float(value) if value is not None and math.isfinite(value) else None
