"""Sessions: resumed at the exact trial, never mixed, withdrawn, exported, and logs that are damaged."""

import json
import os
import subprocess
import sys

import pytest

from haploop.acquisition import verify
from haploop.base.clock import VirtualClock
from haploop.base.errors import ConfigurationError, DataError
from haploop.base.json_files import as_line, from_text
from haploop.experiments.analysis import analyse_identification, read_rows
from haploop.experiments.protocol import load_experiment
from haploop.experiments.session import Store, export_answers, open_session, read_log
from haploop.mocks.people import ParticipantModel, SimulatedParticipant
from tests.experiments.session.sessions import answers, broken, killed, ran, run, store
from tests.mutating import mutations, refused
from tests.raising import raises


@pytest.mark.parametrize("after", [0, 20, 51])
def test_an_interrupted_session_continues_at_the_exact_trial(tmp_path, after):
    whole, other = store(tmp_path / "a"), store(tmp_path / "b")
    run(whole, "P01")
    broken(other, "P01", after)
    stored = other.session("P01", 1)
    assert stored is not None and stored.due is not None and len(stored.answers) == after
    run(other, "P01")
    assert answers(other, "P01") == answers(whole, "P01")
    kinds = [event.kind for event in read_log(other.path_of("P01", 1))]
    assert kinds.count("resumed") == 1 and kinds[-1] == "complete"
    assert kinds.count("presented") == 53  # the one that was interrupted was presented twice


@pytest.mark.parametrize("cut", [1, 200])
def test_a_line_that_was_cut_off_is_left_behind(tmp_path, cut):
    where = store(tmp_path)
    raises(KeyboardInterrupt, "", run, where, "P01", 20)
    path = where.path_of("P01", 1)
    content = path.read_bytes()
    path.write_bytes(content[:-cut])
    killed(where, "P01")
    run(where, "P01")
    whole = store(tmp_path / "whole")
    run(whole, "P01")
    assert answers(where, "P01") == answers(whole, "P01")
    assert path.read_bytes().startswith(content[:-cut])


def test_every_changed_byte_is_noticed(tmp_path):
    """Also at the end: what could be a line that was cut off was whole before."""
    where = ran(tmp_path, "P01", name="rating")
    path = where.path_of("P01", 1)
    content = path.read_bytes()
    for place in [*range(0, len(content) - 200, 13), *range(len(content) - 200, len(content))]:
        for mask in (1, 0x20):
            path.write_bytes(content[:place] + bytes([content[place] ^ mask]) + content[place + 1 :])
            assert refused(lambda: answers(where, "P01")), place


def test_a_line_that_is_missing_is_noticed(tmp_path):
    where = ran(tmp_path, "P01", name="rating")
    path = where.path_of("P01", 1)
    lines = path.read_bytes().splitlines(keepends=True)
    for gone in range(len(lines)):
        path.write_bytes(b"".join(lines[:gone] + lines[gone + 1 :]))
        with pytest.raises(DataError, match=r"is damaged, or a line before it is missing|of the \d+ lines"):
            where.session("P01", 1)


def test_each_event_has_its_time(tmp_path):
    where = ran(tmp_path, "P01")
    events = read_log(where.path_of("P01", 1))
    assert [event.number for event in events] == list(range(1, 107))  # start, 52 x 2, complete
    assert all(event.time.endswith("+00:00") for event in events)
    head = events[0].values
    assert (head["participant"], head["session"], head["seed"], head["simulated"]) == ("P01", 1, 2020, True)
    path = where.path_of("P01", 1)  # of people, which only their owner may read
    modes = (path.stat().st_mode & 0o777, path.parent.stat().st_mode & 0o777)
    assert os.name == "nt" or modes == (0o600, 0o700)


