"""The catalogue says what lies in folders, and never what lay there before."""

import os
import re
import shutil
import sqlite3
import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

import haploop
from haploop.acquisition import Curve, Recording
from haploop.acquisition.recording import Rejection, add_rejections
from haploop.calibration import ButtonPlan, Waveforms
from haploop.experiments import load_experiment
from haploop.reports.catalogue import index as catalogue_index
from tests.calibration.conftest import make_press
from tests.exchange.conftest import make_check, make_drive


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("catalogue")
    with haploop.open_rig("simulated") as rig:
        haploop.record(rig, button="push", participant="P01", presses=1, out=folder / "recordings")
    drive = make_drive()
    make_press().save(folder / "press.h5")
    drive.save(folder / "drive.h5")
    make_check(drive).save(folder / "check.h5")
    return folder


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "data"))


@pytest.fixture
def index(tmp_path: Path) -> Path:
    return tmp_path / "cache" / "index.sqlite3"


def names(entries: tuple[haploop.reports.Entry, ...]) -> list[str]:
    return [Path(entry.file).name for entry in entries]


def test_every_kind_that_a_page_offers_or_a_file_has_can_be_asked_for(tmp_path, index):
    """ "experiment" was refused: the Files page then showed what it had listed before, with an error."""
    root = Path(haploop.__file__).parent
    page = (root / "console/server/static/catalogue.html").read_text(encoding="utf-8")
    offered = re.findall(r"<option>([a-z ]+)</option>", page.partition("</select>")[0])
    written = [
        kind
        for source in (root / "calibration").rglob("*.py")
        for kind in re.findall(r'hdf5\.write\(\w[\w.()]*, "([a-z ]+)"', source.read_text(encoding="utf-8"))
    ]
    assert len(offered) == 10 and len(written) >= 9
    (tmp_path / "data" / "rating").mkdir(parents=True)
    text = load_experiment("rating").path.read_text(encoding="utf-8")
    (tmp_path / "data" / "rating" / "experiment.toml").write_text(text, encoding="utf-8")
    for kind in {*offered, *written}:
        found = haploop.list_files([tmp_path / "data"], f"kind={kind}", index=index)
        assert names(found) == ["experiment.toml"] * (kind == "experiment")


def test_each_file_is_listed_with_what_it_holds(folder, index):
    (folder / "notes.h5").write_bytes(b"no HDF5")
    (folder / "other.txt").write_text("no file of ours")
    found = {Path(entry.file).name: entry for entry in haploop.list_files([folder], index=index)}
    assert set(found) == {"P01-push.h5", "press.h5", "drive.h5", "check.h5", "notes.h5"}
    recording = found["P01-push.h5"]
    own = Recording.open(folder / "recordings" / "P01-push.h5")
    assert (recording.kind, recording.participant, recording.button) == ("recording", "P01", "push")
    assert (recording.verdict, recording.presses, recording.simulated) == ("complete", "1/1", "yes")
    assert (recording.date, recording.content_hash) == (own.header.started, own.content_hash)
    assert (found["check.h5"].verdict, found["drive.h5"].patch) == ("pass", "A")
    assert found["notes.h5"].kind == "damaged" and "notes.h5" in found["notes.h5"].problem


NO_POINTS = (None,) * 5


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (
            Curve("mx", "t.csv", "ab", {}, (), True, np.arange(3.0), np.ones(3), np.zeros(0), 2, *NO_POINTS),
            {"button": "mx", "simulated": "yes", "made_from": '[["original", "t.csv", "ab", []]]'},
        ),
        (
            ButtonPlan("push", "lab", (), False, (("P01-push.h5", "ab"),)),
            {
                "button": "push",
                "rig": "lab",
                "simulated": "no",
                "made_from": '[["recording", "P01-push.h5", "ab", []]]',
            },
        ),
        (
            Waveforms((), "ab", "A", "40", "drive", 100.0, "laser", 1.0, 5e3, 0.0, 0.0, "velocity", True),
            {"patch": "A", "point": "40", "simulated": "yes", "holds": "ab"},
        ),
    ],
    ids=["curve", "plan", "waveforms"],
)
def test_a_file_is_listed_with_all_that_it_says(value, said, tmp_path, index, run):
    value.save(tmp_path / "one.h5")
    (entry,) = haploop.list_files([tmp_path], index=index)
    assert {key: getattr(entry, key) for key in said} == said
    assert said["simulated"] == "no" or "(simulated)" in run("list --in", tmp_path).stdout


