import numpy as np
import pytest

from haploop.instruments.operator.role import Press
from haploop.mocks.plant.buttons import (
    BUTTONS,
    FLAWS,
    Finger,
    Flaw,
    SimulatedPress,
    button_named,
    press_button,
)


def press(button: str, seed: int = 0, start: float = 5.0, flaw: Flaw = "") -> SimulatedPress:
    rng = np.random.default_rng(seed)
    return press_button(button_named(button), Finger.of(rng), Press(button, "P01", 1, 1), start, rng, flaw)


def test_forces_at_activation_keep_the_papers_order_for_every_finger():
    for seed in range(50):
        force = {name: press(name, seed).activation_force for name in BUTTONS}
        assert force["latch"] > force["push"] > force["toggle"] > 1


@pytest.mark.parametrize("name", BUTTONS)
def test_force_falls_at_the_snap_and_activation_lies_behind_it(name):
    p = press(name)
    down = np.linspace(p.start, p.start + 0.6 * (p.stop - p.start), 5000)
    force = p.force(down)
    falling = down[1:][np.diff(force) < 0]
    assert falling[0] < p.activation_time
    assert p.activation_force < force[down < p.activation_time].max()


def test_a_press_begins_and_ends_at_rest():
    for name in BUTTONS:
        p = press(name)
        ends = np.array([p.start - 0.01, p.start, p.stop, p.stop + 0.01])
        np.testing.assert_allclose(p.force(ends), 0, atol=1e-9)
        assert abs(p.acceleration(np.array([p.stop + 0.2]))[0]) < 0.01


def test_the_latch_clicks_twice_and_stays_and_a_momentary_contact_returns():
    for seed in range(20):
        first, second = (at for at, _, _ in press("latch", seed)._clicks)
        assert 0.03 < second - first < 0.1
        assert len(press("latch", seed).flips) % 2 == 1
        assert len(press("push", seed).flips) % 2 == 0
        assert press("push", seed).release_time is not None


def test_a_button_that_the_paper_has_not_is_a_button_too_and_always_the_same():
    assert button_named("doorbell") == button_named("doorbell")
    assert press("doorbell").activation_force > 1


def test_each_flaw_is_what_its_name_says():
    for name in BUTTONS:
        good, made = press(name, 3), {flaw: press(name, 3, flaw=flaw) for flaw in FLAWS}
        assert made["soft"].activation_time is None and not len(made["soft"].flips)
        assert made["double"].activation_force == pytest.approx(good.activation_force)
        times = np.linspace(good.start - 1, good.stop + 2, 100_000)
        shaken = {flaw: np.abs(one.acceleration(times)).max() for flaw, one in {"": good, **made}.items()}
        assert shaken["hard"] > 30 > shaken[""] > shaken["soft"]
        for flaw in ("leaning", "lingering"):
            force = made[flaw].force(times)
            light = (force > 0.3) & (force < 0.9)
            assert 0.4 < np.count_nonzero(light) * (times[1] - times[0]) < 1.2
            ends = np.array([made[flaw].start - 1e-3, made[flaw].stop + 1e-3])
            np.testing.assert_allclose(made[flaw].force(ends), 0, atol=1e-9)
        assert made["leaning"].activation_time > good.activation_time + 0.4
        assert made["lingering"].stop > good.stop + 0.4
