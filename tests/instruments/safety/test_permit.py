"""The limiter by itself: what a permit lets an instrument do, once, and what it keeps of that."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from haploop.base.clock import VirtualClock
from haploop.base.errors import InstrumentError, LimitError
from haploop.instruments import Arbitrary, Burst, Limits, Sweep, Waveform, load_rig_file
from haploop.instruments.amplifier.e413 import E413
from haploop.instruments.interlock import Interlocked
from haploop.instruments.safety import Audit, Limiter, Lockouts, Outputs, entries
from haploop.instruments.safety.duty import plays_of
from haploop.instruments.safety.judge import Ratings
from tests.raising import raises

RATE = 1000.0
LIMITS = Limits(min=-50.0, max=50.0, slew=1e5)
DRIVE = np.array([0.0, 10.0, 20.0, -10.0, 0.0])
SWEEP = Sweep(10.0, 100.0, 0.5, 10.0)


class World:
    """A limiter, and outputs that are what a test sets."""

    def __init__(self, folder: Path) -> None:
        self.clock = VirtualClock()
        self.audit = Audit(load_rig_file("simulated"), folder / "log", True)
        self.held: list[bool] = []
        self.standing = {"one": 0.0}
        self.generator = SimpleNamespace(output="one", identity="A generator", is_on=False)
        self.amplifier = E413.open(E413.Settings(input="one", gain=50), self.clock)
        daq = SimpleNamespace(
            hold=lambda: self.held.append(True),
            let_go=lambda: self.held.append(False),
            outputs_read=lambda: self.standing,
        )
        roles = {"daq": daq, "generator": self.generator, "amplifier": self.amplifier}
        self.outputs = Outputs(roles)
        self.counted = folder / "counted"
        self.counted.mkdir()
        lockouts = Lockouts(folder / "locks", {"card"}, self.audit)
        self.limiter = Limiter(self.clock, lockouts, self.outputs, self.counted)

    def permit(self, drives: Any = None, patches: Any = ("A",), limits: Limits = LIMITS) -> Any:
        drives = {"one": DRIVE} if drives is None else drives
        return self.limiter.permit(drives, RATE, patches, self.amplifier, rated(limits))

    def permit_waveform(self, sweep: Waveform = SWEEP, limits: Limits = LIMITS, rest: float = 0.25) -> Any:
        return self.limiter.permit_waveform("one", sweep, rest, ("A",), self.amplifier, rated(limits))

    @property
    def kinds(self) -> list[str]:
        return [str(entry["kind"]) for entry in entries(self.audit.folder)]


def rated(limits: Limits) -> Callable[[int], Ratings]:
    return lambda _count: {"the rig": limits}


@pytest.fixture
def world(tmp_path: Path) -> World:
    return World(tmp_path)


def refused(says: str, call: Any, *args: Any) -> None:
    raises(LimitError, says, call, *args)


def not_permitted(permit: Any, says: str) -> None:
    with pytest.raises(LimitError, match=says), permit:
        pass


def test_a_permitted_drive_starts_once_and_no_other(world):
    with world.permit() as volts:
        at_output = volts["one"]
        np.testing.assert_array_equal(at_output, DRIVE / 50)
        padded = np.pad(at_output, (0, 7))
        for wrong in (at_output * 1.001, at_output[:-1], at_output[1:], np.append(padded, 1e-9)):
            refused("has authorised", world.limiter.authorise, "one", wrong, RATE)
        for output, rate_hz in (("two", RATE), ("one", RATE * 2)):
            refused("has authorised", world.limiter.authorise, output, at_output, rate_hz)
        refused("has authorised", world.limiter.authorise_waveform, "one", SWEEP, False)
        world.limiter.authorise("one", padded, RATE)
        refused("has authorised", world.limiter.authorise, "one", padded, RATE)  # a restart would cut it off
    refused("has authorised", world.limiter.authorise, "one", padded, RATE)
    with world.permit():  # and again for the next
        world.limiter.authorise("one", padded, RATE)


def test_what_was_judged_is_a_copy_whatever_the_amplifier_returns(world):
    drive = DRIVE.copy()
    amplifier: Any = SimpleNamespace(to_input=lambda volts: volts, sharing=len)
    with world.limiter.permit({"one": drive}, RATE, ("A",), amplifier, rated(LIMITS)) as volts:
        drive[:] = 400.0
        np.testing.assert_array_equal(volts["one"], DRIVE)
        refused("has authorised", world.limiter.authorise, "one", drive, RATE)


def test_one_drive_is_held_to_the_limits_of_all_its_patches_and_several_to_those_of_one(world):
    def ratings(count: int) -> Ratings:
        return {"the rig": replace(LIMITS, max=25.0 / count)}

    def permit(outputs: Mapping[str, str] | str) -> Any:
        amplifier = E413.open(E413.Settings(input=outputs, gain=50), world.clock)
        drives = dict.fromkeys(["one"] if outputs == "one" else ["one", "two"], DRIVE)
        return world.limiter.permit(drives, RATE, ("A", "B"), amplifier, ratings)

    not_permitted(permit("one"), r"rises to 20 V at sample 2, 7\.5 V beyond")
    with permit({"A": "one", "B": "two"}) as volts:
        assert set(volts) == {"one", "two"}


def test_several_outputs_start_once_each(world):
    drives = {"one": DRIVE, "two": DRIVE / 2}
    with world.permit(drives, ("A", "B")) as volts:
        world.limiter.authorise("one", volts["one"], RATE)
        world.generator.is_on = True  # asked before the first of them only: the others must keep up
        world.limiter.authorise("two", volts["two"], RATE)
        for output in drives:
            refused("has authorised", world.limiter.authorise, output, volts[output], RATE)
    not_permitted(world.permit({"one": DRIVE, "two": DRIVE[:3]}), "must be of one length")


def test_a_generator_that_is_switched_on_after_the_permit_keeps_the_drive_from_starting(world):
    with world.permit() as volts:
        world.limiter.authorise_patches(frozenset({"A"}))
        world.generator.is_on = True
        with pytest.raises(InstrumentError, match="A generator is on, and this rig has not started it"):
            world.limiter.authorise("one", volts["one"], RATE)
    assert world.kinds == ["played", "connected", "refused"]


def test_the_relay_closes_for_a_permit_s_patches_until_it_plays(world):
    world.limiter.authorise_patches(frozenset({"A", "B"}))  # with nothing permitted, any
    with world.permit(patches=("A", "C")) as volts:
        with pytest.raises(LimitError, match="not switched to A, B: a drive is being played into A, C"):
            world.limiter.authorise_patches(frozenset({"A", "B"}))
        world.limiter.authorise_patches(frozenset({"A", "C"}))
        world.limiter.authorise_patches(frozenset({"A"}))
        world.limiter.authorise("one", volts["one"], RATE)
        refused("the relay only opens", world.limiter.authorise_patches, frozenset({"A"}))
        world.limiter.authorise_patches(frozenset())
    world.limiter.authorise_patches(frozenset({"A"}))
    world.standing["one"] = 0.03
    raises(InstrumentError, r"reads 0\.03 V", world.limiter.authorise_patches, frozenset({"A"}))
    world.standing["one"] = -0.02
    world.limiter.authorise_patches(frozenset({"A"}))


def test_a_sweep_starts_once_and_is_set_as_often_as_needed(world):
    with world.permit_waveform() as at_output:
        assert at_output == replace(SWEEP, amplitude=0.2)
        refused("has authorised", world.limiter.authorise_waveform, "one", SWEEP, False)
        world.generator.is_on = True
        raises(InstrumentError, "is on", world.limiter.authorise_waveform, "one", at_output, False)
        world.generator.is_on = False
        for starts in (False, False, True):
            world.limiter.authorise_waveform("one", at_output, starts)
        for starts in (False, True):
            refused("has authorised", world.limiter.authorise_waveform, "one", at_output, starts)
        refused("the relay only opens", world.limiter.authorise_patches, frozenset({"A"}))
        refused("has authorised", world.limiter.authorise, "one", DRIVE / 50, 0.0)


def test_one_permit_at_a_time(world):
    with world.permit():
        for second in (world.permit(), world.permit_waveform()):
            not_permitted(second, "A drive is being played: wait")
    with world.permit():
        pass


# By hand: a linear sweep is fastest at its end, where it turns by 2 pi stop_hz.
FASTEST = 2 * np.pi * 100.0 * 10.0


BURST = Burst(100.0, 20, 10.0)
STAIRS = Arbitrary(np.array([0.0, 0.0, 2.0, 6.0, 10.0, 5.0, -3.0, -8.0, 0.0, 0.0]), 100.0)  # 0.1 s


@pytest.mark.parametrize(("waveform", "limits", "told"), [
    *((SWEEP, limits, "") for limits in (
        Limits(slew=1.01 * FASTEST), Limits(max=10.001), Limits(max_duration=0.751),
        Limits(duty=0.751 / 60), Limits(max_end=0.001, max_offset=1e-6),
    )),
    (SWEEP, Limits(slew=0.98 * FASTEST), "slews"),
    (SWEEP, Limits(max=9.97), "rises to"),
    (SWEEP, Limits(min=-9.97), "falls to"),
    (SWEEP, Limits(max_duration=0.74), "lasts"),
    (SWEEP, Limits(max_duration=0.5), "lasts"),
    (SWEEP, Limits(duty=0.749 / 60), "of a minute"),
    (BURST, Limits(slew=1.01 * FASTEST, max_duration=0.2, duty=0.2001 / 60, max_end=0, max_offset=1e-9), ""),
    (BURST, Limits(slew=0.98 * FASTEST), "slews"),
    (BURST, Limits(max=9.97), "rises to"),
    (BURST, Limits(min=-9.97), "falls to"),
    (BURST, Limits(peak_to_peak=19.9), "peak-to-peak"),
    (BURST, Limits(max_duration=0.199), "lasts"),
    (BURST, Limits(duty=0.199 / 60), "of a minute"),
    (STAIRS, Limits(max=10, min=-8, max_end=0, max_duration=0.06, duty=0.0601 / 60, slew=8.001 * 5e4), ""),
    (STAIRS, Limits(max=9.99), "rises to"),
    (STAIRS, Limits(min=-7.99), "falls to"),
    (STAIRS, Limits(slew=7.99 * 5e4), "slews"),
    (STAIRS, Limits(max_offset=1.9), "offset"),
    (STAIRS, Limits(max_duration=0.059), "lasts"),
    (STAIRS, Limits(duty=0.059 / 60), "of a minute"),
    # It goes on at its start frequency after its end, until it is switched off.
    (Sweep(1.0, 2.0, 0.1, 80.0), Limits(max=79.8), "rises to"),
], ids=str)  # fmt: skip
def test_a_waveform_is_held_to_limits(world, waveform, limits, told):
    permit = world.permit_waveform(waveform, limits=limits)
    if told:
        not_permitted(permit, told)
    else:
        with permit as at_output:
            assert at_output.amplitude == pytest.approx(0.2)
            assert world.limiter.authorise_waveform("one", at_output, True) is None
    assert world.kinds == ["refused" if told else "played"]


@dataclass(frozen=True)
class Foreign:
    """A waveform of another package: half a sine, and whatever it states."""

    amplitude: float = 10.0
    duration: float = 0.1
    duty: float = 1.0
    goes_on: bool = False
    truly: float = 1.0

    def sampled(self, rest: float) -> tuple[Any, float]:
        return self.truly * self.amplitude * np.sin(np.linspace(0, np.pi, 101) % np.pi), 1000.0

    def scaled(self, factor: float) -> Foreign:
        return replace(self, amplitude=factor * self.amplitude)


def test_a_waveform_of_another_package_is_judged_too(world):
    with world.permit_waveform(Foreign()) as at_output:
        world.limiter.authorise_waveform("one", at_output, True)
    not_permitted(world.permit_waveform(Foreign(), Limits(max=9.9)), "rises to 10 V")


@pytest.mark.parametrize(
    "lying", [Foreign(truly=1.1), Foreign(duration=0.05), Foreign(duty=0.5), Foreign(truly=np.nan)]
)
def test_a_waveform_that_states_less_than_it_plays_is_refused(world, lying):
    not_permitted(world.permit_waveform(lying), r"it states .* Ask the author of Foreign")
    assert world.kinds == ["refused"]


@pytest.mark.parametrize("samples", [(np.zeros(0), 1000.0), (np.ones(5), 0.0), (["volts"], 1.0), None])
def test_a_waveform_that_is_not_judged(world, samples, monkeypatch):
    monkeypatch.setattr(Foreign, "sampled", lambda *_: samples)
    not_permitted(world.permit_waveform(Foreign()), r"A Foreign was refused, because it cannot be judged \(")
    assert world.kinds == ["refused"]


def test_what_is_played_is_counted_before_it_begins_and_as_it_was(world):
    def counted() -> list[float]:
        now = world.clock.now()
        return [round(stop - start, 3) for start, stop in plays_of(world.counted, {"card"}, now + 0.5)]

    limits = replace(LIMITS, duty=1.0 / 60)
    long = np.sin(np.arange(600) / 3)
    not_permitted(world.permit({"one": long}, limits=Limits(duty=0.5 / 60)), "play a shorter one")
    with world.permit({"one": long}, limits=limits):
        assert counted() == [0.599]  # its first sample is zero
        world.clock.sleep(0.2)
    assert counted() == [0.2]  # it was stopped after that
    with world.permit({"one": long}, limits=limits):
        world.clock.sleep(0.7)
    assert counted() == [0.2, 0.599]
    again = world.permit({"one": long}, limits=limits)
    not_permitted(again, r"would make 1\.4 s of a minute .* 0\.398 s beyond the 1 s")
    world.clock.sleep(58.0)
    for slept in (0.0, 0.99):
        world.clock.sleep(slept)
        again = world.permit({"one": long}, limits=limits)
        not_permitted(again, r"'duty' in \[limits\] allows: wait (1|0\.01) s")
    world.clock.sleep(0.011)
    with world.permit({"one": long}, limits=limits):
        pass


def test_a_play_that_was_stopped_is_logged_only_if_it_had_begun(world):
    with pytest.raises(ZeroDivisionError), world.permit():
        _ = 1 // 0
    assert world.kinds == ["played"]
    with pytest.raises(ZeroDivisionError), world.permit() as volts:
        world.limiter.authorise("one", volts["one"], RATE)
        _ = 1 // 0
    assert world.kinds == ["played", "played", "stopped"]


def test_what_a_player_makes_of_it_is_held_to_its_volts_and_not_to_its_ends(world):
    def permit(factor: float, longest: float) -> Any:
        limits = Limits(max=25.0, max_end=0.01, max_duration=longest, max_offset=100.0)

        def rendered(volts: np.ndarray, rate_hz: float) -> tuple[np.ndarray, float]:
            return np.pad(factor * volts + 0.01, 100, mode="edge"), rate_hz

        return world.limiter.permit({"one": DRIVE}, RATE, ("A",), world.amplifier, rated(limits), rendered)

    with permit(1.2, 0.006):
        pass
    not_permitted(permit(1.25, 0.006), r"rises to 25.5 V")


def test_a_long_play_is_counted_until_a_minute_after_its_end(world):
    long = np.sin(np.arange(65_000) / 3)
    with world.permit({"one": long}):
        world.clock.sleep(65.0)
    now = world.clock.now()
    ((start, stop),) = plays_of(world.counted, {"card"}, now + 0.5)
    assert stop - start == pytest.approx(64.999, abs=0.002)
    world.clock.sleep(61.0)
    with world.permit(limits=Limits(duty=0.1 / 60)):
        pass


def test_without_a_rig_nothing_is_authorised_but_to_open():
    nobody, nothing = Interlocked._interlock, "Nothing is played on 'one' without a rig's limits"
    refused(nothing, nobody.authorise, "one", DRIVE, RATE)
    for starts in (False, True):
        refused(nothing, nobody.authorise_waveform, "one", SWEEP, starts)
    refused("Patch A, B is not connected without a rig", nobody.authorise_patches, frozenset({"B", "A"}))
    nobody.authorise_patches(frozenset())
