import numpy as np
import pytest

from haploop.mocks.plant.modal import Modes
from haploop.mocks.plant.modal_surface import ModalSurface, SofteningSurface
from haploop.mocks.plant.surface import AMPLIFIER_POLE_HZ, Surface

T = 1 / 50_000
SHAPE = np.array([0.7, 1.0, -0.8])
MODES = Modes(
    np.array([100.0, 263.5, 600.0]),
    np.array([0.01, 0.01, 0.02]),
    {"A": np.array([2.0, 5.0, 9.0])},
    lambda _place: SHAPE,
)


def driven(surface: Surface, volts: np.ndarray, cut: int, start: float = 10.0) -> None:
    for k in range(0, len(volts), cut):
        surface.step(start + k * T, T, {"A": volts[k : k + cut]})


def stepped(volts: np.ndarray, share: float, amplitude: float, late: float) -> np.ndarray:
    """The same by Runge-Kutta, four steps to each of the staircase's, `late` s after each of its steps."""
    w, a = 2 * np.pi * MODES.natural_hz, 2 * np.pi * AMPLIFIER_POLE_HZ
    y, seen = np.zeros(7), np.empty(len(volts))

    def rates(y: np.ndarray, u: float) -> np.ndarray:
        q, p, v = y[:3], y[3:6], y[6]
        x2 = (q / amplitude) ** 2
        spring = w**2 * q * (1 - share * x2 / (1 + x2))
        return np.concatenate(
            [p, MODES.coupling["A"] * v - 2 * MODES.damping * w * p - spring, [a * (u - v)]]
        )

    def after(y: np.ndarray, u: float, h: float) -> np.ndarray:
        one = rates(y, u)
        two = rates(y + h / 2 * one, u)
        three = rates(y + h / 2 * two, u)
        return y + h / 6 * (one + 2 * two + 2 * three + rates(y + h * three, u))

    for n, u in enumerate(volts):
        seen[n] = SHAPE @ after(y, u, late)[3:6]
        for _ in range(4):
            y = after(y, u, T / 4)
    return seen


@pytest.mark.long
def test_it_moves_as_a_numerical_integration_does():
    t = np.arange(3000) * T
    volts = 50 * np.sin(2 * np.pi * 262 * t) * np.minimum(t / 0.01, 1) * (t < 0.045)
    surface, linear = SofteningSurface(MODES, 0.02, 1e-3), ModalSurface(MODES)
    for each in (surface, linear):
        driven(each, volts, 1500)
    times = 10 + np.arange(3000) * T + 7e-6
    known = stepped(volts, surface._share, 1e-3, 7e-6)
    own, without = (each.velocity((0, 0), times) for each in (surface, linear))
    assert np.linalg.norm(own - known) < 1e-3 * np.linalg.norm(known)
    assert np.linalg.norm(without - known) > 0.2 * np.linalg.norm(known)
    # The low-pass that any surface inherits is the exact one.
    seen = surface.seen((0, 0), times)
    assert np.linalg.norm(Surface.seen(surface, (0, 0), times) - seen) < 1e-4 * np.linalg.norm(seen)


@pytest.mark.parametrize("softening", [0.005, 0.05])
def test_its_frequency_falls_by_what_was_asked_for(softening):
    """Free decay of one mode, whose period is counted where its amplitude is the nominal one."""
    modes = Modes(np.array([200.0]), np.array([1e-4]), {"A": np.ones(1)}, lambda _place: np.ones(1))
    w = 2 * np.pi * 200.0
    amplitude = 1.0
    # A volt step of this height leaves the mode swinging about zero with the nominal amplitude, nearly.
    surface = SofteningSurface(modes, softening, amplitude)
    volts = np.zeros(12_000)
    volts[:125] = amplitude * w**2 / 2
    driven(surface, volts, 12_000)
    times = 10 + np.arange(2000, 12_000) * T
    moving = surface.velocity((0, 0), times)
    up = np.flatnonzero((moving[:-1] < 0) & (moving[1:] >= 0))
    crossing = times[up] + T * moving[up] / (moving[up] - moving[up + 1])
    measured = 1 / np.diff(crossing).mean()
    swing = np.abs(moving).max() / (2 * np.pi * measured)
    x2 = np.sin(np.linspace(0, 2 * np.pi, 1000, endpoint=False)) ** 2
    lost = 2 * np.mean(x2 * (swing / amplitude) ** 2 * x2 / (1 + (swing / amplitude) ** 2 * x2))
    assert 0.7 < swing < 1.4
    assert measured / 200 - 1 == pytest.approx(-softening * lost / (np.sqrt(2) - 1), rel=0.05)


@pytest.mark.long
def test_small_motion_is_the_tables(open):
    """And the rig that softens falls in frequency as it is driven harder."""
    t = np.arange(20_000) * T
    shape = np.sin(2 * np.pi * (240 + 60 * t) * t) * np.hanning(20_000)
    soft, table = (open(softening=value, hysteresis=0, vibrometer_noise_scale=0) for value in (0.02, 0.0))
    off = []
    for volts in (0.5, 45.0):
        one, two = (rig.excite(volts * shape, ["A"], ["laser"]).volts[0] for rig in (soft, table))
        off.append(float(np.linalg.norm(one - two) / np.linalg.norm(two)))
    assert off[0] < 0.05
    assert off[1] > 0.2
    assert soft.simulation.truth.resonance_hz == table.simulation.truth.resonance_hz