@pytest.mark.parametrize(
    ("where", "expected"),
    [
        (["kind=recording"], ["P01-push.h5"]),
        (["button=push", "kind!=recording"], ["check.h5", "drive.h5", "press.h5"]),
        (["verdict=pass"], ["check.h5"]),
        (["file=*dr?ve*"], ["drive.h5"]),
        (["participant=P01", "date>=2000-01", "date<=2099"], ["P01-push.h5"]),
        (["participant=P01", "date<=2000-01"], []),
        (["participant=P01' OR '1'='1"], []),
    ],
)
def test_conditions(folder, index, where, expected):
    assert names(haploop.list_files([folder], where, index=index)) == expected


def test_the_index_is_never_a_second_truth(folder, index, monkeypatch):
    before = haploop.list_files([folder], index=index)
    read: list[str] = []
    entry_of = catalogue_index.entry_of
    monkeypatch.setattr(catalogue_index, "entry_of", lambda path: read.append(path) or entry_of(path))
    assert haploop.list_files([folder], index=index) == before and not read
    # Gone, renamed, damaged, and rejected afterwards.
    (folder / "drive.h5").unlink()
    (folder / "press.h5").rename(folder / "again.h5")
    content = bytearray((folder / "check.h5").read_bytes())
    content[-100] ^= 1
    (folder / "check.h5").write_bytes(content)
    recording = Recording.open(folder / "recordings" / "P01-push.h5")
    (press,) = recording.accepted
    why = Rejection(recording.path.name, recording.content_hash, press.number, press.attempt, "why", "now")
    add_rejections(folder / "recordings", [why])
    after = {Path(entry.file).name: entry for entry in haploop.list_files([folder], index=index)}
    assert set(after) == {"again.h5", "check.h5", "P01-push.h5"} and len(read) == 3
    assert after["check.h5"].kind == "damaged" and after["P01-push.h5"].presses == "0/1"
    assert haploop.list_files([folder], index=index, rebuild=True) == tuple(
        sorted(after.values(), key=lambda entry: entry.file)
    )


@pytest.mark.skipif(os.name == "nt", reason="symbolic links need a privilege there")
def test_a_file_that_cannot_be_read_is_listed_until_it_can(tmp_path, folder, index):
    link = tmp_path / "there" / "press.h5"
    link.parent.mkdir()
    link.symlink_to(tmp_path / "press.h5")
    (entry,) = haploop.list_files([link.parent], index=index)
    assert entry.kind == "unreadable" and f"{link} cannot be read: it has gone, is a link" in entry.problem
    shutil.copy(folder / "press.h5", tmp_path / "press.h5")
    (entry,) = haploop.list_files([link.parent], index=index)
    assert entry.kind == "representative"


@pytest.mark.skipif(sys.platform != "linux", reason="names that are not UTF-8, pipes")
def test_a_folder_may_hold_anything(tmp_path, folder, index, run):
    own = (folder / "press.h5").read_bytes()
    odd = tmp_path / "ünï [1]"
    (odd / "folder.h5").mkdir(parents=True)
    (odd / "loop").symlink_to(odd)
    (odd / "zero.h5").touch()
    (odd / "préss [2].h5").write_bytes(own)
    Path(os.fsdecode(os.fsencode(odd) + b"/\xff.h5")).write_bytes(own)
    os.mkfifo(odd / "pipe.h5")  # opening it would wait for ever
    found = haploop.list_files([odd], index=index)
    assert {entry.file.rpartition("/")[2]: entry.kind for entry in found} == {
        "\\udcff.h5": "unreadable", "préss [2].h5": "representative", "zero.h5": "damaged",
    }  # fmt: skip
    assert names(haploop.list_files([odd], ["file=*[2]*"], index=index)) == ["préss [2].h5"]
    assert not haploop.list_files([odd], ["file=*pr[e-z]ss*"], index=index)
    shown = run("list --in", odd)
    assert shown.exit_code == 0 and "zero.h5" in shown.stdout


