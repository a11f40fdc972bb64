"""A session in progress, one that waits for somebody who is away, and what an empty one leaves."""

import errno
import os
import sys
from pathlib import Path

import pytest

from haploop.acquisition import Protocol, Recording, load_study, record, recover, set_aside, verify
from haploop.base import marks
from haploop.base.errors import ConfigurationError, DataError, InstrumentError
from haploop.base.marks import InUse, is_marked, marked
from haploop.instruments import Press
from tests import forked
from tests.acquisition.presses.pressworld import world_rig
from tests.acquisition.session.studying import recording_until_told
from tests.raising import raises, raising

STUDY = 'name = "trial"\nbuttons = ["push"]\nparticipants = ["P01"]\npresses = 3\n'


def away(rig, prompts: int) -> None:
    """The participant follows no prompt for the first press before this many."""
    tell, told = rig.operator.tell, []

    def deaf(request):
        told.append(request)
        first = isinstance(request, Press) and sum(isinstance(one, Press) for one in told) < prompts
        rig.daq.world.answers = not first
        tell(request)

    rig.operator.tell = deaf


@pytest.fixture
def elsewhere(tmp_path):
    """Another program that records a study and has come to its second press, and the way to tell it."""
    (tmp_path / "study.toml").write_text(STUDY, encoding="utf-8")
    context = forked.context()
    here, there = context.Pipe()
    process = context.Process(target=recording_until_told, args=(tmp_path, there))
    process.start()
    assert here.poll(60) and here.recv() == "recording"
    yield process, here
    process.kill()
    process.join()


def test_a_session_is_in_progress_while_its_program_lives(elsewhere, tmp_path):
    process, _ = elsewhere
    study, path = load_study(tmp_path), tmp_path / "recordings" / "P01-push.h5"
    (entry,) = study.progress()
    assert (entry.in_progress, entry.interrupted, len(entry.accepted)) == (1, 0, 1)
    assert Recording.open(path).in_progress
    assert verify(path)[0].endswith("is being recorded now: verify it when the session has ended.")
    raises(ConfigurationError, "is being recorded now", recover, path)
    with pytest.raises(InstrumentError, match="in use"), study.hold():
        pass
    assert set_aside(path) is None
    process.kill()  # no signal that it could handle
    process.join()
    (entry,) = study.progress()
    assert (entry.in_progress, entry.interrupted) == (0, 1)
    with study.hold():
        assert Recording.open(path).state == "interrupted"


def test_a_session_that_ends_leaves_no_mark(elsewhere, tmp_path):
    process, here = elsewhere
    here.send("go on")
    process.join(60)
    (entry,) = load_study(tmp_path).progress()
    assert (entry.in_progress, entry.interrupted, entry.complete) == (0, 0, True)
    assert [path.name for path in (tmp_path / "recordings").iterdir()] == ["P01-push.h5"]


def test_no_program_finishes_what_another_one_records(elsewhere, tmp_path, monkeypatch):
    process, here = elsewhere
    # The study's own lock is this computer's; the other program may run on another one.
    monkeypatch.setattr("haploop.instruments.safety.machine._place", lambda: tmp_path / "elsewhere")
    refused = pytest.raises(InstrumentError, match="is being recorded by another program")
    with refused, load_study(tmp_path).hold():
        pass
    here.send("go on")
    process.join(60)
    assert load_study(tmp_path).progress()[0].complete


@pytest.mark.skipif(sys.platform == "win32", reason="Windows removes no file that is open")
def test_a_mark_that_is_removed_meanwhile_is_none(tmp_path, monkeypatch):
    path, taken = tmp_path / "file.h5", marks.taken

    def after_its_holder(descriptor: int) -> bool:
        (tmp_path / ".file.h5.lock").unlink()
        return taken(descriptor)

    monkeypatch.setattr(marks, "taken", after_its_holder)
    with pytest.raises(InUse), marked(path):
        pytest.fail("Marked, and nobody else can see it.")


def test_a_mark_can_be_looked_at_and_is_had_by_one(tmp_path):
    path = tmp_path / "file.h5"
    assert not is_marked(path)
    with marked(path):
        assert is_marked(path) and is_marked(path)
        with pytest.raises(InUse, match=r"file\.h5 is being written by another program"), marked(path):
            pass
        assert is_marked(path)
    assert not is_marked(path)
    (tmp_path / ".file.h5.lock").write_text("of a program that was killed")
    assert not is_marked(path) and list(tmp_path.iterdir()) == [], "it is removed when somebody looks"
    with marked(path):
        assert is_marked(path)
    assert list(tmp_path.iterdir()) == []


