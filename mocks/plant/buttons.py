"""Physical buttons and the fingers that press them.

A finger moves the cap along a minimum-jerk path (Flash and Hogan, 1985). The button's reaction force
depends on travel, falls at each snap, and grows with speed; every snap starts a decaying vibration of the
cap; contacts close at a travel just behind a snap, and bounce. Forces keep the paper's order (latch
largest, toggle smallest) and lie in the ranges of docs/hardware.md, "Buttons and people"; the other
figures are estimates.
"""

from __future__ import annotations

import zlib
from bisect import bisect_right, insort
from dataclasses import dataclass, replace
from functools import lru_cache
from operator import attrgetter
from typing import Literal, get_args

import numpy as np

from ...base.arrays import FloatArray
from ...instruments.operator import Press
from .poles import ringing


@dataclass(frozen=True)
class Click:
    """A snap at a travel (m), and the vibration that it starts: partials of (Hz, m/s^2, decay in s)."""

    travel: float
    partials: tuple[tuple[float, float, float], ...]


@dataclass(frozen=True)
class Button:
    """One physical button."""

    name: str
    maintained: bool
    """True when each press toggles the state; otherwise the contact is closed only during the press."""
    travel: tuple[float, ...]
    force: tuple[float, ...]
    """Points of force (N) over `travel` (m), in rising travel; the last point is the stop."""
    contact: float
    """Travel at which the contact switches (m)."""
    clicks: tuple[Click, ...]
    stroke: float
    """Duration of a downstroke at pace 1 (s)."""
    dwell: float
    """Time that a finger rests at the stop (s)."""

    def law(self, travel: FloatArray) -> FloatArray:
        """Return the static force (N) at travels (m), by shape-preserving interpolation."""
        knots = np.array(self.travel)
        within = np.clip(travel, 0.0, knots[-1])
        piece = np.clip(np.searchsorted(knots, within, side="right") - 1, 0, len(knots) - 2)
        along = within - knots[piece]
        cubic, square, slope, force = _pieces(self.travel, self.force)[:, piece]
        squared = along * along
        return np.asarray(force + slope * along + square * squared + cubic * (squared * along))


@lru_cache(maxsize=16)
def _pieces(travel: tuple[float, ...], force: tuple[float, ...]) -> FloatArray:
    """Return the cubic between each point and the next, (4, points - 1), highest power first.

    Fritsch and Butland, SIAM J. Sci. Stat. Comput. 5 (1984), to the bits of scipy's PchipInterpolator, whose
    import takes longer than all else that a simulated rig needs at its start.
    """
    x, y = np.array(travel), np.array(force)
    h = np.diff(x)
    m = np.diff(y) / h
    slopes = np.zeros(len(x))
    same = np.flatnonzero(m[:-1] * m[1:] > 0)
    before, after = 2 * h[same + 1] + h[same], h[same + 1] + 2 * h[same]
    slopes[same + 1] = 1 / ((before / m[same] + after / m[same + 1]) / (before + after))
    for end, h0, h1, m0, m1 in ((0, h[0], h[1], m[0], m[1]), (-1, h[-1], h[-2], m[-1], m[-2])):
        slope = ((2 * h0 + h1) * m0 - h0 * m1) / (h0 + h1)
        if slope * m0 <= 0:
            slope = 0.0
        elif m0 * m1 <= 0 and abs(slope) > 3 * abs(m0):
            slope = 3 * m0
        slopes[end] = slope
    bend = (slopes[:-1] + slopes[1:] - 2 * m) / h
    return np.array([bend / h, (m - slopes[:-1]) / h - bend, slopes[:-1], y[:-1]])


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
"""The paper's three buttons, by name."""


def button_named(name: str) -> Button:
    """Return a button of the paper or, for any other name, a momentary button with its own vibration."""
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
    """One participant's reaction time (s), and factors on a button's force, the speed and the click."""

    reaction: float
    strength: float
    pace: float
    liveliness: float
    steadiness: float
    """Relative scatter from press to press."""

    @classmethod
    def of(cls, rng: np.random.Generator) -> Finger:
        """Draw the finger of one participant."""
        return cls(
            reaction=float(rng.uniform(0.3, 0.7)),
            strength=float(rng.uniform(0.93, 1.08)),
            pace=float(rng.uniform(0.85, 1.2)),
            liveliness=float(rng.uniform(0.85, 1.15)),
            steadiness=float(rng.uniform(0.01, 0.03)),
        )