def test_a_changed_experiment_does_not_continue(tmp_path):
    text = load_experiment("matching").path.read_text(encoding="utf-8")
    path = tmp_path / "experiment.toml"
    path.write_text(text, encoding="utf-8")
    raises(KeyboardInterrupt, "", run, Store(load_experiment(path), tmp_path / "answers"), "P01", 20)
    path.write_text(text.replace("seed = 2020", "seed = 1"), encoding="utf-8")
    raises(DataError, "another version", run, Store(load_experiment(path), tmp_path / "answers"), "P01")


def test_what_may_not_begin_is_refused(tmp_path):
    where = store(tmp_path)
    with (
        pytest.raises(DataError, match="has not consented"),
        open_session(where, "P01", VirtualClock(), consent=lambda: False),
    ):
        pass
    assert where.participants() == ()
    with (
        pytest.raises(ConfigurationError, match="Session 2 of P01 is not due, but session 1"),
        open_session(where, "P01", VirtualClock(), 2, simulated=True),
    ):
        pass
    with (  # two programs
        open_session(where, "P01", VirtualClock(), simulated=True),
        pytest.raises(ConfigurationError, match=r"in use|is open"),
        open_session(where, "P02", VirtualClock(), simulated=True),
    ):
        pass
    run(where, "P01")
    with (
        pytest.raises(ConfigurationError, match="answers of simulated participants"),
        open_session(where, "P02", VirtualClock()),
    ):
        pass
    for name in ("Ann Smith", "../P01", "p01", "P", ""):
        raises(ConfigurationError, "", run, where, name)
    run(where, "P01")
    raises(ConfigurationError, "completed all 2 sessions", run, where, "P01")


def test_an_answer_needs_a_presentation_and_a_valid_value(tmp_path):
    with open_session(store(tmp_path, "rating"), "P01", VirtualClock(), simulated=True) as session:
        raises(DataError, "was not presented yet", session.answer, {})
        session.presented()
        raises(DataError, "is no answer", session.answer, "clear")
        assert session.due is not None and session.due.number == 1
        raises(ConfigurationError, "events of its own", session.event, "answer")


def test_a_withdrawal_deletes_what_belongs_to_one(tmp_path):
    where = ran(tmp_path, "P01", "P02", "P03", "P04")
    slots = {one.assignment.participant: one.assignment.slot for one in where.sessions()}
    others = {path: path.read_bytes() for who in ("P01", "P03", "P04") for path in [where.path_of(who, 1)]}
    done = where.withdraw("P02")
    assert done.files == ("P02/session-1.jsonl",)
    left = [path for path in where.folder.rglob("*") if path.is_file()]
    assert {path: path.read_bytes() for path in left if "P0" in str(path.parent.name)} == others
    assert [one.participant for one in where.withdrawals()] == ["P02"]
    for path in left:
        assert path.name == "withdrawals.jsonl" or b"P02" not in path.read_bytes()
    raises(ConfigurationError, "P02 has withdrawn", run, where, "P02")
    run(where, "P05")
    after = {one.assignment.participant: one.assignment.slot for one in where.sessions()}
    assert after == {"P01": slots["P01"], "P03": 2, "P04": 3, "P05": 1}
    for nobody in ("P09", "..", "", "P01/session-1.jsonl"):
        raises(DataError, "There is nothing of", where.withdraw, nobody)


def test_answers_leave_as_a_tidy_table(tmp_path):
    where = store(tmp_path)
    for participant in ("P01", "P02"):
        run(where, participant)
        run(where, participant)
    out = tmp_path / "out.csv"
    assert export_answers(where, out) == 120
    rows = read_rows(out)
    assert rows.simulated and set(rows.text("confirmation")) == {"none", "given"}
    assert os.name == "nt" or not (out.stat().st_mode | (tmp_path / "out.json").stat().st_mode) & 0o077
    sidecar = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))
    assert set(rows.columns) <= set(sidecar)
    assert sidecar["presented"]["Levels"] == ["latch", "toggle", "push"]
    assert analyse_identification(rows).pooled.counts.sum() == 120
    raises(DataError, "already exists", export_answers, where, out)
    assert export_answers(where, tmp_path / "all.csv", practice=True) == 156
    raises(DataError, "holds no answer", export_answers, store(tmp_path / "empty"), tmp_path / "none.csv")


