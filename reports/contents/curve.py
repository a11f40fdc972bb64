"""What a force-travel curve says."""

from __future__ import annotations

from collections.abc import Iterator

from ...exchange.importing import Curve, Point, Understanding, curve_of
from .. import figures
from . import captions
from .parts import Contents, Drawing, Fact, fact


def curve_contents(found: Understanding) -> Contents:
    """What a file with a force-travel curve says. Raises ConfigurationError and DataError."""
    curve = curve_of(found)
    return Contents(
        f"Force over travel in {found.path.name}",
        [
            fact("File", str(found.path), file=found.path),
            fact("Understood", list(found.notes), notes=found.notes),
            *_points(curve),
            fact("Snap ratio", _percent(curve.snap_ratio), snap_ratio=curve.snap_ratio),
            fact(
                "Work lost",
                None if curve.lost is None else f"{1e3 * curve.lost:.3g} mJ between the strokes",
                lost_j=curve.lost,
            ),
        ],
        kind="curve",
        picture=Drawing.alone(
            "curve",
            "Force over travel",
            captions.TRAVEL,
            lambda columns: figures.curve_figure(curve, columns),
            found.path.name,
        ),
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
