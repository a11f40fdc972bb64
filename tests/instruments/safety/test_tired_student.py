"""A tired student, with the whole public interface, two rigs on one amplifier, and other programs about.

Whatever they do in whatever order, no patch gets more than a limit allows: looked at in the plant.
"""

import os
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, seed, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule, run_state_machine_as_test

from haploop.base.errors import HaploopError
from haploop.instruments import Rig, RigFile, Sweep, load_rig_file, open_rig
from haploop.instruments.config.rig_file import AbortLimits, Device, DriveLimits
from haploop.instruments.rig.roles import ratings
from haploop.instruments.safety import Limiter, Outputs, clear_lockout
from haploop.mocks.plant import AMPLIFIER_GAIN_ERROR
from tests.instruments.safety.at_the_patch import bursts, busiest_minute
from tests.instruments.safety.lab import Lab, lab
from tests.rig_files import changed

RATE = 20_000.0
MOST = {"one": 30.0, "two": 18.0}
"""Volts that each rig allows: two students, with files of their own for one table."""
LOOSE, FREE = DriveLimits(), AbortLimits(drive=500, drive_source="a test")
DUTY = {"one": 0.02, "two": 0.015}
SHARE = 1 + AMPLIFIER_GAIN_ERROR + 1e-6
CODE = 0.05
FINISHED = 1.25
"""Seconds that either may play in a minute, by the wider of both duties, and rounding."""

_read = cache(load_rig_file)


SHOUT = "FUNC SIN;:FREQ 100;:VOLT 6;:OUTP ON"
"""150 V at a patch."""


def rig_file(name: str) -> RigFile:
    """A rig whose DAQ output and generator meet at the amplifier's one input."""
    file = _read("haptable")
    box = {"resource": "TCPIP::127.0.0.1::5025::SOCKET", "output": "amplifier", "highest": 5.0}
    return changed(
        file,
        name=name,
        limits=DriveLimits(min=-MOST[name], max=MOST[name], duty=DUTY[name]),
        table={"rate_hz": RATE},
        relay=Device(driver=file.relay.driver, **(file.relay.settings | {"rating": 48})),
        generator=Device(driver="keysight-33500", **box),
    )


def tone(volts: float, seconds: float) -> Any:
    t = np.arange(max(4, round(seconds * RATE))) / RATE
    return volts * np.sin(2 * np.pi * 263.5 * t) * np.hanning(len(t))


WAYS: tuple[Callable[[Rig], object], ...] = (
    lambda rig: vars(rig.file).update(limits=LOOSE, abort=FREE),
    lambda rig: setattr(rig.relay, "rating", 500.0),
    lambda rig: setattr(rig.file, "limits", LOOSE),
    lambda rig: setattr(rig.file.limits, "max", 500.0),
    lambda rig: setattr(rig.audit, "folder", Path("/nowhere")),
    lambda rig: setattr(rig, "hardware", frozenset()),
    lambda rig: setattr(rig.amplifier, "input", "elsewhere"),
)


