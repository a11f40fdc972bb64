"""Presents a session's stimuli on a touch surface, and writes what happened into the session's log."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, Protocol

from ...base.errors import DataError
from ...instruments import Touch
from ..contact import (
    Activator,
    FingerCalibration,
    Played,
    Rendering,
    activation_areas,
    press_area,
    run_button,
)
from ..protocol import Assignment, ExperimentFile, Step, digital_button, played_by_rig
from ..session import Event
from .surface import TouchSurface

_ATTEMPTS = 3
"""Times that a press of the finger calibration, and the whole of it, is tried."""
_TIMEOUT = 120.0
"""s to wait for a press that activates a button."""
_LIFTED = 0.5
"""Share of A_min below which a finger counts as lifted."""


class Logged(Protocol):
    """What is used of a `Session`."""

    @property
    def assignment(self) -> Assignment:
        """Who takes part."""
        ...

    @property
    def events(self) -> Sequence[Event]:
        """All events so far."""
        ...

    def event(self, kind: str, **details: Any) -> None:
        """Log an event."""
        ...


class Presenter:
    """See the module. For the sessions of any participant, one after the other.

    Events: `surface` (rig, camera and buttons, when they are new), `contact` (area of a press of the finger
    calibration), `finger` (the calibration, or why it is refused), `touch` (a press that is asked for),
    `activation` (what was played, with its latency). Areas are in m^2, times in s of the rig's clock.
    """

    def __init__(self, surface: TouchSurface, file: ExperimentFile) -> None:
        self._surface, self._file = surface, file

    def presents(self, step: Step) -> bool:
        """See `haploop.experiments.session.Presents`."""
        return played_by_rig(self._file, step)

    def present(self, session: Logged, step: Step) -> None:
        """See `haploop.experiments.session.Presents`.

        Raises DataError: no press came, or a finger calibration that is not usable after three attempts. The
        step stays due. Raises what `Rig.excite` raises.
        """
        before = [event.values for event in session.events if event.kind == "surface"]
        if not before or dict(before[-1]) != self._surface.noted:
            session.event("surface", **self._surface.noted)
        if step.kind == "finger":
            self._finger(session, step)
            return
        for number, scale in enumerate(step.values if step.compares else (1.0,), 1):
            self._button(session, step, digital_button(self._file, step), scale, number)

    def _finger(self, session: Logged, step: Step) -> None:
        """Measure the press of this step; at the last one, judge them all and repeat them if need be."""
        surface, participant, half = self._surface, session.assignment.participant, step.of // 2
        for _ in range(_ATTEMPTS):
            while (number := len(_areas(session.events, step.block)) + 1) <= step.number:
                pressure: Literal["light", "firm"] = "light" if number <= half else "firm"
                asked = Touch(participant, pressure, (number - 1) % half + 1, half)
                area = self._press(session, step, asked)
                session.event("contact", block=step.block, press=pressure, area=area)
            if step.number < step.of:
                return
            areas = _areas(session.events, step.block)
            finger = FingerCalibration(participant, tuple(areas[:half]), tuple(areas[half:]))
            session.event(
                "finger",
                block=step.block,
                a_min=finger.a_min,
                a_max=finger.a_max,
                scatter=list(finger.scatter),
                areas=activation_areas(finger, surface.forces),
                problem=finger.problem,
            )
            if not finger.problem:
                return
        raise DataError(f"{finger.problem} It was tried {_ATTEMPTS} times.")

    def _press(self, session: Logged, step: Step, asked: Touch) -> float:
        surface = self._surface
        for attempt in range(1, _ATTEMPTS + 1):
            try:
                return press_area(surface.seen, asked)
            except DataError as error:
                session.event("contact refused", block=step.block, problem=str(error))
                if attempt == _ATTEMPTS:
                    raise
        raise AssertionError

    def _button(self, session: Logged, step: Step, name: str, scale: float, interval: int) -> None:
        surface, participant = self._surface, session.assignment.participant
        finger = fingers_in(session.events)
        if finger is None:
            raise DataError(f"The finger of {participant} was not calibrated: begin with that block.")
        area, release = finger["areas"][name], surface.releases.get(name)
        where = {"block": step.block, "trial": step.number, "interval": interval}

        def ask() -> None:
            session.event("touch", **where)
            surface.seen.rig.operator.tell(Touch(participant, "as a button", 1, 1))

        played = run_button(
            surface.seen,
            Rendering(surface.buttons[name], release, scale),
            Activator(area, _LIFTED * finger["a_min"], None if release is None else finger["a_min"]),
            timeout=_TIMEOUT,
            ask=ask,
        )
        for one in played:
            session.event("activation", **where, button=name, threshold=area, **_values(one))


def fingers_in(events: Sequence[Event]) -> dict[str, Any] | None:
    """The values of the newest usable finger calibration (`finger`); None without one."""
    found = [dict(event.values) for event in events if event.kind == "finger" and not event.values["problem"]]
    return found[-1] if found else None


def _areas(events: Sequence[Event], block: str) -> list[float]:
    """Areas (m^2) of the finger calibration that goes on in a block, in order."""
    found: list[float] = []
    for event in events:
        if event.values.get("block") != block:
            continue
        if event.kind == "contact":
            found.append(event.values["area"])
        elif event.kind == "finger" and event.values["problem"]:
            found.clear()
    return found


def _values(one: Played) -> dict[str, Any]:
    return {
        "press": one.kind,
        "area": one.contact.area,
        "frame": one.contact.number,
        "frame_time": one.contact.time,
        "latency": one.latency,
        "onset": one.onset,
        "scale": one.scale,
        "force": one.force,
        "made_for": one.made_for,
    }
