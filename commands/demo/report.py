"""The results of a demo, its summary and its report."""

from __future__ import annotations

import platform
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from ...acquisition import Recording, Representative
from ...base.arrays import ComplexArray, FloatArray
from ...base.wording import capital
from ...calibration import Calibration, Check, check_feeling, worst
from ...reports import figures, html
from ...reports.contents import (
    Contents,
    Grid,
    calibration_contents,
    check_contents,
    counted,
    fact,
    feeling_values,
    fixed,
    measured_error,
    percent,
    plain,
    verdict_cell,
    words,
)

# Results of one run of the demo.

BUTTONS = ("latch", "toggle", "push")
"""Buttons of the paper (figure 2)."""
PRESSES = 10
"""Presses of each button by each participant (paper, "Data Collection")."""


@dataclass(frozen=True, eq=False)
class ButtonResult:
    """Results of the workflow for one button."""

    button: str
    recordings: tuple[Recording, ...]
    forces: Mapping[str, FloatArray]
    """Force at activation (N) of each press, by participant."""
    press: Representative
    check: Check
    true_forces: tuple[float, ...]
    """True force (N) at each activation, from the plant."""


@dataclass(frozen=True, eq=False)
class Demo:
    """Results of a complete run."""

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
    """Limitations of the rig in recording or rendering, one sentence each."""
    simulated_s: float
    wall_s: float

    @property
    def patches(self) -> str:
        """Names of the patches that played, for people."""
        return self.buttons[0].check.drive.patch

    @property
    def verdict(self) -> str:
        """The worst of all buttons' verdicts."""
        return worst(result.check.verdict for result in self.buttons)

    @property
    def passed(self) -> bool:
        """True when every button passed its check."""
        return all(result.check.passed for result in self.buttons)


def summarise(demo: Demo) -> dict[str, Any]:
    """Summarise a run for `summary.json`: finite numbers, or null where nothing was measured."""
    model, response = demo.calibration.model, demo.calibration.response
    low, high = _band(demo)
    inside = (response.frequencies >= low) & (response.frequencies <= high)
    found: dict[str, Any] = {
        "simulated": True,
        "mode": demo.mode,
        "rig": demo.rig,
        "rig_file": demo.rig_file,
        "seed": demo.simulation["seed"],
        "simulation": dict(demo.simulation),
        "participants": len(demo.buttons[0].recordings),
        "buttons": {result.button: _button(result) for result in demo.buttons},
        "patch": demo.patches,
        "point": response.point,
        "resonance_hz": model.resonance_hz,
        "resonance_true_hz": demo.true_resonance_hz,
        "carriers_hz": [r.frequency_hz for r in model.carriers],
        "model_error": model.error,
        "coherence_min_in_band": float(np.min(response.coherence[inside])) if inside.any() else None,
        "band_hz": [low, high],
        "notes": list(demo.notes),
        "simulated_s": demo.simulated_s,
        "wall_s": demo.wall_s,
        "folder": str(demo.out),
        "report": str(demo.out / "report.html"),
        "software": _software(),
        "date": response.created,
        "passed": demo.passed,
        "verdict": demo.verdict,
    }
    return {name: plain(value) for name, value in found.items()}


def _button(result: ButtonResult) -> dict[str, Any]:
    forces = np.concatenate([np.zeros(0), *result.forces.values()])
    measured, drive = result.check, result.check.drive
    return {
        "presses": PRESSES * len(result.recordings),
        "presses_detected": len(forces),
        "activation_force_n": float(np.mean(forces)) if len(forces) else None,
        "activation_force_true_n": float(np.mean(result.true_forces)) if result.true_forces else None,
        "drive_peak_v": drive.peak,
        "drive_peak_to_peak_v": float(np.ptp(drive.volts, axis=1).max()),
        "scale": drive.scale,
        "band_hz": drive.band,
        "in_band": drive.in_band,
        "method": drive.method,
        "predicted_error": drive.predicted_error,
        **measured.summary(),
        "feeling": feeling_values(check_feeling(measured, result.press)),
        "left_out": list(result.press.left_out),
        "sources": [{"file": r.path.name, "sha256": r.content_hash} for r in result.recordings],
    }


def _band(demo: Demo) -> tuple[float, float]:
    """Band (Hz) of the response used by the drives."""
    bands = [result.check.drive.band for result in demo.buttons]
    return float(min(low for low, _ in bands)), float(max(high for _, high in bands))