class Student(RuleBasedStateMachine):
    """Its steps, and after each of them a look at the plant."""

    folder: Path
    counts: Counter[str]
    take_out: Callable[[pytest.MonkeyPatch], object] = staticmethod(lambda _patch: None)

    @initialize()
    def begin(self) -> None:
        self.stack = ExitStack()
        number = self.counts["labs"]
        self.counts["labs"] += 1
        place = self.folder / f"{os.getpid()}-{number}"
        self.lab: Lab = self.stack.enter_context(lab(place, rig_file("two")))
        patch = self.stack.enter_context(pytest.MonkeyPatch.context())
        patch.setenv("HAPLOOP_STATE", str(place))
        patch.setattr(os, "fsync", lambda _descriptor: None)  # 10^5 steps; no computer is switched off here
        type(self).take_out(patch)
        self.rig: Rig | None = None
        self.most = 0.0
        self.record = self.lab.truth.record()
        self.seen = 0
        # So that the cards are there for the other programs.
        with open_rig(rig_file("two")):
            pass

    def teardown(self) -> None:
        if hasattr(self, "stack"):
            with suppress(HaploopError):
                if self.rig is not None:
                    self.rig.close()
            self.stack.close()

    # What a student does

    @rule(
        what=st.sampled_from((
            "open", "end", "excite", "excite", "excite", "excite", "excite", "excite", "connect", "connect",
            "sweep", "sweep", "sweep", "sweep_past_it", "play_past_it", "listen", "assign", "assign",
            "assign", "stop", "reset", "killed",
        )),
        name=st.sampled_from(("one", "two", "two")),
        volts=st.sampled_from((5.0, 16.0, 17.0, 29.0, 31.0, 60.0, 90.0, float("nan"))),
        seconds=st.sampled_from((0.02, 0.1, 0.8, 0.8)),
        patches=st.sampled_from((("A",), ("B",), ("A", "C"), ("A", "B", "C", "D"), ("A",), ())),
        way=st.sampled_from(3 * WAYS[:2] + WAYS),
    )  # fmt: skip
    def student(  # noqa: PLR0912  one branch for each thing that can be done
        self, what: str, name: str, volts: float, seconds: float, patches: tuple[str, ...], way: Any
    ) -> None:
        """One thing that they do; they read an error, and go on."""
        self.counts["steps"] += 1
        try:
            if self.rig is None or what == "open":
                self.rig, self.most = open_rig(rig_file(name)), MOST[name]
            rig = self.rig
            match what:
                case "end":
                    self.rig = None
                    rig.close()
                case "killed":  # -9: nothing is closed, and the box opens by its own timer
                    self.rig = None
                    self.lab.forget(rig)
                case "excite":
                    rig.excite(tone(volts, seconds), patches, ["drive"])
                case "sweep":
                    rig.generate(Sweep(50, 400, min(seconds, 0.1), volts / 2), patches, ["drive"])
                case "sweep_past_it":
                    rig.generator.configure(Sweep(50, 400, seconds, volts / 50))
                    rig.generator.arm()
                    rig.generator.trigger()
                case "connect":
                    rig.relay.connect(patches)
                case "play_past_it":
                    play = {"amplifier": tone(volts / 50, 0.02)}
                    rig.daq.stream(["drive"], RATE, 100, 400, play).capture()
                case "listen":
                    with rig.daq.stream(["drive", "laser"], RATE, 100, 200) as stream:
                        stream.capture()
                case "assign":
                    way(rig)
                case "stop":
                    rig.make_safe()
                case "reset":
                    clear_lockout(self.lab.place, rig.hardware)
            self.counts[what] += 1
        except (HaploopError, ValueError, AttributeError):
            self.counts[f"{what} refused"] += 1

    # What happens around them

    @rule(
        what=st.sampled_from(3 * ("wait",) + 3 * ("leave",) + 3 * ("OUTP OFF",) + ("OUTP ON", SHOUT)),
        seconds=st.sampled_from((0.1, 1.0, 5.0, 20.0)),
        volts=st.sampled_from((8.0, -2.0, 10.0, 0.5)),
    )
    def others(self, what: str, seconds: float, volts: float) -> None:
        """Time passes. Another program writes to the output, or somebody switches the generator on at its
        front panel, while every contact is open: nobody can forbid them that. Or off, at any time."""
        self.counts["steps"] += 1
        if what == "wait":
            self.lab.clock.sleep(min(seconds, 1.0) if self.lab.generator.is_on else seconds)
        self.lab.plant.advance(self.lab.clock.now())
        if what == "OUTP OFF" or (what != "wait" and not self.lab.truth.closed):
            self.counts[what] += 1
            if what == "leave":
                self.lab.leave("amplifier", volts)
            else:
                self.lab.generator._line.send(what)

    # What the patches got

    @invariant()
    def nothing_beyond(self) -> None:
        if not hasattr(self, "record"):
            return
        self.lab.plant.advance(self.lab.clock.now())
        new = self.record[self.seen :]
        for output in new:
            if output.closed:
                loudest = float(np.abs(output.volts).max())
                assert loudest <= max(MOST.values()) * SHARE + CODE, f"{loudest} V"
                assert self.rig is None or loudest <= self.most * SHARE + CODE, f"{loudest} V of {self.most}"
        # What reaches no patch only ends a burst: its beginning is enough.
        self.record[self.seen :] = [o if o.closed else replace(o, volts=o.volts[:1]) for o in new]
        if any(output.closed for output in self.record[max(0, self.seen - 1) :]):
            found = bursts(self.record)
            assert busiest_minute(found) <= FINISHED, f"{busiest_minute(found)} s of a minute"
        self.seen = len(self.record)
        if len(self.record) > 400:  # older than any minute
            now = self.lab.clock.now()
            self.record[:] = [output for output in self.record if output.start > now - 90]
            self.seen = len(self.record)


def run(folder: Path, examples: int, take_out: Any = None, number: int = 0) -> Counter[str]:
    """Examples of up to 60 steps, by a seed's number."""
    counts: Counter[str] = Counter()

    class Here(Student):
        pass

    Here.folder, Here.counts = folder, counts
    if take_out is not None:
        Here.take_out = staticmethod(take_out)
    sixty = settings(
        max_examples=examples, stateful_step_count=60, deadline=None, database=None,
        report_multiple_bugs=False, phases=(Phase.generate,), suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    run_state_machine_as_test(seed(number)(Here), settings=sixty)
    return counts


@pytest.mark.long
@pytest.mark.timeout(7200)
def test_no_limit_is_exceeded_whatever_is_done(tmp_path, full):
    counts: Counter[str] = Counter()
    for number in range(9 if full else 1):
        counts += run(tmp_path, 200 if full else 8, number=number)
    print(dict(counts))
    for what in ("excite", "excite refused", "sweep refused", "connect", "assign refused", "killed", "leave"):
        assert counts[what], counts
    assert not full or (counts["steps"] >= 100_000 and counts["sweep"])


def no_rest(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Outputs, "rest", lambda self: None)


def no_duty(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Limiter, "recall", lambda self: None)


def not_copied(patch: pytest.MonkeyPatch) -> None:
    read_once = Rig._read_once

    def asked_again(rig: Rig) -> None:
        read_once(rig)
        rig._limiter.kept.of = lambda patches: ratings(rig, patches)

    patch.setattr(Rig, "_read_once", asked_again)
    patch.setattr(Rig, "file", property(lambda rig: rig._file))


@pytest.mark.long
@pytest.mark.parametrize("take_out", [no_rest, no_duty, not_copied], ids=lambda f: f.__name__)
def test_it_is_noticed_when_an_interlock_is_missing(tmp_path, take_out):
    with pytest.raises(BaseException, match=r"\d V|s of a minute"):
        run(tmp_path, 60, take_out)
