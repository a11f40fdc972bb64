"""Physical buttons and the fingers that press them.

A finger moves the cap along a minimum-jerk path (Flash and Hogan, 1985); the button answers with a
force that depends on travel, falls at each snap, and grows with speed; every snap sheds a decaying
vibration into the cap; contacts close at a travel just behind a snap, and bounce. Forces keep the
paper's order (latch largest, toggle smallest) and lie in the ranges of hardware.md, section 11;
what is not found there is an estimate.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

from instruments.arrays import FloatArray

__all__ = ["BUTTONS", "Button", "ButtonPress", "Finger", "button_named", "press_button"]


@dataclass(frozen=True)
class Click:
    """A snap at a travel (m), and the vibration that it sheds: partials of (Hz, m/s^2, decay in s)."""

    travel: float
    partials: tuple[tuple[float, float, float], ...]


@dataclass(frozen=True)
class Button:
    """One physical button."""

    name: str
    maintained: bool
    """Each press changes the state and leaves it so; otherwise it lasts as long as the press."""
    travel: tuple[float, ...]
    force: tuple[float, ...]
    """Force (N) over travel (m), both rising in travel; the last point is the stop."""
    contact: float
    """Travel at which the contact switches."""
    clicks: tuple[Click, ...]
    stroke: float
    """How long a downstroke takes at pace 1 (s)."""
    dwell: float
    """How long a finger rests at the stop (s)."""

    def law(self, travel: FloatArray) -> FloatArray:
        """Force (N) at rest over travel (m), shape-preserving between the points."""
        curve = PchipInterpolator(self.travel, self.force, extrapolate=False)
        return np.asarray(curve(np.clip(travel, 0.0, self.travel[-1])))


_MM = 1e-3
BUTTONS = {
    button.name: button
    for button in (
        Button(
            name="latch",
            maintained=True,
            travel=(0, 0.9 * _MM, 1.1 * _MM, 1.9 * _MM, 2.2 * _MM, 2.5 * _MM),
            force=(0, 5.2, 4.1, 8.0, 6.6, 10.5),
            contact=2.0 * _MM,
            clicks=(
                Click(0.95 * _MM, ((165.0, 5.0, 9e-3), (310.0, 2.0, 6e-3))),
                Click(1.97 * _MM, ((220.0, 11.0, 9e-3), (405.0, 5.0, 5e-3))),
            ),
            stroke=0.20,
            dwell=0.06,
        ),
        Button(
            name="toggle",
            maintained=True,
            travel=(0, 0.7 * _MM, 1.1 * _MM, 1.4 * _MM),
            force=(0, 2.2, 1.4, 3.4),
            contact=0.8 * _MM,
            clicks=(Click(0.76 * _MM, ((315.0, 11.0, 6e-3), (145.0, 4.0, 10e-3))),),
            stroke=0.10,
            dwell=0.03,
        ),
        Button(
            name="push",
            maintained=False,
            travel=(0, 1.1 * _MM, 1.5 * _MM, 1.8 * _MM),
            force=(0, 4.0, 2.9, 5.6),
            contact=1.2 * _MM,
            clicks=(Click(1.16 * _MM, ((235.0, 10.0, 10e-3), (120.0, 3.0, 14e-3))),),
            stroke=0.12,
            dwell=0.10,
        ),
    )
}
"""The paper's three."""


def button_named(name: str) -> Button:
    """A button of the paper, or for any other name a momentary one whose vibration is its own."""
    if name in BUTTONS:
        return BUTTONS[name]
    rng = np.random.default_rng(zlib.crc32(name.encode()))
    push = BUTTONS["push"]
    partials = tuple((float(f), float(rng.uniform(3, 9)), 9e-3) for f in rng.uniform(110, 420, 2))
    stiffness = rng.uniform(0.7, 1.5)
    return Button(
        name=name,
        maintained=False,
        travel=push.travel,
        force=tuple(stiffness * f for f in push.force),
        contact=push.contact,
        clicks=(Click(push.clicks[0].travel, partials),),
        stroke=push.stroke,
        dwell=push.dwell,
    )


@dataclass(frozen=True)
class Finger:
    """How one participant presses: factors on the button's force, the speed, and the click."""

    reaction: float
    strength: float
    pace: float
    liveliness: float
    steadiness: float
    """Relative scatter from press to press."""

    @classmethod
    def of(cls, rng: np.random.Generator) -> Finger:
        """One participant of many."""
        return cls(
            reaction=float(rng.uniform(0.3, 0.7)),
            strength=float(rng.uniform(0.93, 1.08)),
            pace=float(rng.uniform(0.85, 1.2)),
            liveliness=float(rng.uniform(0.85, 1.15)),
            steadiness=float(rng.uniform(0.01, 0.03)),
        )


_UP = 0.12
"""Seconds of an upstroke at pace 1 (a press takes 0.2 to 1 s; hardware.md, section 11)."""
_VISCOSITY = 0.06
"""Relative force per 0.1 m/s of finger speed: faster presses push harder."""


