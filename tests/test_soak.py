"""A week: a calibration looked at every hour, recordings, faults by a schedule, a table that warms and cools.

One rig, one plant and one virtual clock from the first hour to the last; only what is wrong from the
beginning (a dead patch, say) has a rig of its own for its hour, with the table as it is then. Whatever is
asked to go wrong must be named by the command that it affects, nothing else may be, and nothing may grow.
Nor may anything grow in two hours of recording.
"""

import gc
import os
import random
import re
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any

import pytest

from haploop.acquisition import Protocol, Recording, record, verify
from haploop.base.errors import DataError, InstrumentError
from haploop.calibration import LinearSweep, build_button, calibrate
from haploop.calibration.recalibration.adoption import adopt, calibrations_of
from haploop.calibration.recalibration.history import History
from haploop.calibration.recalibration.recalibration import recalibrate
from haploop.instruments import Rig, load_rig_file, open_rig
from tests.calibration.conftest import make_press

START = datetime(2026, 8, 3, tzinfo=UTC)
HOUR = 3600.0
RECORDED = 1800.0
"""Seconds after the hour at which somebody records presses, every third hour."""
LASTS = 600.0
"""Seconds that a timed fault is active: less than from a look to a recording."""
ACCEPTED = 0.003
"""The rig file's threshold of a drift."""
NEAR = 0.0003
"""What lies so near the threshold may be called either."""
GROWTH = 20.0
"""MB that the program may have grown by from the first quarter to the last: a look that kept what it
captured would take more than that in a day."""
LOGGED = 45_000
"""Bytes that an hour may add to the logs, buttons made anew included; a look notes its check."""


@dataclass(frozen=True)
class Trouble:
    """Something to go wrong: while looking or while recording, and the words that name it."""

    says: str
    kind: dict[str, Any]
    recording: bool = False
    hour: int = 0

    @property
    def apart(self) -> bool:
        """Whether it has no beginning and no end, and so needs a rig of its own."""
        return not self.kind.keys() & {"duration", "times"}

    @property
    def fault(self) -> dict[str, Any]:
        """Its table of `[[simulation.faults]]`."""
        if self.apart:
            return self.kind
        return self.kind | {"after": self.hour * HOUR + self.recording * RECORDED}


TROUBLES = (
    Trouble("laser does not see the surface", {"kind": "laser-blocked", "duration": LASTS}),
    Trouble("left its range", {"kind": "laser-dropout", "duration": 5e-3, "times": 100, "every": 0.2}),
    Trouble("drive monitor shows", {"kind": "amplifier-trip", "duration": LASTS}),
    Trouble("left its range", {"kind": "sensor-saturated", "channel": "laser", "duration": LASTS}),
    Trouble("accelerometer is loose or turned",
        {"kind": "sensor-saturated", "channel": "acceleration_z", "duration": LASTS}),
    Trouble("lost samples", {"kind": "daq-overrun", "times": 1}),
    Trouble("lost samples", {"kind": "daq-overflow", "times": 1}),
    Trouble("told to close but reads open", {"kind": "relay-lost", "times": 1}),
    Trouble("told to close but reads open", {"kind": "relay-stuck", "times": 1}),
    Trouble("drive monitor shows", {"kind": "relay-welded", "times": 1}),
    Trouble("patch is dead or its wires are off", {"kind": "patch-dead"}),
    Trouble("laser is not connected", {"kind": "sensor-disconnected", "channel": "laser"}),
    Trouble("accelerometer is loose", {"kind": "sensor-disconnected", "channel": "acceleration_z"}),
    Trouble("accelerometer is loose or turned", {"kind": "accelerometer-inverted"}),
    Trouble("check that the laser still looks at the point", {"kind": "relay-swapped"}),
    Trouble("did not confirm the settings", {"kind": "vibrometer-range"}),
    Trouble("drive monitor shows 0.5 V for each volt", {"kind": "amplifier-gain"}),
    Trouble("lost samples", {"kind": "daq-overrun", "times": 1}, recording=True),
    Trouble("lost samples", {"kind": "daq-overflow", "times": 1}, recording=True),
    Trouble("left its range", {"kind": "sensor-saturated", "channel": "acceleration_z", "duration": LASTS},
        recording=True),
    Trouble("did not switch", {"kind": "sensor-disconnected", "channel": "switch"}, recording=True),
    Trouble("RTSI", {"kind": "rtsi-missing"}, recording=True),
)  # fmt: skip


def schedule(hours: int, wanted: Iterable[Trouble], r: random.Random) -> dict[int, Trouble]:
    """By hour: each of these troubles, in an hour of its own."""
    free = list(range(1, hours + 1))
    chosen: dict[int, Trouble] = {}
    for trouble in sorted(wanted, key=lambda trouble: not trouble.recording):
        hour = r.choice([hour for hour in free if records(hour) or not trouble.recording])
        free.remove(hour)
        chosen[hour] = replace(trouble, hour=hour)
    return dict(sorted(chosen.items()))


