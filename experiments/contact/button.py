"""A digital button at run time: the finger's contact area activates it, and its verified drive is played."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from datetime import datetime
from typing import Literal

import numpy as np

from ...base.arrays import FloatArray
from ...base.errors import ConfigurationError, DataError
from ...base.progress import Progress, silent
from ...calibration import Check, DigitalButton, Drive, PressedDrives, TableForce, check
from ...instruments import Rig
from .area import Contact, SeenSurface

BUDGET = 0.054
"""s: asynchrony of a haptic and an acoustic attack that people notice (arXiv 1906.11571), our budget for
frame to drive. For a finger that feels its own press there may be less."""
_RISE = 5e-3
"""Time in which a drive without its lead-in rises (s)."""
_PARTS = (1.0, 0.2, 0.02, 0.0)
"""Parts of the lead-in that are tried to be left out."""
_WEIGHED = 0.01
"""Time (s) in which the force of a press is read: it adds to the latency."""
_ONSET = 0.1
"""Share of the target's peak at which it counts as begun to be felt."""


class Activator:
    """Turns contact areas into at most one press, and one release, for each touch of the surface.

    It activates when the area exceeds `area`, and is armed again only when the finger has left the surface,
    or nearly: when the area falls below `lifted`. A finger that trembles at the threshold, however much, is
    one press. A frame that is not to be trusted disarms it until the surface was seen free: of two fingers
    the one that stays has crossed nothing when the other is lifted. A release, for buttons that render it, is
    when the area first falls below `release` after a press.
    """

    def __init__(self, area: float, lifted: float, release: float | None = None) -> None:
        if not 0 < lifted < area or (release is not None and not lifted <= release < area):
            raise ConfigurationError(
                f"A button needs areas 0 < lifted <= release < activation, and has {lifted:g}, "
                f"{release}, {area:g}."
            )
        self._area, self._lifted, self._release = area, lifted, release
        # Armed only once the surface was seen free: a finger that rests there from the beginning is no press.
        self._state: Literal["waiting", "armed", "spoilt", "pressed", "released"] = "waiting"
        self.lifts = 0
        """Touches that ended, whether or not they had activated it."""
        self._touched = False

    @property
    def pressed(self) -> bool:
        """True from a press to its release, or to the end of the touch."""
        return self._state == "pressed"

    def see(self, contact: Contact) -> Literal["press", "release"] | None:
        """What this frame brings about. A frame whose area is not to be trusted brings nothing about."""
        area = contact.area
        if contact.problem:
            if self._state == "armed":
                self._state = "spoilt"
            self._touched = self._touched or (self._state == "spoilt" and area >= self._lifted)
            return None
        self.lifts += self._touched and area < self._lifted
        self._touched = area >= self._lifted and self._state != "waiting"
        if area < self._lifted:
            was, self._state = self._state, "armed"
            return "release" if was == "pressed" and self._release is not None else None
        if self._state == "armed" and area > self._area:
            self._state = "pressed"
            return "press"
        if self._state == "pressed" and self._release is not None and area < self._release:
            self._state = "released"
            return "release"
        return None


@dataclass(frozen=True, eq=False)
class VerifiedButton:
    """A digital button whose check passed today, on this very rig. Made by `verify_button`."""

    button: DigitalButton
    check: Check
    rig: Rig
    date: str
    """Local date of the check."""
    left_out: float
    """Share of the target's energy in the lead-in that is not played, and was not in the check."""
    pressed: PressedDrives | None = None
    """Drives for a finger by its force, which are played instead; each passed its check under that finger
    when the button was made, and today the bare table did. Without the same lead-in."""

    def refuse_stale(self, rig: Rig) -> None:
        """Raise ConfigurationError unless the check holds on this rig today."""
        if rig is not self.rig or self.date != _today():
            raise ConfigurationError(
                f"The digital {self.button.press.button} was verified on {self.rig.name!r}, opened "
                "before, on "
                f"{self.date}: verify it again on this rig today."
            )


