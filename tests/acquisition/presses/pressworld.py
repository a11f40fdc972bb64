"""A rig of presses whose truth is known in closed form, on virtual time. Independent of the plant."""

import threading
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from scipy.signal import lfilter

from haploop.base.clock import VirtualClock
from haploop.base.errors import InstrumentError
from haploop.instruments import Block, Daq, Operator, Press, Rig, Stream, Transfer, load_rig_file
from tests.rig_files import changed

FULL_SCALE = {"gauge": 10.0, "accel": 5.0, "switc": 10.0}


@dataclass
class Shape:
    """One button, in a few numbers."""

    peak: float = 3.0
    drop: float = 0.35
    """Part of the force that the snap takes away, over 10 ms."""
    click: tuple[float, float, float] = (10.0, 235.0, 0.008)
    early: tuple[float, float, float] | None = None
    """A first click, 60 ms before the activation."""
    maintained: bool = False


SHAPES = {
    "latch": Shape(8.0, 0.2, early=(6.0, 180.0, 0.008), maintained=True),
    "toggle": Shape(2.2, 0.35, (11.0, 310.0, 0.006), maintained=True),
    "push": Shape(4.0, 0.3),
}
RISE, SNAP, PUSH, HOLD, FALL = 0.12, 0.010, 0.05, 0.06, 0.08


def _smooth(x):
    x = np.clip(x, 0.0, 1.0)
    return x**3 * (10 - 15 * x + 6 * x**2)


@dataclass
class SyntheticPress:
    shape: Shape
    start: float
    speed: float
    strength: float
    flips: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @property
    def activation(self) -> float:
        return self.start + (RISE + 0.003) / self.speed

    @property
    def opening(self) -> float:
        return self.start + (RISE + SNAP + PUSH + HOLD + 0.4 * FALL) / self.speed

    @property
    def end(self) -> float:
        return self.start + (RISE + SNAP + PUSH + HOLD + FALL) / self.speed

    def force(self, t):
        s = (np.asarray(t) - self.start) * self.speed
        f = _smooth(s / RISE)
        f = f - self.shape.drop * _smooth((s - RISE) / SNAP)
        f = f + 0.6 * _smooth((s - RISE - SNAP) / PUSH)
        f = f * (1 - _smooth((s - RISE - SNAP - PUSH - HOLD) / FALL))
        return self.strength * self.shape.peak * f

    def acceleration(self, t):
        total = np.zeros(np.shape(t))
        clicks = [(self.activation, 1.0, self.shape.click)]
        if self.shape.early:
            clicks.append((self.activation - 0.06 / self.speed, 1.0, self.shape.early))
        if not self.shape.maintained:
            clicks.append((self.opening, -0.5, self.shape.click))
        for at, gain, (peak, hz, decay) in clicks:
            since = np.maximum(np.asarray(t) - at, 0)
            ring = gain * peak * (1 - np.exp(-since / 3e-4)) * np.exp(-since / decay)
            total = total + ring * np.sin(2 * np.pi * hz * since)
        return total


