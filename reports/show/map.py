"""Contents of a vibration map, as a table and as JSON values."""

from __future__ import annotations

from typing import Any

import numpy as np
from rich.box import SIMPLE
from rich.table import Table

from ...calibration.map import VibrationMap

__all__ = ["map_contents"]

_MICRO = 1e6


def map_contents(found: VibrationMap) -> tuple[dict[str, Any], Table]:
    """Return the contents as JSON values and as a table."""
    plan, best = found.plan, found.best()
    each = [found.best(patches=[name]) for name in found.configurations]
    values: dict[str, Any] = {
        "kind": "map",
        "simulated": plan.simulated,
        "rig": plan.rig,
        "points_measured": len(found.points),
        "points_planned": len(plan.points),
        "skipped": dict(found.skipped),
        "patches": list(plan.patches),
        "together": plan.together,
        "level_v": plan.level,
        "table_s": round(found.table_seconds, 3),
        "best": {
            "patch": best.patch,
            "point": best.point,
            "frequency_hz": best.frequency_hz,
            "displacement_m_per_v": best.displacement,
        },
        "best_of": {
            one.patch: {
                "point": one.point,
                "frequency_hz": one.frequency_hz,
                "displacement_m_per_v": one.displacement,
            }
            for one in each
        },
        "modes": [{"frequency_hz": hz, "damping": damping} for hz, damping in found.resonances()],
        "residual": float(np.sqrt(np.mean(found.residual**2))),
        "superposition": dict(found.superposition),
        "drift": [float(shift) for shift in found.drift],
    }
    table = Table(
        box=SIMPLE, title=f"Vibration map of the rig {plan.rig}", title_justify="left", show_header=False
    )
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    table.add_row(
        "Points", f"{len(found.points)} of {len(plan.points)} measured, x {', '.join(plan.patches)}"
    )
    table.add_row("Played", "all patches at once" if plan.together else "one patch at a time")
    table.add_row("Measurement time", f"{found.table_seconds / 60:.1f} min at {plan.level:.1f} V peak")
    table.add_row("Best", _sentence(best.patch, best.point, best.frequency_hz, best.displacement))
    for one in each:
        table.add_row(f"  {one.patch}", _sentence("", one.point, one.frequency_hz, one.displacement))
    table.add_row(
        "Modes", ", ".join(f"{hz:.1f}" for hz, _ in found.resonances()[:8]) + " Hz, strongest first"
    )
    table.add_row("Residual of the modal fit", f"{values['residual']:.2%} of the measured velocity")
    if found.superposition:
        told = ", ".join(f"{share:.2%} at point {point}" for point, share in found.superposition)
        table.add_row("Superposition error", told)
    if len(found.drift):
        table.add_row("Drift of frequencies", f"{np.abs(found.drift).max():.3%} at most")
    for point, reason in found.skipped:
        table.add_row(f"Skipped: {point}", reason)
    return values, table


def _sentence(patch: str, point: str, hz: float, displacement: float) -> str:
    named = f"patch {patch}, " if patch else ""
    return f"{named}{hz:.1f} Hz, point {point}: {displacement * _MICRO:.4f} µm per V"
