"""What is lost of a log is noticed: lines, ends, files; it is never exported as whole, nor asked again."""

import os
import shutil
from contextlib import closing
from pathlib import Path

import pytest

from haploop.acquisition import verify
from haploop.base.clock import VirtualClock
from haploop.base.errors import DataError
from haploop.base.line_files import LineFile
from haploop.experiments.protocol import load_experiment
from haploop.experiments.session import Store, export_answers, open_session
from haploop.mocks.people import ParticipantModel, SimulatedParticipant
from tests.experiments.session.sessions import killed, ran, run, store
from tests.mutating import refused
from tests.raising import raises


def whole(folder: Path) -> Store:
    """A study of two people of two days each: all sealed."""
    text = load_experiment("matching").path.read_text(encoding="utf-8")
    path = folder / "experiment.toml"
    path.write_text(text.replace("repetitions = 10", "repetitions = 1"), encoding="utf-8")
    where = Store(load_experiment(path), folder / "answers")
    for who in ("P01", "P02", "P01", "P02"):
        run(where, who)
    return where


def exported(where: Store) -> int:
    out = where.folder.parent / "out.csv"
    out.unlink(missing_ok=True)
    out.with_suffix(".json").unlink(missing_ok=True)
    return export_answers(where, out)


def lost(where: Store, who: str, path: Path) -> None:
    """Assert that no use takes what is left of a log for all that it was, nor asks for the rest again."""
    assert refused(lambda: exported(where)) and refused(lambda: where.next_session(who))
    assert refused(lambda: run(where, who)) and refused(where.sessions)
    assert refused(lambda: verify(path)) and refused(lambda: verify(where.folder / "marks.json"))


def test_a_log_that_has_lost_its_end_is_neither_exported_nor_continued(tmp_path):
    """At every line and, of the last lines and the first, at every byte."""
    where = whole(tmp_path)
    assert exported(where) == 12 and verify(where.path_of("P01", 1)) == ()
    assert all(one.complete for one in where.sessions())
    for who, session in (("P01", 1), ("P02", 2)):
        path = where.path_of(who, session)
        raw = path.read_bytes()
        ends = [place + 1 for place, byte in enumerate(raw) if byte == 10]
        for end in {0, *ends[:-1], *range(0, len(raw) - 1, 97), *range(len(raw) - 40, len(raw) - 1)}:
            path.write_bytes(raw[:end])
            assert refused(lambda: where.session(who, session)), end  # noqa: B023
            assert refused(lambda: verify(path)), end  # noqa: B023
        path.write_bytes(raw[: ends[7]])
        lost(where, who, path)
        path.write_bytes(raw[: ends[-2]])  # the seal alone
        lost(where, who, path)
        path.write_bytes(raw[:-1])
        assert where.session(who, session), "a missing newline loses nothing"
        path.write_bytes(raw + raw[ends[-2] :])
        lost(where, who, path)
        path.unlink()
        assert refused(lambda: exported(where)) and refused(lambda: run(where, who))  # noqa: B023
        path.write_bytes(raw)
    assert exported(where) == 12


def test_lines_that_were_exchanged_are_noticed(tmp_path):
    """Within a log, and for the same line of another person's: its number and its hash are right."""
    where = whole(tmp_path)
    path = where.path_of("P01", 1)
    raw = path.read_bytes()
    lines, others = (where.path_of(who, 1).read_bytes().splitlines(True) for who in ("P01", "P02"))
    for place in range(len(lines) - 1):
        swapped = [*lines[:place], lines[place + 1], lines[place], *lines[place + 2 :]]
        for changed in (swapped, [*lines[:place], others[place], *lines[place + 1 :]]):
            path.write_bytes(b"".join(changed))
            assert refused(lambda: where.session("P01", 1)) and refused(lambda: verify(path)), place
    path.write_bytes(b"".join(others))
    lost(where, "P01", path)
    path.write_bytes(raw)
    second = where.path_of("P01", 2)
    second.write_bytes(raw)
    lost(where, "P01", second)


def test_a_person_whose_folder_vanished_is_missed(tmp_path):
    where = whole(tmp_path)
    shutil.rmtree(where.folder / "P01")
    assert where.participants() == ("P01", "P02")
    assert refused(lambda: exported(where)) and refused(lambda: run(where, "P01"))
    with pytest.raises(DataError, match=r"P01/session-1.jsonl is missing: restore"):
        run(where, "P03")  # the place of P01 in the design is not known
    where.withdraw("P01")
    run(where, "P03")
    assert where.participants() == ("P02", "P03")
    (where.folder / "withdrawals.jsonl").unlink()
    raises(DataError, r"withdrawals.jsonl is missing", run, where, "P01")


