from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haploop.mocks.plant.hysteresis import _RADII, Hysteresis, _bent
from haploop.mocks.plant.modal import Modes
from haploop.mocks.plant.modal_surface import ModalSurface
from haploop.mocks.plant.scene import Patches
from haploop.mocks.plant.surface import AMPLIFIER_POLE_HZ
from haploop.mocks.plant.table import FEWEST_HZ, HIGHEST_HZ, MAIN, PATCHES, make_plate, warmed

PLACE = (8.5 / 12, 1.5 / 7)
RATE_HZ = 50_000.0
LASER_HZ = 5000.0


@pytest.fixture(scope="module")
def plate() -> Modes:
    return make_plate(np.random.default_rng(0))


class Table:
    """A surface of modes with its patches, as a plant steps them."""

    def __init__(self, modes: Modes | Callable[[float], Modes], width: float, every: float = np.inf) -> None:
        self.surface = ModalSurface(modes, every)
        self.surface.laser_pole_hz = LASER_HZ
        self.patches = Patches({patch: Hysteresis(width) for patch in "ABCD"})

    def step(self, start: float, period: float, volts: dict[str, np.ndarray]) -> None:
        self.surface.step(start, period, self.patches.step(start, period, volts))


def swing(table: Table, volts: np.ndarray, cuts: list[int], start: float = 10.0) -> None:
    rest = np.zeros(len(volts))
    for a, b in zip([0, *cuts], [*cuts, len(volts)], strict=True):
        if b > a:
            steps = {p: volts[a:b] if p == "A" else rest[a:b] for p in "ABCD"}
            table.step(start + a / RATE_HZ, 1 / RATE_HZ, steps)


@pytest.mark.parametrize(("highest_hz", "count"), [(FEWEST_HZ, 17), (HIGHEST_HZ, 236)])
def test_the_staircase_response_is_the_plates_own(highest_hz, count):
    """A whole record's FFT ratio equals plate x staircase x amplifier x laser to a few 1e-5."""
    plate = make_plate(np.random.default_rng(0), highest_hz=highest_hz)
    assert len(plate.natural_hz) == count
    table, n = Table(plate, 0.0), 100_000
    t = np.arange(n) / RATE_HZ
    volts = 50 * np.sin(np.pi * 625 * t**2) * (t < 1)
    swing(table, volts, [5000, 5001, 40_000])
    late = 14e-6
    velocity = table.surface.seen(PLACE, 10 + t + late)
    f = np.fft.rfftfreq(n, 1 / RATE_HZ)
    band = (f > 60) & (f < 600)
    measured = (np.fft.rfft(velocity) / np.fft.rfft(volts))[band]
    f = f[band]
    stairs = np.sinc(f / RATE_HZ) * np.exp(-1j * np.pi * f / RATE_HZ + 2j * np.pi * f * late)
    poles = 1 / (1 + 1j * f / AMPLIFIER_POLE_HZ) / (1 + 1j * f / LASER_HZ / 1.0001)
    truth = plate.velocity("A", PLACE, f) * stairs * poles
    # What still rings at the record's end is all that the ratio cannot know.
    assert np.linalg.norm(measured - truth) < 2e-3 * np.linalg.norm(truth)


def test_a_seed_s_lowest_modes_are_the_same_with_fewer_above(plate):
    few = make_plate(np.random.default_rng(0), highest_hz=FEWEST_HZ)
    np.testing.assert_array_equal(plate.natural_hz[:17], few.natural_hz)
    np.testing.assert_array_equal(plate.damping[:17], few.damping)
    np.testing.assert_allclose(plate.coupling["B"][:17], few.coupling["B"], rtol=1e-12)
    assert 9000 < plate.natural_hz.max() < 10_500 and plate.damping[17:].min() > 0.02
    assert plate.damping.max() < 0.03


def test_a_motion_that_is_forgotten_is_no_longer_told(plate):
    table = Table(plate, 0.0)
    for start in (10.0, 30.0, 60.0):
        swing(table, np.array([1.0, 0.0]), [], start=start)
    table.surface.velocity(PLACE, np.array([30.0]))
    with pytest.raises(ValueError, match=r"remembered: .* 30 s"):
        table.surface.velocity(PLACE, np.array([9.0]))


def test_how_the_drive_is_cut_into_steps_changes_nothing(plate):
    rng = np.random.default_rng(1)
    volts = 40 * rng.uniform(-1, 1, 3000)
    times = 10 + np.sort(rng.uniform(0, 0.07, 500))
    whole, cut = Table(plate, 0.12), Table(plate, 0.12)
    swing(whole, volts, [])
    swing(cut, volts, [1, 2, 700, 701, 2999])
    np.testing.assert_allclose(
        cut.surface.seen(PLACE, times), whole.surface.seen(PLACE, times), atol=1e-12 + 1e-9 * 50e-6
    )
    np.testing.assert_allclose(cut.patches.voltage("A", times), whole.patches.voltage("A", times), atol=1e-9)


