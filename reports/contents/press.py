"""What a representative press says."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...acquisition import Representative
from .. import figures
from . import captions
from .parts import Contents, Drawing, fact
from .words import sentence

__all__ = ["press_contents", "press_drawing"]

_LISTED = 10
"""Most sentences of a kind in a table; JSON has all."""


def press_contents(press: Representative) -> Contents:
    """What a representative press says."""
    peak, force = float(np.max(np.abs(press.acceleration))), float(press.force[press.activation_index])
    duration = len(press.acceleration) / press.rate_hz
    undone = ""
    if press.undone_hz is not None:
        low, high = press.undone_hz
        undone = f"from {low:g} to {high:g} Hz; noise grew {press.noise_gain:.1f} times"
    stands_for = f"{press.members} presses in {len(press.sources)} recordings"
    method = f"{press.method}: {press.reason}" if press.reason else press.method
    facts = [
        fact("Stands for", stands_for, button=press.button, presses=press.members),
        fact(
            "Length",
            f"{1e3 * duration:.0f} ms at {press.rate_hz:g} Hz",
            duration_s=duration,
            rate_hz=press.rate_hz,
        ),
        fact("Largest acceleration", f"{peak:.2f} m/s²", acceleration_peak=peak),
        fact("Force at activation", f"{force:.3f} N", activation_force_n=force),
        fact("Bandwidth", f"{press.bandwidth_hz:g} Hz, the accelerometer's", bandwidth_hz=press.bandwidth_hz),
        fact("Undone", undone, undone_hz=press.undone_hz, noise_gain=press.noise_gain),
        fact(
            "Method",
            [method, *(f"{name} leaves {score:.1%}" for name, score in press.scores.items())],
            method=press.method,
            reason=press.reason,
            scores=press.scores,
        ),
        fact("Left out", _shortened(press.left_out), left_out=list(press.left_out)),
        fact("Corrected", _shortened(press.corrected), corrected=list(press.corrected)),
        fact(sources=[{"file": name, "sha256": content} for name, content in press.sources]),
    ]
    return Contents(
        f"Representative press of the {press.button} button",
        facts,
        kind="representative",
        simulated=press.simulated,
        figures=[press_drawing(press)],
    )


def _shortened(sentences: Sequence[str]) -> list[str]:
    more = [f"and {len(sentences) - _LISTED} more"] if len(sentences) > _LISTED else []
    return [*sentences[:_LISTED], *more]


def press_drawing(press: Representative) -> Drawing:
    """The figure of a representative press."""
    return Drawing(
        "presses",
        "Representative presses",
        f"{captions.PRESSES} The band is one standard deviation of the aligned presses.",
        [press],
        lambda some, columns: figures.profiles([figures.Profile.of(one) for one in some], columns),
        lambda some: sentence(
            [
                f"{one.button}, {one.method} of n = {one.members} presses in {len(one.sources)} recordings"
                for one in some
            ]
        ),
        identity=(press.button, press.method, press.sources),
    )