def test_a_program_that_was_killed_in_its_first_line_leaves_no_damage(tmp_path):
    where = ran(tmp_path, "P01")
    first = where.path_of("P01", 1).read_bytes().split(b"\n")[0].replace(b"P01", b"P02")
    where.path_of("P02", 1).parent.mkdir()
    where.path_of("P02", 1).write_bytes(first[:80])
    run(where, "P02", None)
    run(where, "P03")
    assert [len(answers(where, who)) for who in ("P01", "P02", "P03")] == [52, 52, 52]


def test_a_note_of_a_withdrawal_that_was_cut_off_stops_nobody(tmp_path):
    where = ran(tmp_path, "P01", "P02")
    where.withdraw("P01")
    notes = where.folder / "withdrawals.jsonl"
    assert os.name == "nt" or notes.stat().st_mode & 0o077 == 0
    with notes.open("ab") as file:
        file.write(b'{"participant": "P02", "ti')
    run(where, "P03")
    where.withdraw("P02")
    assert [one.participant for one in where.withdrawals()] == ["P01", "P02"]
    for who in ("P01", "p01", "P02"):
        raises(ConfigurationError, "has withdrawn", run, where, who)


def test_a_note_of_a_withdrawal_that_was_changed_lets_nobody_back(tmp_path):
    where = ran(tmp_path, "P01")
    where.withdraw("P01")
    notes = where.folder / "withdrawals.jsonl"
    raw = notes.read_bytes()
    for changed in mutations(raw, 60, seed=7):
        notes.write_bytes(changed)
        if not refused(where.withdrawals):
            left = {one.participant for one in where.withdrawals()}
            assert left == {"P01"} or raw.startswith(changed), "one that was cut off"


def test_every_changed_byte_of_a_note_is_noticed_and_verify_knows_logs_and_notes(tmp_path):
    where = store(tmp_path)
    for who in ("P01", "P02", "P03"):
        raises(KeyboardInterrupt, "", run, where, who, 3)
    for who in ("P01", "P02"):
        where.withdraw(who)
    notes = where.folder / "withdrawals.jsonl"
    raw, log = notes.read_bytes(), where.path_of("P03", 1)
    assert verify(notes) == () and "is not sealed" in verify(log)[0]
    for place in range(len(raw)):
        notes.write_bytes(raw[:place] + bytes([raw[place] ^ 1]) + raw[place + 1 :])
        assert refused(where.withdrawals) and refused(lambda: verify(notes)), place
    notes.write_bytes(raw.splitlines(keepends=True)[1])
    assert refused(where.withdrawals), "the first one is missing"
    content = log.read_bytes()
    log.write_bytes(content.replace(b'"answer": ', b'"answer": ["P"], "b": ', 1))
    assert refused(lambda: verify(log))
    log.write_bytes(b"")
    assert refused(lambda: verify(log))


def test_a_log_of_another_program_under_a_hash_that_fits_is_refused(tmp_path):
    where = store(tmp_path)
    raises(KeyboardInterrupt, "", run, where, "P01", 3)
    path = where.path_of("P01", 1)
    entries = [from_text(line) for line in path.read_bytes().splitlines()]
    for number, entry in enumerate(entries):
        for key in entry:
            for other in (None, [], {}, "x", 1e300):
                changed = [*entries[:number], {**entry, key: other}, *entries[number + 1 :]]
                path.write_text("".join(map(as_line, changed)), encoding="utf-8")
                refused(where.sessions)
                refused(where.heads)
                refused(lambda: export_answers(where, tmp_path / "answers.csv"))
                (tmp_path / "answers.csv").unlink(missing_ok=True)
                (tmp_path / "answers.json").unlink(missing_ok=True)