def demo_contents(summary: Mapping[str, Any]) -> Contents:
    """What a run says on a terminal, and at the head of its report."""
    buttons = summary["buttons"]
    rows = [
        (
            name,
            f"{b['presses_detected']}/{b['presses']}",
            fixed(b["activation_force_n"], 2, "N"),
            fixed(b["activation_force_true_n"], 2, "N"),
            fixed(b["drive_peak_v"], 1, "V"),
            percent(b["in_band"]),
            measured_error(b["whole"]),
            b["feeling"]["felt"],
            fixed(b["feeling"]["loudness_db"], 1, "dB"),
            verdict_cell(b["verdict"]),
        )
        for name, b in buttons.items()
    ]
    said = [f"{name}: {one}" for name, b in buttons.items() for one in (*b["reasons"], *b["notes"])]
    recorded = [name for name, b in buttons.items() if b["method"] == "broadband"]
    felt = [f"{capital(name)}: {b['feeling']['sentence']}" for name, b in buttons.items()]
    return Contents(
        _TITLE,
        tables=[Grid("", _HEADINGS, rows, below=_EXPLAINED)],
        notes=[
            *felt,
            *dict.fromkeys(b["feeling"]["notes"][0] for b in buttons.values()),
            *(
                [f"{capital(', '.join(recorded))}: played as recorded, without a carrier ({_AS_IS})."]
                if recorded
                else []
            ),
            *_strength(summary),
            *_louder(summary),
            *said,
            *summary["notes"],
            f"Resonance {summary['resonance_hz']:.2f} Hz (true: {summary['resonance_true_hz']:.2f} Hz). "
            f"{summary['simulated_s']:.0f} s of simulated time in {summary['wall_s']:.0f} s.",
        ],
        simulated=True,
        origin=f"Everything here is simulated ({summary['mode']}, seed {summary['seed']}).",
        rig=summary["rig"],
    )


def _louder(summary: Mapping[str, Any]) -> Iterator[str]:
    """Where one patch is too weak to be felt for certain: what several would give."""
    if len(summary["patch"]) == 1 and any(b["feeling"]["felt"] != "yes" for b in summary["buttons"].values()):
        yield "Four patches at once play five to seven times as loud: haploop demo --rig four-channel."


def _strength(summary: Mapping[str, Any]) -> Iterator[str]:
    """How the answers move with the strength of the simulated table, which is an estimate."""
    if summary["simulation"]["plant"] != "table":
        return
    acts = [b["feeling"]["acts"]["pressing"] for b in summary["buttons"].values()]
    if any(one["above_threshold_db"] is None for one in acts):
        return
    # Levels grow with the strength as the motion does.
    yes = max(one["higher_db"] - one["above_threshold_db"] for one in acts)
    no = min(-one["lower_db"] - one["above_threshold_db"] for one in acts)
    yield (
        "The strength of the simulated table is an estimate too, 3 µm at 50 V: with "
        f"{10 ** (yes / 20):.2g} times that or more all these buttons would be felt, with "
        f"{10 ** (no / 20):.2g} times that or less none."
    )


_AS_IS = "on the carrier it is not known whether most people would feel it"
_TITLE = "From a press to a verified digital button"
_HEADINGS = (
    "Button", "Presses", "Force", "(true)", "Drive", "In band", "Error (95 %)", "Felt", "Loudness",
    "Verdict",
)  # fmt: skip
_EXPLAINED = (
    "In band: share of the press's energy, modulated or as recorded, within the band that is played. Error: "
    "of the motion up to the corner of the laser's filter, with its 95 % confidence interval. Felt: by most "
    "people who press. Loudness: beside the recorded press, both weighted with the threshold of a finger "
    "that presses."
)


def report(demo: Demo, summary: Mapping[str, Any], with_figures: bool) -> str:
    """Render the report of a run as HTML."""
    response = demo.calibration.response
    people = counted(summary["participants"], "participant")
    when = f"{datetime.fromisoformat(summary['date']):%Y-%m-%d %H:%M} UTC"
    lead = f"Rig “{demo.rig}”, {people}, patch {demo.patches} at the {response.point} point, {when}."
    table = calibration_contents(demo.calibration)
    known = [
        fact("True resonance", f"{demo.true_resonance_hz:.2f} Hz, of the simulated plant"),
        fact("Lowest coherence in the band of the drives", fixed(summary["coherence_min_in_band"], 4)),
    ]
    sections = [
        replace(demo_contents(summary), title="Results", notes=summary["notes"]),
        *(check_contents(one.check, one.press) for one in demo.buttons),
        replace(table, facts=[*table.facts, *known]),
        *_about(demo, summary),
    ]
    sources = [(r.path.name, r.content_hash) for b in demo.buttons for r in b.recordings]
    by = f"haploop figures {shlex.quote(str(demo.out))} --out figures"
    drawn = _captioned_figures(demo) if with_figures else ()
    return html.Page(_TITLE, lead, sections, drawn, sources, by).html()