def records(hour: int) -> bool:
    return hour % 3 == 2


@dataclass(frozen=True, eq=False)
class Size:
    """What must not grow, after an hour."""

    threads: int
    files: int
    memory: float
    """MB; 0 where the system does not say."""
    log: int
    """Bytes of the audit log and of the looks."""
    seconds: float
    """Of the processor, for this hour."""
    quiet: bool
    """Nothing happened but a look that found nothing."""


@dataclass
class Week:
    """The rig, its history, and where recordings go."""

    rig: Rig
    history: History
    folder: Path
    daily: float
    r: random.Random
    outcomes: Counter[str] = field(default_factory=Counter)
    sizes: list[Size] = field(default_factory=list)

    def hour(self, hour: int, trouble: Trouble | None) -> None:
        """Look at the hour, and record half an hour later."""
        began = time.process_time()
        happened = self.look(hour, None if trouble and trouble.recording else trouble)
        self.outcomes[happened] += 1
        if records(hour):
            self.record(hour, trouble if trouble and trouble.recording else None)
        if trouble:
            # A closed rig is a ring of references: 25 MB until somebody looks for such rings.
            gc.collect()
        quiet = happened == "unchanged" and not records(hour)
        logs = (*self.rig.audit.folder.glob("log-*.jsonl"), self.history.folder / "looks.json")
        files = Path("/proc/self/fd")
        self.sizes.append(
            Size(
                threading.active_count(), len(list(files.iterdir())) if files.is_dir() else 0, resident(),
                sum(log.stat().st_size for log in logs), time.process_time() - began, quiet,
            )
        )  # fmt: skip

    def look(self, hour: int, trouble: Trouble | None) -> str:
        with self.at(hour * HOUR, trouble) as rig:
            before = self.history.active()
            off = self.off(rig)
            outcome = recalibrate(rig, self.history, when=START + timedelta(hours=hour), iterations=0)
            told = f"hour {hour}, {trouble}: {outcome.kind}: {' '.join(outcome.sentences)}"
            if trouble:
                assert outcome.kind == "broken" and re.search(trouble.says, " ".join(outcome.sentences)), told
                assert self.history.active() == before
            else:
                if abs(off) > ACCEPTED + NEAR:
                    assert outcome.kind == "restored", f"{told} {off}"
                elif abs(off) < ACCEPTED - NEAR:
                    assert outcome.kind == "unchanged", f"{told} {off}"
                assert outcome.kind in ("restored", "unchanged"), told
                assert (self.history.active() == before) == (outcome.kind == "unchanged")
                if outcome.kind == "restored":
                    assert all(button.passed for button in outcome.after.values())
                    assert abs(self.off(rig)) < 0.001
            assert_safe(rig)
        return outcome.kind

    def record(self, hour: int, trouble: Trouble | None) -> None:
        button = self.r.choice(("latch", "toggle", "push"))
        out = self.folder / f"{hour:03d}"
        reasons: list[str] = []
        with self.at(hour * HOUR + RECORDED, trouble) as rig:

            def now() -> Recording:
                return record(rig, button, "P01", 2, out, on_verdict=lambda one: reasons.append(one.reason))

            if trouble:
                with pytest.raises((InstrumentError, DataError), match=trouble.says):
                    now()
                for path in out.glob("*.h5"):
                    Recording.open(path)
            else:
                assert len(now().accepted) == 2 and not any(reasons), f"hour {hour}: {reasons}"
            assert_safe(rig)

    @contextmanager
    def at(self, seconds: float, trouble: Trouble | None) -> Iterator[Rig]:
        """The rig when its clock has come to a moment, or one apart, at the same moment of the same table."""
        if trouble and trouble.apart:
            with opened([trouble], self.daily) as rig:
                rig.clock.sleep(seconds - rig.clock.now())
                yield rig
                assert rig.simulation.faults[0].fired
        else:
            self.rig.clock.sleep(seconds - self.rig.clock.now())
            yield self.rig

    def off(self, rig: Rig) -> float:
        """How far the table's resonance is from the active calibration's."""
        (active,) = calibrations_of(self.history.active())
        return float(rig.simulation.truth.resonance_hz / active.model.resonance_hz - 1)


def opened(troubles: Iterable[Trouble], daily: float) -> Rig:
    faults = [trouble.fault for trouble in troubles]
    return open_rig("simulated", simulate="twin", simulation={"daily_drift": daily, "faults": faults})


def assert_safe(rig: Rig) -> None:
    truth = rig.simulation.truth
    assert truth.closed == frozenset(), "the relay is open"
    for patch, volts in truth.patch_voltages.items():
        assert abs(volts) < 1e-3, f"patch {patch} has no voltage"