def test_an_index_that_cannot_be_used_is_made_again_or_done_without(folder, index, monkeypatch):
    before = haploop.list_files([folder], index=index)
    index.unlink()
    assert haploop.list_files([folder], index=index) == before
    index.write_bytes(b"no database at all" * 100)
    assert haploop.list_files([folder], index=index) == before
    assert haploop.list_files([folder], index=folder / "drive.h5" / "x") == before  # nowhere to write
    with closing(sqlite3.connect(index)) as database:  # of another version
        database.execute("ALTER TABLE files DROP COLUMN verdict")
    assert haploop.list_files([folder], index=index) == before
    with closing(sqlite3.connect(index)) as database:  # and the new one is kept
        assert database.execute("SELECT count(*) FROM files WHERE verdict = 'pass'").fetchone() == (1,)
    (folder / "drive.h5").rename(folder / "again.h5")
    connect = sqlite3.connect
    monkeypatch.setattr(sqlite3, "connect", lambda path, **_: connect(path, timeout=0.01))
    with closing(connect(index)) as other:
        other.execute("BEGIN EXCLUSIVE")
        found = haploop.list_files([folder], index=index)
    assert len(found) == len(before) and "again.h5" in names(found)


def test_what_was_read_before_an_interruption_is_kept(folder, index, monkeypatch):
    monkeypatch.setattr(catalogue_index, "_KEPT", 1)

    def interrupt(_step, done, *_):
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        haploop.list_files([folder], index=index, progress=interrupt)
    read: list[str] = []
    entry_of = catalogue_index.entry_of
    monkeypatch.setattr(catalogue_index, "entry_of", lambda path: read.append(path) or entry_of(path))
    assert len(haploop.list_files([folder], index=index)) == 4 and len(read) == 2


def test_a_recording_in_progress_is_looked_at_again(folder, index, monkeypatch):
    from haploop.acquisition.recording import recording as module

    with monkeypatch.context() as patch:
        patch.setattr(module.Recording, "complete", False)
        assert haploop.list_files([folder], ["kind=recording"], index=index)[0].verdict == "incomplete"
    assert haploop.list_files([folder], ["kind=recording"], index=index)[0].verdict == "complete"


def test_many_files_are_read_by_several_processes(folder, index, monkeypatch):
    for n in range(20):
        os.link(folder / "drive.h5", folder / f"{n:02d}.h5")
    monkeypatch.setattr(catalogue_index, "_ALONE", 10)
    found = haploop.list_files([folder], ["kind=drive"], index=index)
    assert len(found) == 21 and {entry.button for entry in found} == {"push"}


def test_the_command(folder, index, run, monkeypatch):
    monkeypatch.setattr(catalogue_index, "user_cache_path", lambda _: index.parent)
    listed = run("list --in", folder)
    assert listed.exit_code == 0 and "4 files, all of the rig simulated." in listed.stdout
    assert f"\ncheck, in {folder}\n" in listed.stdout and "P01" in listed.stdout
    values = run.json("list kind=check --in", folder)
    assert [entry["verdict"] for entry in values["files"]] == ["pass"]
    monkeypatch.setattr("haploop.reports.show.terminal._MANY", 0)
    demanded = run("list --in", folder)
    assert demanded.stdout.splitlines()[-1] == "4 files, all of the rig simulated."
    run("list colour=red --in", folder, says="colour=red")
    run("list --in", folder / "nowhere", ends=2)


def test_the_list_is_a_table_at_80_columns(demo, run, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.chdir(demo.folder)
    lines = run("list --in", demo.folder).stdout.splitlines()
    assert max(map(len, lines)) <= 80
    headings = next(line.split() for line in lines if "Participant" in line)
    assert headings == ["File", "Participant", "Button", "Date", "Verdict", "Presses"]