Flaw = Literal["", "soft", "hard", "double", "leaning", "lingering"]
"""Flaw of a press; "" for a good press. soft: too weak to switch the button. hard: shakes the cap beyond the
accelerometer's range. double: a second press follows at once. leaning, lingering: the finger rests on the
button before or after the press."""
FLAWS: tuple[Flaw, ...] = get_args(Flaw)[1:]

_SOFT = (0.6, 0.85)
"""Limits of a soft press's travel, as a fraction of the travel to the contact."""
_SLAM = 6.0
"""Factor on the vibration of a hard press, which takes it beyond 3 g for every button."""
_LEAN_FORCE, _LEAN_TIME = (0.4, 0.8), (0.5, 0.9)
"""Limits of the force (N) and duration (s) of a finger that rests on a button."""
_UP = 0.12
"""Duration of an upstroke at pace 1 (s); a press takes 0.2 to 1 s: docs/hardware.md, "Buttons and people"."""
_TOUCH = 0.05
"""Rise and fall time of the force when a finger comes to rest on a cap, and leaves it (s)."""
_SNAP = 3e-4
"""Time constant with which a snap's vibration builds up (s)."""
_VISCOSITY = 0.06
"""Relative force per 0.1 m/s of finger speed: faster presses push harder."""


@dataclass(frozen=True, eq=False)
class SimulatedPress:
    """One press as functions of the plant's time (s), with its true event times."""

    button: str
    participant: str
    number: int
    attempt: int
    flaw: Flaw
    start: float
    """Time at which the finger touches the cap (s)."""
    stop: float
    """Time at which the finger leaves the cap (s)."""
    activation_time: float | None
    """Time at which the contact switches (s); None for a press too soft to switch it."""
    activation_force: float | None
    """Force at `activation_time` (N)."""
    release_time: float | None
    """Time at which the contact of a momentary button opens again (s)."""
    flips: FloatArray
    """Times at which the contact changes state, with bounces (s)."""
    _fall: float
    """Begin of the downstroke (s)."""
    _reach: float
    """Largest travel (m)."""
    _lean: float
    """Force of a finger that rests on the cap from `start` to `stop` (N)."""
    _down: float
    _dwell: float
    _up: float
    _model: Button
    _strength: float
    _clicks: tuple[tuple[float, float, tuple[tuple[float, float, float], ...]], ...]

    def travel(self, times: FloatArray) -> FloatArray:
        """Return the travel of the cap (m)."""
        fall = _minimum_jerk((times - self._fall) / self._down)
        rise = _minimum_jerk((times - self._fall - self._down - self._dwell) / self._up)
        return np.asarray(self._reach * (fall - rise))

    def force(self, times: FloatArray) -> FloatArray:
        """Return the force on the cap along the press direction (N)."""
        t = np.asarray(times)
        travel, later, earlier = self.travel(np.stack([t, t + 5e-4, t - 5e-4]))
        speed = (later - earlier) / 1e-3
        # Friction lowers the force of the upstroke by as much as it raises that of the downstroke.
        rate = 1 + _VISCOSITY * np.tanh(speed / 0.1)
        pressed = self._strength * self._model.law(travel) * rate
        if self._lean:
            onto, off = (_minimum_jerk((t - at) / _TOUCH) for at in (self.start, self.stop - _TOUCH))
            pressed = np.maximum(pressed, self._lean * (onto - off))
        return np.asarray(pressed)

    def acceleration(self, times: FloatArray) -> FloatArray:
        """Return the upward acceleration of the cap, without gravity, (times,) m/s^2. Times (s) rise."""
        h = 1e-3
        motion = np.zeros(len(times))
        rise = self._fall + self._down + self._dwell
        for begin, end in ((self._fall, self._fall + self._down), (rise, rise + self._up)):
            # It is zero while the cap rests; a window twice as wide as needed forgives rounding.
            first, stop = np.searchsorted(times, [begin - 2 * h, end + 2 * h])
            t = times[first:stop]
            motion[first:stop] = (2 * self.travel(t) - self.travel(t + h) - self.travel(t - h)) / h**2
        return motion + self.clicks(times)

    def clicks(self, times: FloatArray) -> FloatArray:
        """Return what the snaps shed into the cap, (times,) m/s^2 upwards. Times (s) rise."""
        motion = np.zeros(len(times))
        for at, gain, partials in self._clicks:
            first = int(np.searchsorted(times, at, side="right"))
            # A snap takes a third of a millisecond to build up, because a cap has mass: 1 - exp(-t / _SNAP)
            # times a decaying sine is the difference of two decays.
            own = np.array([2j * np.pi * frequency - 1 / decay for frequency, _, decay in partials])
            loud = -1j * gain * np.array([amplitude for _, amplitude, _ in partials])
            decays = np.concatenate([own, own - 1 / _SNAP])
            motion[first:] += ringing(decays, np.concatenate([loud, -loud]), times[first:] - at)
        return motion


