"""What a representative press says."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...acquisition import Representative
from .. import figures
from . import words
from .parts import Contents, Drawing, fact
from .words import SENSORS, derived, sentence, told_by

_LISTED = 10
"""Most sentences of a kind in a table; JSON has all."""


def press_contents(press: Representative) -> Contents:
    """What a representative press says."""
    peak = float(np.max(np.abs(press.acceleration)))
    at = press.activation_index
    force = None if press.force is None else float(press.force[at])
    travel = None if press.travel is None else float(press.travel[at])
    duration = len(press.acceleration) / press.rate_hz
    undone = ""
    if press.undone_hz is not None:
        low, high = press.undone_hz
        undone = f"from {low:g} to {high:g} Hz; noise grew {press.noise_gain:.1f} times"
    method = f"{press.method}: {press.reason}" if press.reason else press.method
    facts = [
        fact("Stands for", _members(press), button=press.button, presses=press.members),
        fact(
            "Length",
            f"{1e3 * duration:.0f} ms at {press.rate_hz:g} Hz",
            duration_s=duration,
            rate_hz=press.rate_hz,
        ),
        fact(
            "Largest acceleration",
            f"{peak:.2f} m/s²{derived(press.motion)}",
            acceleration_peak=peak,
            motion=press.motion,
        ),
        fact("Force at activation", None if force is None else f"{force:.3f} N", activation_force_n=force),
        fact(
            "Travel at activation",
            None if travel is None else f"{1e3 * travel:.3f} mm",
            activation_travel_m=travel,
        ),
        fact("Activation", told_by(press.activated_by), activated_by=press.activated_by),
        fact("Bandwidth", _bandwidth(press), bandwidth_hz=press.bandwidth_hz),
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
        figures=[press_drawing(press), *travel_drawings(press)],
    )


def _members(press: Representative) -> str:
    """Of how many presses it is, and of how many recordings."""
    several = "s" * (len(press.sources) != 1)
    return f"{press.members} presses in {len(press.sources)} recording{several}"


def travel_drawings(press: Representative) -> list[Drawing]:
    """The figure of force over travel, of a press that has both."""
    if press.force is None or press.travel is None:
        return []
    return [
        Drawing(
            "travel",
            f"Force over travel of the {press.button} button",
            words.TRAVEL,
            [press],
            lambda some, columns: figures.force_over_travel(
                [figures.Profile.of(one) for one in some], columns=columns
            ),
            lambda some: sentence(
                [
                    f"{one.button}, mean of n = {one.members} presses, activation {told_by(one.activated_by)}"
                    for one in some
                ]
            ),
        )
    ]


def _activation(quantity: str) -> str:
    return "" if quantity == "activation" else f", activation {told_by(quantity)}"


def _bandwidth(press: Representative) -> str:
    whose = f"the {SENSORS.get(press.motion, 'sensor')}'s"
    if press.bandwidth_hz >= press.rate_hz / 2:
        whose = "half the sample rate"
    return f"{press.bandwidth_hz:.0f} Hz, {whose}"


def _shortened(sentences: Sequence[str]) -> list[str]:
    more = [f"and {len(sentences) - _LISTED} more"] if len(sentences) > _LISTED else []
    return [*sentences[:_LISTED], *more]


def press_drawing(press: Representative) -> Drawing:
    """The figure of a representative press."""
    return Drawing(
        "presses",
        "Representative presses",
        f"{words.PRESSES} Light blue: one standard deviation of the aligned presses.",
        [press],
        lambda some, columns: figures.profiles([figures.Profile.of(one) for one in some], columns),
        lambda some: sentence(
            [
                f"{one.button}, {one.method} of n = {_members(one)}"
                f"{derived(one.motion)}{_activation(one.activated_by)}"
                for one in some
            ]
        ),
        identity=(press.button, press.method, press.sources),
    )