@dataclass(frozen=True, eq=False)
class ButtonPress:
    """One press, as functions of the plant's time (s), and the truth about it."""

    button: str
    participant: str
    start: float
    stop: float
    activation_time: float
    activation_force: float
    release_time: float | None
    """When the contact of a momentary button opened again."""
    flips: FloatArray
    """Times at which the contact changes its state, bounces included."""
    _down: float
    _dwell: float
    _up: float
    _model: Button
    _strength: float
    _clicks: tuple[tuple[float, float, tuple[tuple[float, float, float], ...]], ...]

    def travel(self, times: FloatArray) -> FloatArray:
        """Travel of the cap (m)."""
        reach = self._model.travel[-1]
        fall = _minimum_jerk((times - self.start) / self._down)
        rise = _minimum_jerk((times - self.start - self._down - self._dwell) / self._up)
        return np.asarray(reach * (fall - rise))

    def force(self, times: FloatArray) -> FloatArray:
        """Force on the cap along the press (N)."""
        t = np.asarray(times)
        speed = (self.travel(t + 5e-4) - self.travel(t - 5e-4)) / 1e-3
        # Rubbing takes from the upstroke what it adds to the downstroke.
        rate = 1 + _VISCOSITY * np.tanh(speed / 0.1)
        return np.asarray(self._strength * self._model.law(self.travel(t)) * rate)

    def acceleration(self, times: FloatArray) -> FloatArray:
        """Acceleration of the cap along the press (m/s^2), without gravity."""
        t = np.asarray(times)
        h = 1e-3
        motion = (self.travel(t + h) - 2 * self.travel(t) + self.travel(t - h)) / h**2
        for at, gain, partials in self._clicks:
            since = np.maximum(t - at, 0.0)
            # The snap takes a third of a millisecond to build up: a cap has mass.
            attack = 1 - np.exp(-since / 3e-4)
            for frequency, amplitude, decay in partials:
                motion = motion + gain * amplitude * attack * np.exp(-since / decay) * np.sin(
                    2 * np.pi * frequency * since
                )
        return np.asarray(motion)


def press_button(
    button: Button, finger: Finger, participant: str, start: float, rng: np.random.Generator
) -> ButtonPress:
    """A press that begins at `start` (s of the plant's clock), scattered as the finger scatters."""
    scatter = np.exp(finger.steadiness * rng.standard_normal(4))
    pace = finger.pace * scatter[0]
    down = float(button.stroke / pace)
    dwell, up = float(button.dwell * scatter[1] / pace), float(_UP / pace)
    strength = finger.strength * scatter[2]
    reach = button.travel[-1]

    def falling(travel: float) -> float:
        return start + down * _minimum_jerk_time(travel / reach)

    def rising(travel: float) -> float:
        return start + down + dwell + up * _minimum_jerk_time(1 - travel / reach)

    loud = finger.liveliness * scatter[3] * pace
    clicks = [(falling(c.travel), loud, c.partials) for c in button.clicks]
    activation = falling(button.contact)
    release = None if button.maintained else rising(0.9 * button.contact)
    flips = [_bounce(activation, rng)]
    if release is not None:
        flips.append(_bounce(release, rng))
        clicks += [(rising(0.9 * c.travel), -0.6 * loud, c.partials) for c in button.clicks]
    press = ButtonPress(
        button=button.name,
        participant=participant,
        start=start,
        stop=start + down + dwell + up,
        activation_time=activation,
        activation_force=0.0,
        release_time=release,
        flips=np.concatenate(flips),
        _down=down,
        _dwell=dwell,
        _up=up,
        _model=button,
        _strength=strength,
        _clicks=tuple(clicks),
    )
    object.__setattr__(press, "activation_force", float(press.force(np.array([activation]))[0]))
    return press


def latest(presses: list[ButtonPress], begin: float, end: float, tail: float) -> Iterator[ButtonPress]:
    """Presses that can be felt between `begin` and `end` (s), their vibration up to `tail` later."""
    return (p for p in presses if p.start < end and p.stop + tail > begin)


def _minimum_jerk(x: FloatArray) -> FloatArray:
    x = np.clip(x, 0.0, 1.0)
    return np.asarray(x**3 * (10 - 15 * x + 6 * x**2))


_TIME: FloatArray = np.linspace(0, 1, 20_001)
_PATH = _minimum_jerk(_TIME)


def _minimum_jerk_time(fraction: float) -> float:
    return float(np.interp(fraction, _PATH, _TIME))


def _bounce(at: float, rng: np.random.Generator) -> FloatArray:
    """An odd number of flips that begin at `at`: contacts bounce for 0.1 to 3 ms."""
    pairs = int(rng.integers(0, 4))
    return np.concatenate([[at], at + np.sort(rng.uniform(1e-4, 3e-3, 2 * pairs))])
