"""What a vibration map says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...calibration.map import VibrationMap
from .. import figures
from . import words
from .parts import Contents, Drawing, Verdict, fact
from .words import percent

_MICRO = 1e6
_MODES = 8
"""Modes that are listed."""


def map_contents(found: VibrationMap) -> Contents:
    """What a vibration map says: its best point for each patch, its modes, and how well they fit."""
    plan, residual, modes = found.plan, float(np.sqrt(np.mean(found.residual**2))), found.resonances()
    best, each = _best(found), [_best(found, [name]) for name in found.configurations]
    done, planned = len(found.points), len(plan.points)
    played = "all patches at once" if plan.together else "one patch at a time"
    superposed = ", ".join(f"{share:.2%} at point {point}" for point, share in found.superposition)
    drift = f"{np.abs(found.drift).max():.3%} at most" if len(found.drift) else ""
    facts = [
        fact(
            "Points",
            f"{done} of {planned} measured, x {', '.join(plan.patches)}",
            rig=plan.rig,
            points_measured=done,
            points_planned=planned,
            patches=plan.patches,
        ),
        fact("Played", played, together=plan.together),
        fact(
            "Measurement time",
            f"{found.table_seconds / 60:.1f} min at {plan.level:.1f} V peak",
            table_s=round(found.table_seconds, 3),
            level_v=plan.level,
        ),
        fact("Best", f"patch {best['patch']}, {_sentence(best)}", best=best),
        *(fact(f"  {one['patch']}", _sentence(one)) for one in each),
        fact(best_of={one["patch"]: {name: one[name] for name in one if name != "patch"} for one in each}),
        fact(
            "Modes",
            f"{', '.join(f'{hz:.1f}' for hz, _ in modes[:_MODES])} Hz, strongest first",
            modes=[{"frequency_hz": hz, "damping": damping} for hz, damping in modes],
        ),
        fact("Residual of the modal fit", f"{residual:.2%} of the measured velocity", residual=residual),
        fact("Superposition error", superposed, superposition=dict(found.superposition)),
        fact("Drift of frequencies", drift, drift=found.drift),
        *(fact(f"Skipped: {point}", reason) for point, reason in found.skipped),
        fact(skipped=dict(found.skipped)),
    ]
    verdict = Verdict(
        "Vibration map",
        "complete" if done == planned else "incomplete",
        done == planned,
        f"{done} of {planned} points; residual {percent(residual)}",
        " ".join(f"Point {point}: {reason}" for point, reason in found.skipped),
    )
    drawing = Drawing.alone(
        "map",
        "Vibration map",
        words.MAP,
        lambda columns: figures.map_figure(found, columns),
        f"n = {done} of {plan.rows * plan.columns} points, at {plan.level:.1f} V peak.",
    )
    return Contents(
        f"Vibration map of the rig {plan.rig}",
        facts,
        kind="map",
        simulated=plan.simulated,
        rig=plan.rig,
        verdicts=[verdict],
        figures=[drawing],
    )


def _best(found: VibrationMap, patches: Sequence[str] | None = None) -> dict[str, Any]:
    one = found.best(patches=patches)
    return {
        "patch": one.patch,
        "point": one.point,
        "frequency_hz": one.frequency_hz,
        "displacement_m_per_v": one.displacement,
    }


def _sentence(best: Mapping[str, Any]) -> str:
    micrometres = _MICRO * best["displacement_m_per_v"]
    return f"{best['frequency_hz']:.1f} Hz, point {best['point']}: {micrometres:.4f} µm per V"