@dataclass(frozen=True, eq=False)
class Rendering:
    """What is played at a press and, if the activator reports releases, at a release.

    The paper leaves open whether a digital push button should render releases. The verified volts are
    multiplied by `scale`; the check is of 1.
    """

    press: VerifiedButton
    release: VerifiedButton | None = None
    scale: float = 1.0


@dataclass(frozen=True)
class Played:
    """One activation, and when its drive began."""

    kind: Literal["press", "release"]
    contact: Contact
    latency: float
    """s from the middle of the frame's exposure to the first sample of the drive, at most."""
    onset: float
    """s from the middle of the exposure to where the target motion reaches a tenth of its peak."""
    scale: float = 1.0
    """Volts that were played, over those of the verified drive."""
    force: float | None = None
    """Force (N) that the sensor under the table read before the play; None where none did."""
    made_for: float | None = None
    """Force (N) of the drive that was played; None for that of the bare table."""


@dataclass(frozen=True)
class Latency:
    """Distribution of latencies (s) against the budget."""

    count: int
    median: float
    p95: float
    worst: float
    budget: float
    within: float
    """Share of the activations within the budget."""


@dataclass
class _Timer:
    """Latest time at which a play can have begun, from its progress."""

    rig: Rig
    begun: float = field(default=np.inf)

    def __call__(self, _doing: str, done: float, _total: float, unit: str) -> None:
        if unit == "s" and done > 0:
            self.begun = min(self.begun, self.rig.clock.now() - done)


def verify_button(
    rig: Rig, button: DigitalButton, left_out: float = 5e-3, progress: Progress = silent
) -> VerifiedButton:
    """Play and measure a button without its lead-in; it may then be used on this rig today.

    A recorded press begins some tenths of a second before the button activates. At run time the finger has
    pressed already, so that the drive begins where the target has had the share `left_out` of its energy. A
    table that rings long needs some of the volts before that: if the check does not pass, less is left out,
    down to nothing. The check is of exactly what will be played on the bare table. Raises DataError when not
    even the whole drive passes, or one for a finger did not, ConfigurationError for a button of another
    world, and what `haploop.check` raises.
    """
    if button.simulated != rig.simulated:
        kinds = {True: "simulated", False: "real"}
        raise ConfigurationError(
            f"The digital {button.press.button} is of a {kinds[button.simulated]} table and the rig "
            f"{rig.name!r} "
            f"is {kinds[rig.simulated]}: make a button on this rig."
        )
    pressed = button.pressed
    if pressed is not None and not all(one.passed for one in button.pressed_checks):
        raise DataError(
            f"A drive of the digital {button.press.button} for {pressed.participant}'s finger did not pass "
            "its check: make them again (haploop button under)."
        )
    for part in _PARTS:
        drive, cut = without_lead_in(button.drive, part * left_out)
        result = check(rig, drive, button.press, progress=progress)
        if result.passed:
            if pressed is not None:
                pressed = pressed.replaced(
                    [without_lead_in(one, part * left_out)[0] for one in pressed.drives]
                )
            return VerifiedButton(button, result, rig, _today(), cut, pressed)
    raise DataError(
        f"The digital {button.press.button} is not verified today ({' '.join(result.reasons)}): "
        "make it again."
    )


def without_lead_in(drive: Drive, left_out: float = 5e-3) -> tuple[Drive, float]:
    """Cut a drive where its target has had the share `left_out` of its energy; return it, and what was cut.

    The volts rise from zero over 5 ms, so that the drive begins without a step. Raises ConfigurationError
    for a share below 0 or above 1 %: more than that would no longer be the press.
    """
    if not 0 <= left_out <= 0.01:
        raise ConfigurationError(f"The lead-in to leave out is {left_out:g} of the energy: use 0 to 0.01.")
    energy = np.cumsum(drive.target**2) / float(np.sum(drive.target**2))
    rise = round(_RISE * drive.rate_hz)
    begin = max(0, int(np.argmax(energy > left_out)) - rise)
    if begin == 0:
        return drive, 0.0
    volts = drive.volts[:, begin:].copy()
    volts[:, :rise] *= np.sin(np.pi / 2 * np.arange(rise) / rise) ** 2
    there = tuple(replace(one, target=one.target[begin:]) for one in drive.elsewhere)
    cut = replace(drive, volts=volts, target=drive.target[begin:], elsewhere=there)
    return cut, float(energy[begin - 1])