def test_patch_a_drives_the_main_mode_best_whatever_the_seed():
    for seed in range(20):
        plate = make_plate(np.random.default_rng(seed))
        main = plate.natural_hz[[MAIN]]
        assert abs(main[0] - 263.5) < 3
        best = {p: abs(plate.velocity(p, PLACE, main)[0]) for p in "ABCD"}
        assert max(best, key=best.__getitem__) == "A"
        everywhere = np.abs(plate.velocity("A", PLACE, np.arange(30.0, 620.0, 0.5)))
        assert abs(np.arange(30.0, 620.0, 0.5)[everywhere.argmax()] - main[0]) < 2


def test_patch_and_point_apart_give_zeros_in_the_right_half_plane():
    """So that inverting the response as a stable filter fails, as it does on real tables."""

    def zeros(plate, place):
        w, zeta = plate.natural_hz / 1e3, plate.damping
        modes = [np.array([1, 2 * z * x, x * x]) for z, x in zip(zeta, w, strict=True)]
        strength = plate.shape(place) * plate.coupling["A"]
        total = np.zeros(1)
        for k, s in enumerate(strength):
            others = np.array([1.0])
            for j, mode in enumerate(modes):
                if j != k:
                    others = np.convolve(others, mode)
            total = np.polyadd(total, s * others)
        return np.roots(total)

    for seed in range(10):
        plate = make_plate(np.random.default_rng(seed), highest_hz=FEWEST_HZ)
        assert (zeros(plate, PLACE).real > 1e-6).any()
        assert not (zeros(plate, PATCHES["A"]).real > 1e-6).any()


@given(st.lists(st.floats(-60, 60), min_size=1, max_size=60), st.integers(0, 60))
def test_hysteresis_equals_its_definition_step_by_step(path, cut):
    volts = np.array(path)
    patch, plain = Hysteresis(0.12), Hysteresis(0.12)
    linear_volts = np.concatenate([patch.follow(v) for v in (volts[:cut], volts[cut:]) if len(v)])
    play, expected = np.zeros(len(_RADII)), []
    for v in volts:
        play = np.clip(play, v - _RADII, v + _RADII)
        expected.append(plain._linear * v + plain._weights @ play)
    np.testing.assert_allclose(linear_volts, _bent(np.array(expected)), atol=1e-9)


def test_a_table_that_warms_at_rest_stays_at_rest_and_rings_as_it_then_is(plate):
    """With the linear_volts that the patch kept of an earlier drive."""
    rng = np.random.default_rng(2)
    before, volts = 40 * rng.uniform(-1, 1, 3000), 40 * rng.uniform(-1, 1, 3000)
    later = replace(plate, natural_hz=1.01 * plate.natural_hz)
    warm = Table(lambda time: plate if time < 30 else later, 0.12, every=10.0)
    new = Table(later, 0.12)
    for table in (warm, new):
        swing(table, np.append(before, 0.0), [])
        swing(table, np.zeros(1), [], start=20.0)
    swing(warm, np.zeros(1), [], start=30.0)
    at = 30 + np.arange(3000) / RATE_HZ
    assert np.abs(warm.surface.seen(PLACE, at)).max() < 1e-12
    for table in (warm, new):
        swing(table, volts, [700], start=31.0)
    times = 31 + np.arange(4000) / RATE_HZ
    np.testing.assert_allclose(warm.surface.seen(PLACE, times), new.surface.seen(PLACE, times), atol=1e-10)
    assert np.abs(warm.surface.seen(PLACE, times)).max() > 1e-4


def test_a_day_brings_every_mode_back(plate):
    share = [warmed(plate, hour * 3600.0, 0.01, 3).natural_hz / plate.natural_hz - 1 for hour in range(49)]
    assert all(np.ptp(s) < 1e-12 for s in share)
    course = np.array([s[0] for s in share])
    assert 0.009 < course.max() < 0.0111 and -0.0111 < course.min() < -0.009
    assert np.abs(np.diff(course)).max() < 0.005, "no step is mistaken for a broken table"
    np.testing.assert_array_equal(warmed(plate, 1e5, 0.0, 3).natural_hz, plate.natural_hz)


def test_a_drift_of_the_modes_is_of_their_frequencies_alone(plate):
    drifted = make_plate(np.random.default_rng(0), 0.02)
    np.testing.assert_allclose(drifted.natural_hz, 1.02 * plate.natural_hz)
    np.testing.assert_array_equal(drifted.damping, plate.damping)
    for patch, force in plate.coupling.items():
        np.testing.assert_array_equal(drifted.coupling[patch], force)
    # At rest, all modes together: a displacement per volt of 1 / 1.02^2.
    still = np.array([1e-3])
    moved, before = (one.velocity("A", PLACE, still)[0] for one in (drifted, plate))
    assert abs(moved / before) == pytest.approx(1.02**-2, rel=1e-4)
