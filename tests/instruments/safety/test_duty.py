"""The duty is the hardware's: no program forgets what another one has played."""

from collections.abc import Iterator
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from haploop.base.errors import DataError, LimitError
from haploop.base.json_files import of_file
from haploop.instruments import RigFile, load_rig_file, open_rig
from haploop.instruments.config.rig_file import DriveLimits
from haploop.instruments.safety.duty import clear_old, count_plays, plays_of
from tests.instruments.safety.at_the_patch import bursts, busiest_minute
from tests.instruments.safety.lab import Lab, lab
from tests.raising import raising
from tests.rig_files import changed

pytestmark = pytest.mark.usefixtures("unproved")

RATE = 50_000
TONE = 10 * np.sin(2 * np.pi * 250 * np.arange(round(1.5 * RATE)) / RATE) * np.hanning(round(1.5 * RATE))
"""1.5 s: half of what 5 % of a minute are."""


def allowed(duty: float, name: str = "haptable") -> RigFile:
    return changed(load_rig_file("haptable"), limits=DriveLimits(duty=duty), name=name)


@pytest.fixture
def here(tmp_path: Path) -> Iterator[Lab]:
    with lab(tmp_path) as here:
        yield here


def test_a_rig_that_is_opened_again_remembers_what_was_played(here):
    """Each as a command of its own, under any name; 5 % of a minute are two of these plays."""
    record = here.truth.record()
    refused = 0
    for turn in range(5):
        with open_rig(allowed(0.05, f"rig {turn}")) as rig:
            try:
                rig.excite(TONE, ["A"], ["drive"])
            except LimitError as error:
                assert "of a minute in which something is played" in str(error) and "wait" in str(error)
                refused += 1
        here.clock.sleep(5)
    assert refused == 3 and busiest_minute(bursts(record)) < 3.01
    here.clock.sleep(60)
    with open_rig(allowed(0.05)) as rig:
        rig.excite(TONE, ["A"], ["drive"])


def test_a_rig_without_a_duty_counts_for_one_that_has_it(here):
    with open_rig(allowed(1.0)) as rig:
        for _ in range(2):
            rig.excite(TONE, ["A"], ["drive"])
    with open_rig(allowed(0.05)) as rig, pytest.raises(LimitError, match="of a minute"):
        rig.excite(TONE, ["A"], ["drive"])


def test_a_play_is_counted_before_it_begins(here, tmp_path):
    """What `kill -9` leaves behind: the files as they are at any block of the play."""
    seen: list[float] = []

    def look(*_: object) -> None:
        now = here.clock.now()
        spans = [plays_of(tmp_path, {piece}, now) for piece in rig.hardware]
        assert all(spans) and len(rig.hardware) >= 3
        seen.extend(stop - start for ((start, stop),) in spans)

    with open_rig(allowed(0.05)) as rig:
        rig.excite(TONE, ["A"], ["drive"], progress=look)
    assert seen and min(seen) > 1.49


def test_a_count_that_cannot_be_read_is_a_full_minute(here, tmp_path):
    with open_rig(allowed(0.05)) as rig:
        rig.excite(TONE, ["A"], ["drive"])
    for path in tmp_path.glob("*.duty"):
        path.write_bytes(b"[[1")
        break
    for _ in range(2):  # nor does looking at it make it readable
        with open_rig(allowed(0.05)) as rig, pytest.raises(LimitError, match="of a minute"):
            rig.excite(TONE, ["A"], ["drive"])
        here.clock.sleep(20)
    here.clock.sleep(40)
    with open_rig(allowed(0.05)) as rig:
        rig.excite(TONE, ["A"], ["drive"])


def test_a_computer_started_again_remembers_each_play_once(here, tmp_path):
    """The clock began anew: what was played counts as just ended, and is a minute old a minute later."""
    with open_rig(allowed(0.05)) as rig:
        rig.excite(TONE, ["A"], ["drive"])
    (start, stop), *_ = plays_of(tmp_path, rig.hardware, 0.5)
    assert stop == 0.5 and stop - start == pytest.approx(1.5, abs=0.01)
    assert plays_of(tmp_path, rig.hardware, 60.4) and not plays_of(tmp_path, rig.hardware, 60.6)


def test_a_calendar_that_is_set_forward_forgets_nothing(here, monkeypatch):
    """By a minute, and by two days: 5.75 s were played where 3 were allowed."""
    record = here.truth.record()
    for ahead in (0, 120, 200_000):
        today = datetime.now(UTC) + timedelta(seconds=ahead)
        monkeypatch.setattr("haploop.instruments.safety.audit.now_utc", lambda today=today: today)
        monkeypatch.setattr("time.time", today.timestamp)
        with open_rig(allowed(0.05)) as rig, suppress(LimitError):
            rig.excite(TONE, ["A"], ["drive"])
    assert busiest_minute(bursts(record)) < 3.01


def test_what_cannot_be_counted(here, tmp_path, monkeypatch):
    full = raising(OSError(28, "No space left on device"))
    with open_rig(allowed(0.05)) as rig:
        monkeypatch.setattr("haploop.instruments.safety.machine.write", full)
        with pytest.raises(DataError, match=r"cannot be counted .* \(No space left on device\)"):
            rig.excite(TONE, ["A"], ["drive"])
        assert here.truth.peak == 0
        monkeypatch.undo()


def test_what_is_kept_stays_small(here, tmp_path):
    with open_rig(allowed(1.0)) as rig:
        for _ in range(12):
            rig.excite(TONE[::100] * 0, ["A"], ["drive"])
            here.clock.sleep(10)
    assert all(len(of_file("duty", path.read_bytes())) < 8 for path in tmp_path.glob("*.duty"))


@pytest.mark.parametrize(("ago", "left"), [((90_000.0, 10.0), True), ((90_000.0, 90_000.0), False)])
def test_a_day_after_the_last_play_its_file_goes(tmp_path, ago, left):
    now = 1e9
    count_plays(tmp_path, ["a card"], [(now - past - 1.0, now - past) for past in ago])
    clear_old(tmp_path, now)
    assert bool(list(tmp_path.glob("*.duty"))) is left
