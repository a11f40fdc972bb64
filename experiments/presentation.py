"""The rig's part in an experiment: a touch surface that measures fingers and plays digital buttons.

The surface is prepared for a participant (camera calibrated, every digital button verified), presents a
session's stimuli, and writes what happened into the session's log. A new experiment from an example names
the digital buttons that the rig plays in it.
"""

from __future__ import annotations

import re
import shutil
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol

from ..acquisition import Representative
from ..base.errors import ConfigurationError, DataError, LimitError
from ..base.files import beside, check_destination, new_file
from ..base.progress import Progress, silent
from ..calibration import DigitalButton
from ..instruments import Camera, Rig, Touch
from ..instruments.operator import Request, TakeTarget, Target
from .contact import (
    Activator,
    FingerCalibration,
    Played,
    Rendering,
    SeenSurface,
    VerifiedButton,
    activation_areas,
    calibrate_meter,
    learn_background,
    press_area,
    run_button,
    verify_button,
)
from .protocol import (
    Assignment,
    Experiment,
    ExperimentFile,
    Step,
    digital_button,
    load_experiment,
    played_by_rig,
)
from .session import Event

_FRAMES = 10
"""Frames of the target."""


@dataclass(frozen=True, eq=False)
class TouchSurface:
    """See the module. Made by `prepare_surface`, for one rig, while it is open, for today."""

    seen: SeenSurface
    buttons: Mapping[str, VerifiedButton]
    releases: Mapping[str, VerifiedButton]

    @property
    def forces(self) -> dict[str, float]:
        """Mean force (N) at activation of each button's recorded presses. Raises DataError without any."""
        presses = {name: one.button.press for name, one in self.buttons.items()}
        return {name: _force_of(name, press) for name, press in presses.items()}

    @property
    def noted(self) -> dict[str, Any]:
        """What a session's log says of it, as values of JSON."""
        return {
            "rig": self.seen.rig.name,
            "rig_simulated": self.seen.rig.simulated,
            "camera": self.seen.camera.identity,
            "camera_hz": self.seen.camera.rate_hz,
            "pixel": self.seen.meter.square_metres,
            "buttons": {name: _noted(one) for name, one in self.buttons.items()},
            "releases": {name: _noted(one) for name, one in self.releases.items()},
        }


def _force_of(name: str, press: Representative) -> float:
    if press.force is None:
        raise DataError(
            f"The presses of the digital button {name!r} were recorded without a force, from which its "
            "contact area follows: record them with [sensors.force]."
        )
    return float(press.force[press.activation_index])


def prepare_surface(rig: Rig, experiment: Experiment, progress: Progress = silent) -> TouchSurface:
    """Verify each digital button of an experiment, and calibrate the camera with the target.

    The laser is aimed where the buttons were made. Raises ConfigurationError: no buttons in the experiment,
    no camera in the rig, or a button of another rig; LimitError: an amplitude that is to be compared would
    break a limit; DataError: a file, a check or an image that is not usable; InstrumentError.
    """
    file = experiment.file
    if not file.buttons:
        raise ConfigurationError(f"{experiment.path} has no [buttons]: list the digital buttons to play.")
    camera = rig.role(Camera)
    folder = experiment.path.parent
    loaded, released = (
        {
            name: DigitalButton.load(beside(folder, place, str(experiment.path)))
            for name, place in files.items()
        }
        for files in (file.buttons, file.surface.releases)
    )
    for name, button in loaded.items():
        _refuse_amplitudes(rig, experiment, name, button)
    buttons = {name: verify_button(rig, button, progress=progress) for name, button in loaded.items()}
    releases = {name: verify_button(rig, button, progress=progress) for name, button in released.items()}
    _ask(rig, TakeTarget())
    camera.start()
    background = learn_background(camera)
    _ask(rig, Target(file.surface.target))
    camera.start()
    meter = calibrate_meter([camera.read() for _ in range(_FRAMES)], background, file.surface.target)
    _ask(rig, TakeTarget())
    camera.start()
    return TouchSurface(SeenSurface(rig, camera, meter), buttons, releases)


def _refuse_amplitudes(rig: Rig, experiment: Experiment, name: str, button: DigitalButton) -> None:
    """Before anybody comes, not in the trial in which it would be played."""
    comparison = experiment.file.comparison
    if comparison is None:
        return
    largest = max(comparison.standard, comparison.highest or 0.0, *comparison.levels, 0.0)
    drives = [button.drive, *(button.pressed.drives if button.pressed else ())]
    each = [rig.limits.headroom(own, drive.rate_hz) for drive in drives for own in drive.volts]
    room, binding = min(each)
    if largest > room:
        raise LimitError(
            f"{experiment.path} compares up to {largest:g} times the drive of the digital {name}, and the "
            f"rig plays {room:.3g} times ({binding}): change the values in [comparison]."
        )


def _ask(rig: Rig, request: Request) -> None:
    if not rig.operator.confirm(request):
        raise DataError(f"This was not confirmed: {request} Begin again.")


def _noted(one: VerifiedButton) -> dict[str, Any]:
    return {
        "digest": one.button.digest,
        "button": one.button.press.button,
        "verified": one.date,
        "error": one.check.error,
        "left_out": one.left_out,
        "finger": one.pressed.participant if one.pressed else None,
        "force_sensor": one.rig.table.force,
    }


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


def new_experiment(folder: str | Path, example: str | Path, buttons: Sequence[str | Path] = ()) -> None:
    """Copy an example's file into a folder as `experiment.toml`, and its digital buttons beside it.

    With `buttons` the lines of the example that begin with "#:" are taken in: they make the rig play them.
    Each button must have the name of one that the example lists; if it lists one, any button will do.
    Raises ConfigurationError: other buttons than the example's, or a file that exists; DataError.
    """
    path, source = Path(folder) / "experiment.toml", load_experiment(example).path
    text = source.read_text(encoding="utf-8")
    found: dict[Path, Path] = {}
    if buttons:
        text = re.sub(r"^#: ?", "", text, flags=re.MULTILINE)
        named = {DigitalButton.load(one).press.button: Path(one) for one in buttons}
        listed = tomllib.loads(text).get("buttons", {})
        found = {
            beside(path.parent, file, str(source)): one
            for file, one in _matched(source, listed, named, len(buttons))
        }
    for file in (path, *found):
        check_destination(file)
    for file, one in found.items():
        with new_file(file) as part:
            shutil.copyfile(one, part)
    with new_file(path) as part:
        part.write_text(text, encoding="utf-8", newline="\n")


def _matched(
    source: Path, listed: Mapping[str, str], named: Mapping[str, Path], given: int
) -> list[tuple[str, Path]]:
    if len(listed) == given == 1:
        return [(next(iter(listed.values())), next(iter(named.values())))]
    if set(listed) != set(named) or len(named) != given:
        needed = f"one file of each of {', '.join(listed)}" if listed else "none"
        raise ConfigurationError(
            f"{source} plays other digital buttons than {', '.join(named)}: give {needed}, or change its "
            "levels and [buttons] in a copy."
        )
    return [(file, named[name]) for name, file in listed.items()]