FULL = """
import resource, signal, sys
from pathlib import Path
from haploop.experiments.protocol import load_experiment
from haploop.experiments.session import Store
from haploop.experiments.session.store import EventLog
from haploop.base.errors import HaploopError
from haploop.base.clock import RealClock

signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (900, 900))
where = Store(load_experiment("matching"), sys.argv[1])
log = EventLog(where.path_of("P09", 1), RealClock())
try:
    for number in range(10):
        log.add("begun", slot=8, filling="x" * 60)
except HaploopError as error:
    print(error)
log.close()
try:
    for number in range(10):
        (where.folder / f"P{number:02d}").mkdir(exist_ok=True)
        (where.folder / f"P{number:02d}" / ("x" * 100)).touch()
        where.withdraw(f"P{number:02d}")
except HaploopError as error:
    print(error)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="the disk is full by a limit on the size of files")
def test_a_full_disk_is_one_sentence_and_keeps_what_was_answered(tmp_path):
    result = subprocess.run(
        [sys.executable, "-c", FULL, str(tmp_path)], capture_output=True, text=True, check=True
    )
    said = result.stdout.splitlines()
    assert len(said) == 2 and not result.stderr
    assert "session-1.jsonl cannot be written: File too large." in said[0]
    assert "cannot be written: File too large. Nothing is deleted without it." in said[1]
    # What could not be noted was not deleted.
    noted = len(Store(load_experiment("matching"), tmp_path).withdrawals())
    assert 1 <= noted < 9 and (tmp_path / f"P{noted:02d}").is_dir() and not (tmp_path / "P00").exists()
    assert 1 <= len(read_log(tmp_path / "P09" / "session-1.jsonl")) < 4


@pytest.mark.parametrize("left", [1, 2])
def test_a_withdrawal_that_stopped_halfway_is_finished_before_anything_else(tmp_path, monkeypatch, left):
    where = ran(tmp_path, "P01", "P01", "P02")

    def halfway(folder):
        where.path_of("P01", 3 - left).unlink()
        raise PermissionError(13, "Permission denied", str(where.path_of("P01", left)))

    with monkeypatch.context() as patched:
        patched.setattr("shutil.rmtree", halfway)
        raises(DataError, "withdraw P01 again", where.withdraw, "P01")
    for use in (lambda: run(where, "P01"), lambda: run(where, "P03"), where.sessions):
        raises(DataError, "withdraw P01 again", use)
    where.withdraw("P01")
    run(where, "P03")
    assert where.participants() == ("P02", "P03")


@pytest.mark.skipif(os.name == "nt", reason="symbolic links need a right there")
def test_a_folder_that_is_a_link_is_not_noted_as_withdrawn(tmp_path):
    where = ran(tmp_path, "P01")
    (where.folder / "P01").rename(tmp_path / "elsewhere")
    (where.folder / "P01").symlink_to(tmp_path / "elsewhere")
    raises(DataError, "nothing of", where.withdraw, "P01")
    assert not where.withdrawals()


class Times:
    """A clock that is set by hand."""

    def __init__(self) -> None:
        self.time = 0.0

    def now(self) -> float:
        """Time (s)."""
        return self.time


def test_impossible_times_and_unfinished_sessions_are_kept_marked_and_can_be_left_out(tmp_path):
    where, clock = store(tmp_path), Times()
    with open_session(where, "P01", clock) as session:
        step = session.due
        while step is not None and not (step.block == "experiment" and step.number == 11):
            session.presented()
            clock.time += 1.0 if step.practice else {1: 0.01, 2: 900.0}.get(step.number, 1.0)
            session.answer(SimulatedParticipant(ParticipantModel(), "P01", 1).answer(step))
            step = session.due
    assert export_answers(where, tmp_path / "out.csv") == 10
    rows = read_rows(tmp_path / "out.csv")
    assert rows.text("timing") == ["too fast", "too slow", *["possible"] * 8]
    assert rows.numbers("duration") == pytest.approx([0.01, 900, *[1] * 8])
    assert set(rows.text("complete")) == {"false"}
    described = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))
    assert described["Unfinished"] == ["P01/session-1.jsonl"]
    notes = analyse_identification(rows).notes
    assert any("10 of 10 lines are of sessions that were not completed" in note for note in notes)
    assert any("2 of 10 lines were answered too fast or too slow" in note for note in notes)
    chosen = rows.choose("timing", "possible")
    result = analyse_identification(chosen)
    assert result.pooled.counts.sum() == 8 and "the 8 with timing possible" in " ".join(result.notes)
    raises(DataError, "no line with complete 'true'", rows.choose, "complete", "true")
    raises(DataError, "no column 'time_mark'", rows.choose, "time_mark", "possible")


def test_touches_leave_with_the_ratings(tmp_path):
    where, clock = store(tmp_path, "rating"), Times()
    touched = [[0.9, 2.5], *([1.0 + n] for n in range(1, 7))]
    with open_session(where, "P01", clock) as session:
        for instant in (False, True):
            assert session.due is not None
            session.presented()
            clock.time += 9.0
            times = [[0.01]] * 7 if instant else touched
            pairs = zip(session.due.choices, times, strict=True)
            session.answer({pair: {"value": 51, "touched": some} for pair, some in pairs})
    assert export_answers(where, tmp_path / "out.csv") == 14
    rows = read_rows(tmp_path / "out.csv")
    assert rows.numbers("touches") == [2, *[1] * 13]
    assert rows.numbers("first_touch")[:7] == [some[0] for some in touched]
    assert rows.numbers("last_touch")[:7] == [some[-1] for some in touched]
    assert rows.text("timing") == [*["possible"] * 7, *["too fast"] * 7]


def test_what_is_right_is_told_by_what_was_presented(tmp_path):
    """By the exported table alone: presented and answered, or the two values and the interval chosen."""
    for name in ("matching", "two-interval"):
        where = store(tmp_path / name, name)
        run(where, "P01", model=ParticipantModel.model_validate({"seed": 5, "comparison": {"lapse": 0.2}}))
        export_answers(where, tmp_path / name / "out.csv")
        rows = read_rows(tmp_path / name / "out.csv")
        right = rows.truths("correct")
        assert 0.2 < sum(right) / len(right) < 1, "some are right, and some wrong"
        if name == "matching":
            pairs = zip(rows.text("presented"), rows.text("answered"), strict=True)
            assert right == [presented == answered for presented, answered in pairs]
            continue
        comparison = where.experiment.file.comparison
        assert comparison is not None
        values = zip(rows.numbers("first_value"), rows.numbers("second_value"), strict=True)
        both = list(values)
        assert right == [
            (first > second) == (answered == "1")
            for (first, second), answered in zip(both, rows.text("answered"), strict=True)
        ]
        assert {min(one) for one in both} == {comparison.standard}
        assert rows.numbers("comparison") == [max(one) for one in both]


def test_a_trial_counts_its_own_presentations(tmp_path):
    where, clock = store(tmp_path), Times()
    with open_session(where, "P01", clock) as session:
        while session.due is not None and session.due.practice:
            session.presented()
            session.answer(SimulatedParticipant(ParticipantModel(), "P01", 1).answer(session.due))
        for times in (1, 3, 2):
            for _ in range(times):
                session.presented()
                clock.time += 1.0
            session.answer("latch")
    export_answers(where, tmp_path / "out.csv")
    rows = read_rows(tmp_path / "out.csv")
    assert rows.numbers("presentations") == [1, 3, 2]
    assert rows.numbers("duration") == [1, 1, 1], "from the last one"
    assert rows.numbers("onset") == [0, 3, 5]
