"""A touch surface that is ready for a participant: camera calibrated, every digital button verified."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ...acquisition import Representative
from ...base.errors import ConfigurationError, DataError, LimitError
from ...base.files import beside
from ...base.progress import Progress, silent
from ...calibration import DigitalButton
from ...instruments import Camera, Rig
from ...instruments.operator import Request, TakeTarget, Target
from ..contact import SeenSurface, VerifiedButton, calibrate_meter, learn_background, verify_button
from ..protocol import Experiment

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
