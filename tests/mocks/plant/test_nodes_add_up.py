"""A node with two outputs, such as a DAQ's and a generator's: they add up, on whatever clocks they play."""

import numpy as np
import pytest

from haploop.base.clock import VirtualClock
from haploop.instruments import load_rig_file
from haploop.mocks.plant import Plant
from haploop.mocks.plant.plant import AMPLIFIER_GAIN
from haploop.nidaqmx_twin.nodes import Run


class Card:
    """An output that plays what it is given."""

    def __init__(self, *runs: Run) -> None:
        self.runs = list(runs)

    def take(self, until: float) -> list[Run]:
        due = [run for run in self.runs if run.start <= until]
        self.runs = [run for run in self.runs if run.start > until]
        return due


class Box(Card):
    """An output of another kind."""


def put_out(*sources: Card, until: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Times and V at the amplifier's output of all that was played until then."""
    plant = Plant(load_rig_file("simulated"), VirtualClock())
    record = plant.truth.record()
    for source in sources:
        plant.drive("amplifier", source)
    plant.clock.sleep(until)
    plant.advance(until)
    times = [Run(one.start, one.period, one.volts).times for one in record]
    return np.concatenate(times), np.concatenate([one.volts for one in record])


def at(times: np.ndarray, volts: np.ndarray, when: float) -> float:
    return float(volts[np.searchsorted(times, when, side="right") - 1])


def test_what_is_held_at_one_output_is_added_to_what_another_plays():
    held = Card(Run(0.1, np.inf, np.array([0.5])))
    wave = Box(Run(0.2, 1e-3, np.array([0.1, 0.2, 0.3, 0.0])))
    times, volts = put_out(held, wave)
    gain = at(times, volts, 0.15) / 0.5
    assert gain == pytest.approx(AMPLIFIER_GAIN, rel=0.02)
    for when, expected in ((0.2, 0.6), (0.2015, 0.7), (0.2025, 0.8), (0.5, 0.5)):
        assert at(times, volts, when + 1e-9) == pytest.approx(gain * expected, rel=1e-12)


def test_outputs_on_different_clocks_play_at_the_same_time():
    fast = Card(Run(0.1, 1e-5, np.sin(np.arange(20_000) / 50.0)))
    slow = Box(Run(0.15, 3.7e-4, np.linspace(0, 1, 200)), Run(0.28, np.inf, np.array([-0.25])))
    times, volts = put_out(fast, slow)
    assert np.all(np.diff(times) > 0)
    gain = at(times, volts, 0.9) / (np.sin(19_999 / 50.0) - 0.25)
    for when in np.arange(0.1003, 0.299, 0.0007):
        one = np.sin(round((when - 0.1) / 1e-5 - 0.5) / 50.0)
        two = 0.0 if when < 0.15 else min((when - 0.15) // 3.7e-4, 199) / 199 if when < 0.28 else -0.25
        # Up to one step of either clock off.
        assert at(times, volts, when) == pytest.approx(gain * (one + two), abs=gain * 0.03)


def test_an_output_of_the_same_kind_takes_the_place_of_the_one_before():
    times, volts = put_out(Card(Run(0.1, np.inf, np.array([0.5]))), Card(Run(0.2, np.inf, np.array([0.25]))))
    assert len(times) == 1 and volts[0] == pytest.approx(0.25 * AMPLIFIER_GAIN, rel=0.02)


@pytest.mark.parametrize("first", [True, False])
def test_of_steps_at_one_instant_the_last_to_come_holds(first):
    """A card goes to zero and begins to play at one instant of a virtual clock, or the other way round."""
    zero = Run(0.1, np.inf, np.zeros(1))
    wave = Run(0.1, 1e-3, np.array([0.5, 0.5, 0.5]))
    times, volts = put_out(Card(zero, wave) if first else Card(wave, zero))
    assert at(times, volts, 0.5) == pytest.approx(0.5 * AMPLIFIER_GAIN if first else 0, rel=0.02, abs=1e-9)