def run_button(
    seen: SeenSurface,
    rendering: Rendering,
    activator: Activator,
    *,
    presses: int = 1,
    timeout: float = 30.0,
    ask: Callable[[], None] = lambda: None,
) -> tuple[Played, ...]:
    """Play the button each time that the finger activates it, until it was pressed `presses` times.

    Every drive goes through the rig's limiter. Of drives for a finger the one is played that its force calls
    for, which the force sensor under the table reads at the press, or the nominal one. `ask` is called for
    each touch that is to come: at first, after a press, and after a touch that did not activate the button.

    Raises DataError when no press comes within `timeout` (s), ConfigurationError for a button that is not
    verified today, and what `Rig.excite` raises.
    """
    rig, verified, release = seen.rig, rendering.press, rendering.release
    verified.refuse_stale(rig)
    if release is not None:
        release.refuse_stale(rig)
    found: list[Played] = []
    pressed = asked = 0
    """Presses so far, and the touch that was last asked for: one after so many lifts."""
    for button in (verified, release or verified):
        for patch in button.check.drive.patches:
            rig.prove_gain(patch)  # else in the first press, which would be felt late
    seen.skip()
    # A force is told from what the sensor shows while nothing presses; else the nominal drive is played.
    free = verified.pressed is not None and seen.contact().area == 0
    weighed = TableForce.at_rest(rig) if free else None
    seen.skip()
    begun, since = activator.lifts, rig.clock.now()
    ask()
    while pressed < presses or (release is not None and activator.pressed):
        contact = seen.contact()
        if rig.clock.now() - since > timeout:
            raise DataError(f"The button was not pressed within {timeout:g} s. {contact.problem}".strip())
        kind = activator.see(contact)
        if activator.lifts - begun > asked and pressed < presses:
            asked = activator.lifts - begun
            ask()
        chosen = verified if kind == "press" else release if kind == "release" else None
        if kind is None or chosen is None:
            continue
        pressed += kind == "press"
        drive, force, made_for = chosen.check.drive, None, None
        if chosen.pressed is not None:
            force = weighed.read(_WEIGHED) if weighed is not None else None
            number = chosen.pressed.number(force)
            drive, made_for = chosen.pressed.drives[number], chosen.pressed.forces[number]
        timer = _Timer(rig)
        volts = {patch: rendering.scale * own for patch, own in drive.by_patch.items()}
        rig.excite_each(volts, tuple(dict.fromkeys(map(rig.monitor, volts))), progress=timer)
        latency = float(timer.begun - contact.time)
        onset = latency + _onset(drive.target) / drive.rate_hz
        found.append(Played(kind, contact, latency, onset, rendering.scale, force, made_for))
        seen.skip()
        since = rig.clock.now()
    return tuple(found)


def latency_of(played: Sequence[Played | float], budget: float = BUDGET) -> Latency:
    """Distribution of the latencies (s) from frame to first sample. Raises DataError without any."""
    if not played:
        raise DataError("There is no activation whose latency could be told: press the button first.")
    values = np.array([one.latency if isinstance(one, Played) else one for one in played])
    return Latency(
        len(values),
        float(np.median(values)),
        float(np.percentile(values, 95)),
        float(values.max()),
        budget,
        float(np.mean(values <= budget)),
    )


def _onset(target: FloatArray) -> int:
    return int(np.argmax(np.abs(target) >= _ONSET * np.abs(target).max()))


def _today() -> str:
    return datetime.now().astimezone().date().isoformat()
