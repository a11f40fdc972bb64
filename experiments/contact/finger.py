"""Finger calibration: contact areas of light and of firm presses, and the area that activates each button."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ...base.errors import DataError
from ...instruments import Touch
from .area import Contact, SeenSurface

LEAST_RATIO = 1.3
"""Smallest A_max over A_min with which three buttons can be told apart (our choice)."""
MOST_SCATTER = 0.25
"""Largest standard deviation of the presses of one kind, over their mean (our choice)."""
_SHARE = (0.25, 0.75)
"""Where between A_min and A_max the buttons with the smallest and the largest force activate."""
_TIMEOUT = 10.0
"""s to wait for a press, and for its end."""


@dataclass(frozen=True)
class FingerCalibration:
    """Contact areas of one participant (m^2)."""

    participant: str
    light: tuple[float, ...]
    firm: tuple[float, ...]

    @property
    def a_min(self) -> float:
        """Mean area of the light presses (m^2)."""
        return float(np.mean(self.light))

    @property
    def a_max(self) -> float:
        """Mean area of the firm presses (m^2)."""
        return float(np.mean(self.firm))

    @property
    def scatter(self) -> tuple[float, float]:
        """Standard deviation over mean, of light and of firm presses: their repeatability."""
        light, firm = (float(np.std(a, ddof=1) / np.mean(a)) for a in (self.light, self.firm))
        return light, firm

    @property
    def problem(self) -> str:
        """Why it cannot be used, as a sentence; empty when it can."""
        again = "repeat the finger calibration"
        if min(len(self.light), len(self.firm)) < 2:
            return f"Two light and two firm presses of {self.participant} are needed at least: {again}."
        for name, scatter in zip(("light", "firm"), self.scatter, strict=True):
            if scatter > MOST_SCATTER:
                return f"The {name} presses of {self.participant} scatter by {100 * scatter:.0f} %: {again}."
        if self.a_max < LEAST_RATIO * self.a_min:
            return (
                f"The firm presses of {self.participant} make {self.a_max / self.a_min:.2f} times the "
                "area of the "
                f"light ones, and {LEAST_RATIO:g} times is needed: {again}."
            )
        within = math.hypot(float(np.std(self.light, ddof=1)), float(np.std(self.firm, ddof=1)))
        if self.a_max - self.a_min < 2 * within:
            return f"Light and firm presses of {self.participant} overlap: {again}."
        return ""


def calibrate_finger(
    seen: SeenSurface,
    participant: str,
    presses: int = 5,
    timeout: float = _TIMEOUT,
    on_press: Callable[[str, int, float], None] = lambda _pressure, _number, _area: None,
) -> FingerCalibration:
    """Ask for light presses and then for as many firm ones, and measure the largest area of each.

    `on_press(pressure, number, area)` is called after each. Raises DataError: a press
    whose images are not usable, none within `timeout` (s), or a calibration that is not usable. Raises
    InstrumentError.
    """
    areas: dict[str, list[float]] = {"light": [], "firm": []}
    pressures: tuple[Literal["light", "firm"], ...] = ("light", "firm")
    for pressure in pressures:
        for number in range(1, presses + 1):
            area = press_area(seen, Touch(participant, pressure, number, presses), timeout)
            areas[pressure].append(area)
            on_press(pressure, number, area)
    found = FingerCalibration(participant, tuple(areas["light"]), tuple(areas["firm"]))
    if found.problem:
        raise DataError(found.problem)
    return found


def press_area(seen: SeenSurface, asked: Touch, timeout: float = _TIMEOUT) -> float:
    """Ask for a press of the surface, and return the area (m^2) at which it rests.

    Raises DataError for one whose images are not usable, or none within `timeout` (s); InstrumentError.
    """
    seen.skip()
    seen.rig.operator.tell(asked)
    contacts = watch_touch(seen, timeout)
    problem = next((contact.problem for contact in contacts if contact.problem), "")
    if problem:
        raise DataError(f"A {asked.pressure} press of {asked.participant} cannot be measured. {problem}")
    areas = np.array([contact.area for contact in contacts])
    return float(np.median(areas[areas > 0.9 * areas.max()]))


def watch_touch(seen: SeenSurface, timeout: float = _TIMEOUT) -> list[Contact]:
    """Contacts of the next press, first frame to last. Raises DataError without one in `timeout` (s)."""
    contacts: list[Contact] = []
    first = None
    while True:
        contact = seen.contact()
        first = contact.time if first is None else first
        if contact.area > 0:
            contacts.append(contact)
        elif contacts:
            return contacts
        if contact.time - first > timeout:
            what = "did not end" if contacts else "did not come"
            problem = next((one.problem for one in contacts if one.problem), "")
            raise DataError(f"A press {what} within {timeout:g} s. {problem or 'Ask the participant again.'}")


def activation_areas(calibration: FingerCalibration, forces: Mapping[str, float]) -> dict[str, float]:
    """Contact area (m^2) that activates each button, from its mean force at activation (N) when recorded.

    Linear in the force between the participant's A_min and A_max, as in the paper: the button with the
    smallest force (its toggle) activates at a quarter of the way, that with the largest (its latch) at three
    quarters. The paper's figure 10 has the conditions, its text does not: where on the way is our choice.
    Raises DataError for forces that are not positive.
    """
    if not forces or not all(math.isfinite(force) and force > 0 for force in forces.values()):
        raise DataError("Activation areas need a positive mean force for each button: record presses first.")
    low, high = min(forces.values()), max(forces.values())
    areas = {}
    for name, force in forces.items():
        share = 0.5 if high == low else _SHARE[0] + (_SHARE[1] - _SHARE[0]) * (force - low) / (high - low)
        areas[name] = calibration.a_min + share * (calibration.a_max - calibration.a_min)
    return areas
