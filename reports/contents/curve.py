"""What a force-travel curve says."""

from __future__ import annotations

from collections.abc import Iterator

from ...acquisition.presses import Curve, Point
from .. import figures
from . import words
from .parts import Contents, Drawing, Fact, fact
from .words import sentence


def curve_contents(curve: Curve) -> Contents:
    """What a force-travel curve says."""
    where = f"{curve.source}, SHA-256 {curve.source_sha256}"
    units = ", ".join(f"{role} in {unit}" for role, unit in curve.units.items())
    return Contents(
        f"Force over travel of {curve.button}",
        [
            fact("From", where, button=curve.button, source=curve.source, source_sha256=curve.source_sha256),
            fact("Units", units, units=curve.units),
            fact("Understood", list(curve.notes), notes=curve.notes),
            *_points(curve),
            fact("Snap ratio", _percent(curve.snap_ratio), snap_ratio=curve.snap_ratio),
            fact(
                "Work lost",
                None if curve.lost is None else f"{1e3 * curve.lost:.3g} mJ between the strokes",
                lost_j=curve.lost,
            ),
        ],
        kind="curve",
        simulated=curve.simulated or None,
        figures=[
            Drawing(
                "curves",
                "Force over travel",
                words.CURVES,
                [curve],
                lambda some, columns: figures.curves_figure(some, columns),  # noqa: PLW0108 - loads matplotlib
                lambda some: sentence([one.button for one in some]),
                identity=(curve.source_sha256, curve.button),
                several=6,
            )
        ],
    )


def _points(curve: Curve) -> Iterator[Fact]:
    hysteresis = None
    if curve.operates is not None and curve.resets is not None:
        hysteresis = curve.operates.travel - curve.resets.travel
    for label, key, point in (
        ("Operating point", "operates", curve.operates),
        ("Reset point", "resets", curve.resets),
        ("Tactile peak", "peak", curve.peak),
        ("Tactile trough", "trough", curve.trough),
        ("Bottom-out", "bottom", curve.bottom),
        ("End of travel", "end", curve.end),
    ):
        values = {} if point is None else {f"{key}_travel_m": point.travel, f"{key}_force_n": point.force}
        yield fact(label, None if point is None else _words(point), **values)
    yield fact(
        "Hysteresis",
        None if hysteresis is None else f"{1e3 * hysteresis:.3f} mm from operating to reset point",
        hysteresis_m=hysteresis,
    )


def _words(point: Point) -> str:
    return f"{1e3 * point.travel:.3f} mm at {point.force:.3f} N"


def _percent(share: float | None) -> str | None:
    return None if share is None else f"{100 * share:.1f} %"
