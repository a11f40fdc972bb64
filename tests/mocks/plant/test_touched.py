"""Bodies that come, stay and go while a surface moves, against a numerical integration of the same system."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from haploop.base.errors import ConfigurationError
from haploop.mocks.plant import Contact, Modes
from haploop.mocks.plant.modal_surface import ModalSurface, SofteningSurface
from haploop.mocks.plant.touched import TouchedPoles

T = 1 / 50_000
SHAPES = {(0.0, 0.0): np.array([0.7, 1.0, -0.8]), (0.5, 0.5): np.array([-0.4, 0.9, 0.3])}
MODES = Modes(
    np.array([100.0, 263.5, 600.0]),
    np.array([0.01, 0.01, 0.02]),
    {"A": np.array([2.0, 5.0, 9.0]), "B": np.array([-1.0, 3.0, 4.0])},
    SHAPES.__getitem__,
    masses=np.array([0.24, 0.03, 0.1]),
)
SOFT = Contact("finger", (0.0, 0.0), 500.0, 1.1, 0.006)
HARD = Contact("finger", (0.0, 0.0), 4000.0, 3.2, 0.006)
OTHER = Contact("other", (0.5, 0.5), 1300.0, 9.0, 0.02)
Course = Sequence[tuple[float, tuple[Contact, ...]]]
COURSE: Course = [
    (0.0, ()),
    (0.0051, (SOFT,)),
    (0.0103, (HARD, OTHER)),
    (0.0152, (OTHER,)),
    (0.0204, ()),
    (0.0232, (SOFT,)),
]
START = 10.0


def volts(seconds: float) -> np.ndarray:
    t = np.arange(round(seconds / T)) * T
    a = 50 * np.sin(2 * np.pi * 262 * t) * np.minimum(t / 0.005, 1)
    return np.array([a, 20 * np.cos(2 * np.pi * 90 * t)])


def played(surface: ModalSurface, course: Course, drive: np.ndarray, cut: int = 300) -> None:
    """Play (patches, steps), and change the contacts between two steps, as the plant does."""
    steps = [*sorted({*(round(at / T) for at, _ in course), *range(0, drive.shape[1], cut)}), drive.shape[1]]
    lie = {round(at / T): contacts for at, contacts in course}
    for first, last in pairwise(steps):
        if first in lie and (first or lie[first]):
            surface.touched(lie[first])
        part = dict(zip("AB", drive[:, first:last], strict=True))
        surface.step(START + first * T, T, part)


class Integrated:
    """The system by Runge-Kutta, four steps to each of the staircase's."""

    def __init__(self, amplifier_hz: float, coil_hz: float | None, laser_hz: float, high_hz: float) -> None:
        self.a, self.laser, self.high = (2 * np.pi * hz for hz in (amplifier_hz, laser_hz, high_hz))
        self.coil = None if coil_hz is None else 2 * np.pi * coil_hz
        self.y = {"q": np.zeros(3), "v": np.zeros(3), "a": np.zeros(2), "c": np.zeros(2), "w": 0.0, "h": 0.0}

    def rates(self, y: dict, u: np.ndarray, contacts: tuple[Contact, ...]) -> dict:
        w = 2 * np.pi * MODES.natural_hz
        coupled = np.array(list(MODES.coupling.values())).T @ (y["a"] if self.coil is None else y["c"])
        push, out = np.zeros(3), {}
        for one in contacts:
            shape = SHAPES[one.place]
            x, v = y[one.name]
            force = one.stiffness * (shape @ y["q"] - x) + one.damping * (shape @ y["v"] - v)
            push += shape * force
            out[one.name] = np.array([v, force / one.mass])
        out["q"] = y["v"]
        out["v"] = coupled - 2 * MODES.damping * w * y["v"] - w**2 * y["q"] - push / MODES.masses
        out["a"] = self.a * (u - y["a"])
        out["c"] = (self.coil or 0.0) * (y["a"] - y["c"])
        low = self.laser * (SHAPES[0.5, 0.5] @ y["v"] - y["w"])
        out["w"], out["h"] = low, y["w"] - self.high * y["h"]
        return out

    def run(self, course: Course, drive: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Velocity at the first place, and what the laser shows of the second, at the start of each step."""
        own, seen, lie = [], [], {round(at / T): contacts for at, contacts in course}
        now: tuple[Contact, ...] = ()
        for n, u in enumerate(drive.T):
            if n in lie:
                now = lie[n]
                for one in now:
                    self.y.setdefault(one.name, np.array([SHAPES[one.place] @ self.y["q"], 0.0]))
                names = {one.name for one in now}
                self.y = {k: v for k, v in self.y.items() if len(k) == 1 or k in names}
            own.append(SHAPES[0.0, 0.0] @ self.y["v"])
            seen.append(self.y["w"] - self.high * self.y["h"])
            for _ in range(4):
                self.y = self.after(u, now, T / 4)
        return np.array(own), np.array(seen)

    def after(self, u: np.ndarray, contacts: tuple[Contact, ...], h: float) -> dict:
        def moved(by: dict, share: float) -> dict:
            return {k: value + share * by[k] for k, value in self.y.items()}

        one = self.rates(self.y, u, contacts)
        two = self.rates(moved(one, h / 2), u, contacts)
        three = self.rates(moved(two, h / 2), u, contacts)
        four = self.rates(moved(three, h), u, contacts)
        return {
            k: value + h / 6 * (one[k] + 2 * two[k] + 2 * three[k] + four[k]) for k, value in self.y.items()
        }


@pytest.mark.long
@pytest.mark.parametrize(("coil_hz", "high_hz"), [(None, 0.0), (900.0, 0.0), (700.0, 30.0)])
def test_bodies_that_come_press_harder_and_go_are_exact(coil_hz, high_hz):
    surface, drive = ModalSurface(MODES), volts(0.028)
    surface.laser_pole_hz, surface.coil_pole_hz = 2000.0, coil_hz
    surface.shows("velocity", high_hz)
    played(surface, COURSE, drive)
    times = START + T * np.arange(drive.shape[1])
    own, seen = Integrated(5000.0, coil_hz, 2000.0, high_hz).run(COURSE, drive)
    found, shown = surface.velocity((0.0, 0.0), times), surface.seen((0.5, 0.5), times)
    assert np.abs(found - own).max() < 1e-6 * np.abs(own).max()
    assert np.abs(shown - seen).max() < 1e-6 * np.abs(seen).max()
    bare = ModalSurface(MODES)
    bare.coil_pole_hz = coil_hz
    played(bare, [], drive)
    assert np.abs(bare.velocity((0.0, 0.0), times) - own).max() > 0.1 * np.abs(own).max()


@pytest.mark.parametrize("quantity", ["displacement", "acceleration"])
def test_what_another_pick_up_holds_goes_on_too(quantity):
    """A displacement has no jump when a finger comes, and an acceleration behind its low-pass none either."""
    surface, drive = ModalSurface(MODES), volts(0.015)
    surface.laser_pole_hz = 2000.0
    surface.shows(quantity, 5.0)
    played(surface, COURSE[:3], drive)
    at = START + COURSE[1][0]
    before, after = surface.seen((0.5, 0.5), np.array([at - 1e-9, at + 1e-9]))
    assert after == pytest.approx(before, rel=1e-4)
    # Against the velocity that the exact solution has, filtered by the transfer function's own recursion.
    fine = T / 16
    times = START + fine * np.arange(round(0.0149 / fine))
    velocity = surface.velocity((0.5, 0.5), times)
    low, high = 2 * np.pi * 2000.0, 2 * np.pi * 5.0
    want = np.gradient(velocity, fine) if quantity == "acceleration" else np.cumsum(velocity) * fine
    w = h = 0.0
    shown = np.empty(len(want))
    for k, value in enumerate(want):
        shown[k] = w - high * h
        w, h = w + fine * low * (value - w), h + fine * (w - high * h)
    seen = surface.seen((0.5, 0.5), times)
    assert np.abs(seen - shown).max() < 0.02 * np.abs(seen).max()


def test_what_was_long_ago_is_told_again_though_its_matrices_are_forgotten():
    """Each change of a hand has matrices of its own: with 236 modes, those of half a minute took 1 GB."""
    surface, drive = ModalSurface(MODES), volts(0.028)
    played(surface, COURSE[:2], drive)
    times = START + T * np.arange(drive.shape[1])
    before = surface.velocity((0.0, 0.0), times), surface.seen((0.5, 0.5), times)
    [owner] = {owner for owner, _ in surface._course._stretches if isinstance(owner, TouchedPoles)}
    for k in range(12):
        surface.touched([replace(HARD, stiffness=4000.0 + k)])
        surface.step(START + 0.03 + 0.01 * k, T, {"A": np.zeros(500), "B": np.zeros(500)})
    assert "_own" not in vars(owner) and not owner.poles._steps
    owner._weights.clear()
    assert np.array_equal(surface.velocity((0.0, 0.0), times), before[0])
    assert np.array_equal(surface.seen((0.5, 0.5), times), before[1])


def test_a_surface_says_what_it_does_under_a_finger():
    """The response is that of the poles: a steady tone has its size."""
    surface = ModalSurface(MODES)
    t = np.arange(60_000) * T
    drive = np.array([np.sin(2 * np.pi * 250 * t), np.zeros(len(t))])
    played(surface, [(0.0, (HARD, OTHER))], drive, 50_000)
    times = START + t[-10_000:]
    tone = surface.velocity((0.5, 0.5), times)
    size = 2 * abs(np.mean(tone * np.exp(-2j * np.pi * 250 * times)))
    expected = abs(surface.response("A", (0.5, 0.5), np.array([250.0]), START)[0]) * abs(
        1 / (1 + 250j / 5000)
    )
    assert size == pytest.approx(expected, rel=1e-3)
    surface.touched(())
    bare = surface.response("A", (0.5, 0.5), np.array([250.0]), START)
    np.testing.assert_allclose(bare, MODES.velocity("A", (0.5, 0.5), np.array([250.0])))
    assert abs(bare[0]) > 1.02 * expected


def test_a_surface_that_softens_or_tells_no_masses_refuses_a_finger():
    for surface in (
        SofteningSurface(MODES, 0.02, 1e-6),
        ModalSurface(Modes(MODES.natural_hz, MODES.damping, MODES.coupling, MODES.shape)),
    ):
        with pytest.raises(ConfigurationError, match="Nothing can rest"):
            surface.touched([SOFT])