def test_a_session_waits_for_somebody_who_is_away_and_asks_again(tmp_path):
    rig = world_rig(seed=1)
    away(rig, prompts=4)
    recording = record(rig, "push", "P01", 2, tmp_path, protocol=Protocol(wait=600))
    assert recording.complete
    prompts = [request for request in rig.operator.requests if isinstance(request, Press)]
    # At 0, 15, 30 and 60 s; then the second press.
    said = "Still waiting; without a press, the session ends in"
    assert [(one.number, one.because) for one in prompts] == [
        (1, ""), (1, f"{said} 10 min 0 s."), (1, f"{said} 9 min 45 s."), (1, f"{said} 9 min 15 s."), (2, "")
    ]  # fmt: skip
    assert [round(one.wait) for one in prompts] == [600, 600, 585, 555, 555]
    assert 60 < recording.duration < 75


@pytest.mark.long
def test_a_wait_is_for_the_whole_session_and_ends(tmp_path):
    rig = world_rig(seed=1)
    away(rig, prompts=2)  # comes at 15 s, and uses nothing of the wait but the time to press

    tell = rig.operator.tell

    def leaves(request):
        tell(request)
        if isinstance(request, Press) and request.number == 2:
            rig.daq.world.presses.pop()

    rig.operator.tell = leaves
    with pytest.raises(DataError, match=r"No press 2 of 2 arrived within (3[3-5](\.\d+)?) s of the prompt"):
        record(rig, "push", "P01", 2, tmp_path, protocol=Protocol(wait=20))
    assert not Recording.open(tmp_path / "P01-push.h5").complete


def test_hands_off_are_waited_for_too(tmp_path):
    with pytest.raises(DataError, match="did not come to rest within 45 s"):
        record(world_rig(drift=1.0), "push", "P01", 1, tmp_path, protocol=Protocol(wait=30))


def test_an_empty_recording_does_not_refuse_the_next_and_is_kept(tmp_path):
    path = tmp_path / "P01-push.h5"
    contents = []
    for _ in range(2):
        raises(DataError, "No press 1 of 1", record, world_rig(answers=False), "push", "P01", 1, tmp_path)
        contents.append(path.read_bytes())
    assert record(world_rig(), "push", "P01", 1, tmp_path).complete
    aside = [tmp_path / f"P01-push.empty-{number}.h5" for number in (1, 2)]
    assert [one.read_bytes() for one in aside] == contents
    raises(ConfigurationError, "already exists", record, world_rig(), "push", "P01", 1, tmp_path)


def test_what_cannot_be_set_aside_stays(tmp_path, monkeypatch):
    raises(DataError, "No press 1 of 1", record, world_rig(answers=False), "push", "P01", 1, tmp_path)
    refuse = raising(OSError(errno.EROFS, "Read-only file system"))
    monkeypatch.setattr(os, "link", refuse)
    monkeypatch.setattr(os, "open", refuse)
    monkeypatch.setattr(Path, "rename", refuse)
    with pytest.raises(ConfigurationError, match=r"P01-push\.h5 holds no press, and cannot be renamed"):
        record(world_rig(), "push", "P01", 1, tmp_path)
    monkeypatch.undo()
    assert [one.name for one in tmp_path.iterdir()] == ["P01-push.h5"]


def test_what_holds_a_press_or_cannot_be_read_is_not_set_aside(tmp_path):
    rig = world_rig()
    rig.daq.fails_at = 80
    raises(InstrumentError, "", record, rig, "push", "P01", 5, tmp_path)
    assert Recording.open(tmp_path / "P01-push.h5").verdicts
    (tmp_path / "P02-push.h5").write_bytes(b"mine")
    for participant in ("P01", "P02"):
        before = (tmp_path / f"{participant}-push.h5").read_bytes()
        raises(ConfigurationError, "already exists", record, world_rig(), "push", participant, 5, tmp_path)
        assert (tmp_path / f"{participant}-push.h5").read_bytes() == before
    assert len(list(tmp_path.iterdir())) == 2
