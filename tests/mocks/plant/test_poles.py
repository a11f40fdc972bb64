"""Against the recursion from step to step, which is slow and plain."""

import numpy as np
import pytest

from haploop.mocks.plant.poles import Poles, Stretch

PERIOD = 2e-5
WEIGHTS = np.array([0.3 - 1j, 2.0, 0.1j])


def made(shift: float = 0.0) -> Poles:
    poles = 2 * np.pi * np.array([263.5 * (1j - 0.01), 900 * (1j - 0.02), -5000.0]) * (1 + shift)
    return Poles(poles, np.array([[1.0, -0.4, 0.0], [0.0, 2.0, 0.0], [1.0, 1.0, 3.0]]))


def stepped(of: Poles, levels: np.ndarray, begin: np.ndarray, times: np.ndarray) -> np.ndarray:
    """(poles, times): the states at times (s) from the beginning."""
    decay, states = np.exp(of.poles * PERIOD), [begin]
    for level in levels.T:
        states.append(decay * states[-1] + (decay - 1) / of.poles * (of.inputs @ level))
    step = np.minimum((times / PERIOD + 1e-6).astype(int), levels.shape[1] - 1)
    kept = np.exp(of.poles[:, None] * (times - step * PERIOD))
    forced = of.inputs @ levels[:, step] / of.poles[:, None]
    return np.asarray(kept * np.array(states)[step].T + (kept - 1) * forced)


def levels(kind: str, steps: int, rng: np.random.Generator) -> np.ndarray:
    found = np.repeat(rng.uniform(-50, 50, (3, 1)), steps, axis=1)
    if kind != "held":
        found[0] = rng.uniform(-50, 50, steps)
    if kind == "all move":
        found[1:] = rng.uniform(-50, 50, (2, steps))
    return found


@pytest.mark.parametrize("kind", ["held", "one moves", "all move"])
@pytest.mark.parametrize("steps", [1, 64, 65, 700])
def test_any_time_is_what_the_recursion_gives(kind, steps):
    """A stretch that begins where another, of other poles, has left it; sampled evenly, seldom, or anyhow."""
    rng = np.random.default_rng(steps)
    first, second = made(), made(0.01)
    before, own = levels("all move", 300, rng), levels(kind, steps, rng)
    one = Stretch(first, 10.0, PERIOD, before)
    two = Stretch(second, 10.0 + 310 * PERIOD, PERIOD, own, one)
    left = stepped(first, before, np.zeros(3, complex), np.array([310 * PERIOD]))[:, 0]
    # Under the levels that it has, a state that leans nowhere does not lean when the poles change.
    rest = first.inputs @ before[:, -1]
    begin = left + rest / first.poles - rest / second.poles
    end = steps * PERIOD
    for times in (np.arange(steps) * PERIOD + 14e-6, np.arange(0, end, 10 * PERIOD) + 3e-6,
        np.sort(rng.uniform(0, end + 0.01, 200)), end + np.arange(300) * PERIOD,
        np.array([0.4 * end])):  # fmt: skip
        wanted = (WEIGHTS @ stepped(second, own, begin, times)).real
        found = two.seen(10.0 + 310 * PERIOD + times, WEIGHTS)
        np.testing.assert_allclose(found, wanted, atol=2e-9 * np.abs(wanted).max())


def test_what_has_died_away_is_rest():
    of = made()
    one = Stretch(of, 0.0, PERIOD, np.array([[1.0, 0.0], [0.0, 0.0], [0.0, 0.0]]))
    two = Stretch(of, 100.0, PERIOD, np.zeros((3, 5)), one)
    assert not np.any(two.seen(100.0 + np.arange(500) * PERIOD, WEIGHTS))


def test_what_is_kept_of_one_view_is_no_part_of_another():
    """Other weights, another lateness, another period, and weights in the memory of some that are gone."""
    rng = np.random.default_rng(1)
    shared, moves = made(), levels("all move", 200, rng)
    for period in (PERIOD, 2 * PERIOD, PERIOD):
        for number in range(24):
            weights, late = WEIGHTS * (1 + number // 2), (2 + number % 2) * 1e-6
            times = 5.0 + np.arange(200) * period + late
            alone = Stretch(made(), 5.0, period, moves).seen(times, weights)
            np.testing.assert_array_equal(Stretch(shared, 5.0, period, moves).seen(times, weights), alone)