def _about(demo: Demo, summary: Mapping[str, Any]) -> Iterator[Contents]:
    """How to read the numbers, what the run cannot show, and what it was made with."""
    left_out = [
        f"{capital(one.button)}, left out of the representative press: {press}"
        for one in demo.buttons
        for press in one.press.left_out
    ]
    shape = "The check compares the shape of the acceleration, at the scale stated with it."
    yield Contents("How to read the numbers", notes=[_ERRORS, _FELT])
    yield Contents("Limitations", notes=[*left_out, *demo.notes, shape])
    yield Contents(
        "Provenance",
        [
            fact("Rig file", demo.rig_file),
            fact("Simulation", f"{demo.mode}; {_listed(demo.simulation, ' = ')}"),
            fact("Software", _listed(summary["software"], " ")),
            fact("Folder", str(demo.out)),
        ],
    )


def _listed(values: Mapping[str, Any], mark: str) -> str:
    return ", ".join(f"{key}{mark}{value}" for key, value in values.items())


_ERRORS = (
    "Error is the root-mean-square difference between the measured motion, up to the corner of the laser's "
    "filter, and the target acceleration over the target's, without the noise of the plays, which is "
    "estimated from their differences; noise is what is left in the mean of the plays. A button passes when "
    "the upper end of the confidence interval is at most 20 %, fails when the lower end is above that, and "
    "is otherwise not shown to do either."
)
_FELT = (
    "Levels are energies in the loudest second, as long as the bursts of which the thresholds were measured, "
    "weighted with the threshold from 18 to 1122 Hz; a tone at threshold has 0 dB. Felt is yes where most "
    "people would feel it even if the threshold lay as high as it may, no where not even if it lay as low as "
    "it may, and otherwise not known. The thresholds, their sources and what is an estimate: "
    "docs/hardware.md, “Feeling a vibration”."
)


def _captioned_figures(demo: Demo) -> Sequence[html.CaptionedFigure]:
    """Draw the report's figures, each with a caption that names the corresponding figure of the paper."""
    results = demo.buttons
    response = demo.calibration.response
    forces = {r.button: r.forces for r in results if r.forces}
    truth = {r.button: float(np.mean(r.true_forces)) for r in results if r.true_forces}
    drawn = (
        (
            figures.profiles([figures.Profile.of(r.press) for r in results]),
            "Representative press of each button",
            f"{words.PRESSES} Light blue: one standard deviation of the aligned presses. {_counts(demo)}",
        ),
        (
            figures.activation_forces(forces, truth),
            "Force at activation",
            f"{words.FORCES} The black lines are the true values of the simulated plant. {_counts(demo)}",
        ),
        (
            figures.response(demo.calibration, demo.true_response),
            f"The table's response, patch {response.patch} to the button point",
            f"{words.RESPONSE} Dashed: the true response of the plant without patch hysteresis. "
            f"n = {response.repeats} repeats.",
        ),
        (
            figures.drives([r.check.drive for r in results], demo.limits),
            f"The drives at patch {demo.patches}",
            f"{words.DRIVES} {_modulated(results)} divided by the response, as large as the limits allow.",
        ),
        (
            figures.comparison([(r.press, r.check) for r in results]),
            "Measured motion of the table",
            f"{words.COMPARISON} n = {results[0].check.plays} plays of each drive.",
        ),
        (
            figures.feeling_figure([(r.button, check_feeling(r.check, r.press)) for r in results]),
            "What a finger would feel",
            f"{words.FEELING} n = {results[0].check.plays} plays of each drive.",
        ),
    )
    return [html.CaptionedFigure(*one, simulated=True) for one in drawn]


def _modulated(results: Sequence[ButtonResult]) -> str:
    """How the presses were played, as the beginning of a sentence."""
    told = []
    for one in results:
        carrier = one.check.drive.carrier_hz
        told.append(f"{one.button} {f'modulated onto {carrier:.2f} Hz' if carrier else 'as recorded'}")
    return f"{capital(', '.join(told))};"


def _counts(demo: Demo) -> str:
    participants = len(demo.buttons[0].recordings)
    told = ", ".join(f"{r.button} n = {r.press.members}" for r in demo.buttons)
    return f"{capital(told)} presses by {participants} participant{'' if participants == 1 else 's'}."


def _software() -> dict[str, str]:
    packages = ("haploop", "numpy", "scipy", "h5py", "nidaqmx", "dtaidistance", "matplotlib")
    return {**{name: metadata.version(name) for name in packages}, "python": platform.python_version()}