def resident() -> float:
    """MB that the program has in memory."""
    statm = Path("/proc/self/statm")
    if not statm.is_file():
        return 0.0
    return int(statm.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


@pytest.mark.night
@pytest.mark.timeout(3600)
def test_a_week_with_every_fault_noticed_and_nothing_growing(tmp_path, mode, full):
    if mode != "twin":
        pytest.skip("a week passes in minutes on a virtual clock only, and on twins")
    hours, daily = (7 * 24, 0.01) if full else (6, 0.005)
    r = random.Random(1)
    wanted = (
        2 * TROUBLES if full else [r.choice([t for t in TROUBLES if t.recording is w]) for w in (True, False)]
    )
    troubles = schedule(hours, wanted, r)
    began = time.monotonic(), time.process_time()
    lasting = [trouble for trouble in troubles.values() if not trouble.apart]
    with opened(lasting, daily) as rig:
        week = Week(rig, History(tmp_path / "calibrations"), tmp_path, daily, r)
        button = build_button(
            rig, make_press(), calibrate(rig, excitation=LinearSweep(repeats=2)), iterations=0, plays=4
        )
        adopt(week.history, [button], actor="a test", reason="the week begins", when=START)
        assert rig.clock.now() < HOUR
        for hour in range(1, hours + 1):
            week.hour(hour, troubles.get(hour))
        for trouble, fault in zip(lasting, rig.simulation.faults, strict=True):
            begins = trouble.fault["after"]
            assert fault.fired, trouble
            assert all(begins <= at <= begins + LASTS for at in fault.at), trouble
    seconds = time.process_time() - began[1]
    print(
        f"{hours} h in {time.monotonic() - began[0]:.0f} s, {seconds:.0f} s of the processor;",
        f"{len(troubles)} faults; {dict(week.outcomes)}; {week.sizes[0]} ... {week.sizes[-1]}",
        file=sys.stderr,
    )
    assert week.outcomes["broken"] == sum(not trouble.recording for trouble in troubles.values())
    assert week.outcomes["restored"] and week.outcomes["unchanged"]
    assert_flat(week.sizes)


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_two_hours_of_recording_grow_nothing(tmp_path, mode, full, monkeypatch):
    """Presses for the most part, and then nothing, at 1000 samples/s; looked at while it records."""
    if mode != "twin":
        pytest.skip("two hours pass in minutes on a virtual clock only, and on twins")
    presses, seconds = (1000, 7200.0) if full else (10, 60.0)
    file = load_rig_file("simulated").model_copy(update={"rate_hz": 1000.0})
    found: list[tuple[float, int, int, float]] = []
    with open_rig(file) as rig:
        rejects = rig.operator.rejects

        def look() -> bool:  # once a block
            if rig.clock.now() >= len(found) * seconds / 40:
                files = Path("/proc/self/fd")
                opened = len(list(files.iterdir())) if files.is_dir() else 0
                found.append((rig.clock.now(), threading.active_count(), opened, resident()))
            return rejects()

        monkeypatch.setattr(rig.operator, "rejects", look)
        recording = record(rig, "push", "P01", presses, tmp_path, protocol=Protocol(trail=seconds))
        assert rig.clock.now() > seconds
    print(f"{len(found)} looks: {found[1]} ... {found[-1]}", file=sys.stderr)
    assert len(recording.accepted) == presses and recording.header.rate_hz == 1000.0
    assert len(recording.force) >= 1000 * seconds and verify(recording.path) == ()
    quarter = len(found) // 4
    for number, allowed in ((1, 0.0), (2, 0.0), (3, GROWTH)):
        early = max(one[number] for one in found[1 : quarter + 1])
        late = max(one[number] for one in found[-quarter:])
        assert late <= early + allowed, (number, early, late)


def assert_flat(sizes: list[Size]) -> None:
    """From the first quarter to the last; of six hours, the halves: modules are loaded when needed."""
    part = max(len(sizes) // 4, 3)
    first, last = sizes[:part], sizes[-part:]
    assert max(size.threads for size in last) <= max(size.threads for size in first)
    assert max(size.files for size in last) <= max(size.files for size in first)
    assert max(size.memory for size in last) < max(size.memory for size in first) + GROWTH
    added = {after: after.log - before.log for before, after in pairwise(sizes)}
    assert max(added.values()) < LOGGED
    quiet = [size for size in sizes[1:] if size.quiet]
    half = (len(quiet) + 1) // 2
    early, late = quiet[:half], quiet[-half:]
    assert median(added[size] for size in late) < 1.05 * median(added[size] for size in early)
    assert median(size.seconds for size in late) < 3 * median(size.seconds for size in early)