class World:
    """What the sensors feel. `presses` is the truth."""

    def __init__(
        self, seed=0, noise=0.03, drift=0.05 / 60, offset=0.7, bounce=0.004, answers=True, pole_hz=None
    ):
        self.rng = np.random.default_rng(seed)
        self.noise, self.drift, self.offset, self.bounce, self.answers = noise, drift, offset, bounce, answers
        self.presses: list[SyntheticPress] = []
        self.file = load_rig_file("simulated")
        self.pole_hz = pole_hz
        """Of the accelerometer, which otherwise follows at once."""
        if pole_hz:
            slow = {"transfer": Transfer(poles=(pole_hz,))}
            sensor = self.file.sensors.acceleration.model_copy(update=slow)
            self.file = changed(self.file, sensors={"acceleration": sensor})
        self.pairs = 1
        self.gain = 1.0

    def press(self, button: str, at: float) -> SyntheticPress:
        shape = SHAPES.get(button, SHAPES["push"])
        press = SyntheticPress(
            shape, at, float(self.rng.uniform(0.85, 1.2)), float(self.rng.uniform(0.9, 1.1))
        )
        instants = [press.activation] if shape.maintained else [press.activation, press.opening]
        flips = []
        for instant in instants:
            flips += [instant, *np.sort(instant + self.rng.uniform(3e-4, self.bounce, 2 * self.pairs))]
        press.flips = np.array(flips)
        self.presses.append(press)
        return press

    def volts(self, channel: str, t):
        if channel.startswith("gauge"):
            i = int(channel[5])
            weights = np.array(self.file.sensors.force.matrix[2])
            each = weights / (weights @ weights)
            force = self.offset + self.drift * t + sum(p.force(t) for p in self.presses)
            sigma = self.noise / np.sqrt(weights @ weights)
            return force * each[i] + self.rng.normal(0, sigma, len(t))
        if channel.startswith("acceleration"):
            sensor = self.file.sensors.acceleration
            z = 9.81 + sum(self._felt(p, t) for p in self.presses) if channel.endswith("z") else 0.0
            value = self.gain * z + self.rng.normal(0, 0.05, len(t))
            return sensor.zero[0] + value / sensor.matrix[0][0]
        flips = np.sort(np.concatenate([[-1.0], *(p.flips for p in self.presses)]))
        return 5.0 * ((np.searchsorted(flips, t, side="right") - 1) % 2) + self.rng.normal(0, 0.001, len(t))

    def _felt(self, press, t):
        if not self.pole_hz:
            return press.acceleration(t)
        grid = np.arange(press.start - 0.01, press.end + 0.2, 2e-5)
        passed = 1 - np.exp(-2 * np.pi * self.pole_hz * 2e-5)
        return np.interp(t, grid, lfilter([passed], [1, passed - 1], press.acceleration(grid)), 0, 0)


class WorldStream(Stream):
    def __init__(self, daq, channels, rate_hz, block):
        self.daq, self.channels, self.rate_hz, self.block = daq, tuple(channels), rate_hz, block
        self.delays = np.array(
            [15e-6 * i if c.startswith("gauge") else 14e-6 * (i - 6) for i, c in enumerate(channels)]
        )
        self.full_scale = np.array([FULL_SCALE[c[:5]] for c in channels])
        self.start = daq.clock.now()
        self.closed = False

    def __iter__(self) -> Iterator[Block]:
        number = 0
        while not self.closed:
            if number == self.daq.fails_at:
                raise InstrumentError("The card lost samples.")
            first = number * self.block + (self.block if number >= self.daq.gap_at else 0)
            k = np.arange(first, first + self.block)
            self.daq.clock.sleep_until(self.start + (first + self.block) / self.rate_hz)
            rows, t = zip(self.channels, self.delays, strict=True), self.start + k / self.rate_hz
            volts = np.stack([self.daq.world.volts(channel, t + delay) for channel, delay in rows])
            width = self.full_scale[:, None] / 32768
            codes = np.clip(np.rint(volts / width), -32768, 32767)
            overload = (np.abs(codes) >= 32767).any(axis=1)
            self.daq.given.append(codes.astype(np.int16))
            yield Block(first, codes * width, overload)
            number += 1

    def close(self) -> None:
        self.closed = True


class WorldDaq(Daq):
    identity = "world"

    def __init__(self, world: World, clock: VirtualClock) -> None:
        self.world, self.clock = world, clock
        self.given: list[np.ndarray] = []
        self.fails_at = self.gap_at = 10**9
        self.streams: list[WorldStream] = []

    def _stream(self, request):
        self.streams.append(WorldStream(self, request.channels, request.rate_hz, request.block))
        return self.streams[-1]

    def zero(self) -> None: ...

    def close(self) -> None: ...


class WorldOperator(Operator):
    def __init__(self, world: World, clock: VirtualClock) -> None:
        self.world, self.clock, self.requests = world, clock, []

    def tell(self, request) -> None:
        self.requests.append(request)
        assert threading.current_thread() is threading.main_thread()
        if isinstance(request, Press) and self.world.answers:
            self.world.press(request.button, self.clock.now() + float(self.world.rng.uniform(0.25, 0.6)))

    def confirm(self, request) -> bool:
        return True


def world_rig(sensors=None, **settings) -> Rig:
    """A rig whose DAQ and operator are a `World`; it is reached as `rig.daq.world`.

    `sensors` are those that its file says otherwise.
    """
    world, clock = World(**settings), VirtualClock()
    rig = Rig(changed(world.file, sensors=sensors or {}), clock, None, None, ())
    rig._roles = {"daq": WorldDaq(world, clock), "operator": WorldOperator(world, clock)}
    return rig
