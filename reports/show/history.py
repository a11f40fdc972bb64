"""Contents of a rig's calibration history, and of its generations, as tables and as JSON values."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime
from typing import Any

from rich.box import SIMPLE
from rich.table import Table

from ...calibration import Calibration
from ...calibration.upkeep import Generation, History, PlaceMetrics, buttons_of, calibrations_of
from .formatting import damping

__all__ = ["describe", "difference", "listing", "simulated"]

Place = tuple[str, str]

_METRICS = (
    # Metric, its label, and the factor to the label's unit.
    ("resonance_hz", "Resonance (Hz)", 1.0),
    ("damping", "Damping ratio (%)", 100.0),
    ("gain", "Gain (m/s² per V)", 1.0),
    ("coherence", "Coherence", 1.0),
)


def listing(history: History) -> tuple[dict[str, Any], Table]:
    """List every generation, and mark the active one."""
    activations = history.activations
    active = activations[-1].generation if activations else ""
    generations = history.generations
    values = {
        "folder": str(history.folder),
        "active": active or None,
        "generations": [
            {
                "name": g.name,
                "created": g.created,
                "parent": g.parent or None,
                "reason": g.reason,
                "buttons": [path.stem for path in g.paths("buttons")],
                "active": g.name == active,
                "activations": [vars(a) for a in activations if a.generation == g.name],
            }
            for g in generations
        ],
        "looks": len(history.looks),
    }
    table = Table(box=SIMPLE, title=f"Calibrations in {history.folder}", title_justify="left")
    for heading in ("", "Calibration", "Made", "From", "Buttons", "Why"):
        table.add_column(heading)
    for g in generations:
        table.add_row(
            "active" if g.name == active else "",
            g.name,
            f"{datetime.fromisoformat(g.created):%Y-%m-%d %H:%M} UTC",
            g.parent.partition("-")[0],
            str(len(g.paths("buttons"))),
            g.reason,
        )
    return values, table


def describe(history: History, generation: Generation) -> tuple[dict[str, Any], Table]:
    """Verify and describe a generation: places, buttons, reason, and periods of activity.

    Raises DataError when it is incomplete or damaged.
    """
    generation.verify()
    calibrations, buttons = calibrations_of(generation), buttons_of(generation)
    activations = [a for a in history.activations if a.generation == generation.name]
    values = {
        "name": generation.name,
        "created": generation.created,
        "parent": generation.parent or None,
        "reason": generation.reason,
        "simulated": any(c.response.simulated for c in calibrations),
        "rig": calibrations[0].response.rig,
        "places": {"-".join(_place(c)): vars(PlaceMetrics.of(c)) for c in calibrations},
        "buttons": {
            name: {
                "drive_peak_v": float(b.drive.peak),
                **b.check.summary(),
            }
            for name, b in buttons.items()
        },
        "activations": [vars(a) for a in activations],
        "digest": generation.digest,
    }
    table = Table(box=SIMPLE, title=f"Calibration {generation.name}", title_justify="left", show_header=False)
    table.add_column(style="dim")
    table.add_column()
    table.add_row("Rig", calibrations[0].response.rig)
    table.add_row("Why", generation.reason)
    table.add_row("Made from", generation.parent or "nothing before it")
    for c in calibrations:
        f = PlaceMetrics.of(c)
        told = (
            f"{f.resonance_hz:.2f} Hz, damping {damping(c.model.carriers[0])}, gain {f.gain:.3g} m/s² per V, "
            f"coherence {f.coherence:.4f}"
        )
        table.add_row(f"Patch {c.response.patch}, {c.response.point}", told)
    for name, b in buttons.items():
        table.add_row(name, str(b.check))
    for a in activations:
        table.add_row("Activated", f"{a.when} by {a.actor}: {a.reason}")
    return values, table


def difference(one: Generation, other: Generation) -> tuple[dict[str, Any], Table]:
    """Compare two generations. Raises DataError when one is incomplete or damaged."""
    one.verify()
    other.verify()
    places = [{_place(c): PlaceMetrics.of(c) for c in calibrations_of(g)} for g in (one, other)]
    buttons = [buttons_of(g) for g in (one, other)]
    table = Table(box=SIMPLE, title=f"From {one.name} to {other.name}", title_justify="left")
    for heading in ("", "Before", "After", "Change"):
        table.add_column(heading, justify="left" if not heading else "right")
    values: dict[str, Any] = {"from": one.name, "to": other.name, "places": {}, "buttons": {}}
    for place in sorted({*places[0], *places[1]}):
        was, now = (vars(found[place]) if place in found else None for found in places)
        values["places"]["-".join(place)] = {"from": was, "to": now}
        for name, label, factor in _METRICS:
            numbers = [None if f is None else factor * f[name] for f in (was, now)]
            table.add_row(f"{place[0]} at {place[1]}: {label}", *_row(numbers))
    for key in sorted({*buttons[0], *buttons[1]}):
        checks = [b[key].check if key in b else None for b in buttons]
        was, now = (None if c is None else c.summary() for c in checks)
        values["buttons"][key] = {"from": was, "to": now}
        errors = [None if c is None else 100 * float(c.wideband_nrmse) for c in checks]
        table.add_row(f"{key}: error of the whole motion (%)", *_row(errors))
    return values, table


def simulated(history: History) -> bool:
    """True when anything in a history was measured on a simulated rig."""
    latest = history.generations[-1:]
    return any(c.response.simulated for generation in latest for c in calibrations_of(generation))


def _row(numbers: Sequence[float | None]) -> tuple[str, str, str]:
    told = ["none" if number is None else f"{number:.4g}" for number in numbers]
    was, now = numbers
    change = f"{now / was - 1:+.2%}" if was and now is not None else ""
    return told[0], told[1], change


def _place(calibration: Calibration) -> Place:
    return calibration.response.patch, calibration.response.point