def test_without_its_marks_a_log_with_answers_is_refused(tmp_path):
    where = whole(tmp_path)
    (where.folder / "marks.json").unlink()
    raises(DataError, r"marks.json does not know .*session-1.jsonl", where.sessions)
    assert refused(lambda: exported(where)) and refused(lambda: run(where, "P01"))


def test_answers_of_people_are_marked_one_by_one(tmp_path):
    """So that a program that was killed has no end that could be taken away."""
    where = store(tmp_path)
    with open_session(where, "P01", VirtualClock()) as session:
        who = SimulatedParticipant(ParticipantModel(), "P01", 1)
        path = where.path_of("P01", 1)
        for _ in range(5):
            session.presented()
            session.answer(who.answer(session.due))
            raw = path.read_bytes()
            path.write_bytes(raw[: raw.rindex(b"\n", 0, -1) + 1])
            assert refused(lambda: where.session("P01", 1))
            path.write_bytes(raw)
    assert "is not sealed" in verify(path)[0]


def test_killed_between_the_last_answer_and_the_seal_is_sealed_by_the_next_run(tmp_path):
    where = ran(tmp_path, "P01", name="rating")
    path = where.path_of("P01", 1)
    raw = path.read_bytes()
    path.write_bytes(raw[: raw.rindex(b"\n", 0, -1) + 1])
    killed(where, "P01")
    stored = where.session("P01", 1)
    assert stored is not None and stored.due is None and not stored.complete
    run(where, "P01")
    stored = where.session("P01", 1)
    assert (
        stored is not None
        and stored.complete
        and [e.kind for e in stored.events][-2:] == ["resumed", "complete"]
    )


def test_behind_the_seal_there_is_nothing(tmp_path):
    """Not even a line with the right number, hash and line before it."""
    where = whole(tmp_path)
    path = where.path_of("P01", 1)
    raw = path.read_bytes()
    with closing(LineFile(path)) as file:
        file.add(event="pause", time="2026-01-01", at=0.0, run=1)
    lost(where, "P01", path)
    path.write_bytes(raw)
    assert exported(where) == 12


def test_each_event_of_a_person_is_on_the_disk_before_the_next(tmp_path, monkeypatch):
    synced: list[int] = []
    fsync = os.fsync

    def noted(file):
        synced.append(os.fstat(file).st_size)
        fsync(file)

    monkeypatch.setattr(os, "fsync", noted)
    for durable in (True, False):
        with closing(LineFile(tmp_path / str(durable) / "x.jsonl", durable)) as file:
            synced.clear()
            for number in range(3):
                file.add(event="presented", trial=number)
                size = (tmp_path / str(durable) / "x.jsonl").stat().st_size
                assert (synced[-1:] == [size]) is durable


@pytest.mark.parametrize("what", ["write_marks", "fsync"])
def test_an_answer_that_may_be_lost_is_not_written_twice(tmp_path, monkeypatch, what):
    """The disk refuses for a moment, behind the line itself or behind its mark; the page sends it again."""
    where = store(tmp_path)
    who = SimulatedParticipant(ParticipantModel(), "P01", 1)

    def refuses(*_):
        if what == "fsync":
            raise OSError(28, "No space left on device")
        raise DataError("marks.json cannot be written: No space left on device.")

    with open_session(where, "P01", VirtualClock()) as session:
        for number in range(8):
            assert session.due is not None
            session.presented()
            if number < 7:
                session.answer(who.answer(session.due))
        with monkeypatch.context() as patched:
            patched.setattr(
                "os.fsync" if what == "fsync" else "haploop.experiments.session.store.write_marks", refuses
            )
            raises(DataError, "No space left", session.answer, who.answer(session.due))
        for _ in range(2):
            raises(DataError, "cannot be written", session.answer, who.answer(session.due))
    stored = where.session("P01", 1)
    assert stored is not None and len(stored.answers) == 8 and stored.due is not None
    assert verify(where.path_of("P01", 1))[0].endswith("its end is missing.")
    with open_session(where, "P01", VirtualClock()) as session:
        assert session.due == stored.due