def press_button(
    button: Button, finger: Finger, request: Press, start: float, rng: np.random.Generator, flaw: Flaw = ""
) -> SimulatedPress:
    """Create a press that begins at `start` (s of the plant's clock), with the finger's random scatter.

    For the flaw "double" it creates one of the two presses.
    """
    scatter = np.exp(finger.steadiness * rng.standard_normal(4))
    pace = finger.pace * scatter[0]
    down = float(button.stroke / pace)
    dwell, up = float(button.dwell * scatter[1] / pace), float(_UP / pace)
    strength = finger.strength * scatter[2]
    reach = button.travel[-1]
    loud = finger.liveliness * scatter[3] * pace
    before = after = lean = 0.0
    if flaw == "soft":
        reach = float(rng.uniform(*_SOFT)) * button.contact
    elif flaw == "hard":
        loud *= _SLAM
    elif flaw in ("leaning", "lingering"):
        lean, length = float(rng.uniform(*_LEAN_FORCE)), float(rng.uniform(*_LEAN_TIME))
        before, after = (length, 0.0) if flaw == "leaning" else (0.0, length)
    fall = start + before

    def falling(travel: float) -> float:
        return fall + down * _minimum_jerk_time(travel / reach)

    def rising(travel: float) -> float:
        return fall + down + dwell + up * _minimum_jerk_time(1 - travel / reach)

    snaps = [c for c in button.clicks if c.travel < reach]
    clicks = [(falling(c.travel), loud, c.partials) for c in snaps]
    switches = button.contact < reach
    activation = falling(button.contact) if switches else None
    release = None if button.maintained or not switches else rising(0.9 * button.contact)
    flips = [_bounce(at, rng) for at in (activation, release) if at is not None]
    if not button.maintained:
        clicks += [(rising(0.9 * c.travel), -0.6 * loud, c.partials) for c in snaps]
    press = SimulatedPress(
        button=button.name,
        participant=request.participant,
        number=request.number,
        attempt=request.attempt,
        flaw=flaw,
        start=start,
        stop=fall + down + dwell + up + after,
        activation_time=activation,
        activation_force=None,
        release_time=release,
        flips=np.concatenate([np.zeros(0), *flips]),
        _fall=fall,
        _reach=reach,
        _lean=lean,
        _down=down,
        _dwell=dwell,
        _up=up,
        _model=button,
        _strength=strength,
        _clicks=tuple(clicks),
    )
    if activation is None:
        return press
    return replace(press, activation_force=float(press.force(np.array([activation]))[0]))


class Presses:
    """Every press of a plant, in order of creation, found by time: a night holds thousands."""

    def __init__(self) -> None:
        self.all: list[SimulatedPress] = []
        self.flips: FloatArray = np.zeros(0)
        """Times at which the contact changes state, rising (s)."""
        self._by_stop: list[SimulatedPress] = []

    def add(self, press: SimulatedPress) -> None:
        """Add a press."""
        self.all.append(press)
        insort(self._by_stop, press, key=_stop)
        self.flips = np.sort(np.concatenate([self.flips, press.flips]))

    def between(self, begin: float, end: float, tail: float) -> list[SimulatedPress]:
        """Return the presses that act from `begin` to `end` (s); vibration lasts `tail` s after a press."""
        first = bisect_right(self._by_stop, begin - tail, key=_stop)
        return [p for p in self._by_stop[first:] if p.start < end]


_stop = attrgetter("stop")


def _minimum_jerk(x: FloatArray) -> FloatArray:
    # Most samples lie before or after the movement, and a third power costs ten times what a comparison does.
    path = (x >= 1.0).astype(np.float64)
    moving = np.flatnonzero((x > 0.0) & (x < 1.0))
    x = x.ravel()[moving]
    path.ravel()[moving] = x**3 * (10 - 15 * x + 6 * x**2)
    return np.asarray(path)


_TIME: FloatArray = np.linspace(0, 1, 20_001)
_PATH = _minimum_jerk(_TIME)


def _minimum_jerk_time(fraction: float) -> float:
    return float(np.interp(fraction, _PATH, _TIME))


def _bounce(at: float, rng: np.random.Generator) -> FloatArray:
    """Draw an odd number of flips from `at` (s) on.

    Contacts bounce for 0.1 to 3 ms (docs/hardware.md, "Buttons and people").
    """
    pairs = int(rng.integers(0, 4))
    return np.concatenate([[at], at + np.sort(rng.uniform(1e-4, 3e-3, 2 * pairs))])
