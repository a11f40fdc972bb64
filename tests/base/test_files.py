"""A file gets its name whole or not at all, and never in place of another: on poor disks and in races too."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from haploop.base import publishing
from haploop.base.errors import ConfigurationError, DataError
from haploop.base.files import check_destination, new_file, reserved, room, whole_file
from haploop.base.publishing import publish
from tests.raising import raises, raising


def no_links(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "link", raising(OSError(errno.EPERM, "Operation not permitted")))


@pytest.fixture(params=["links", "no links"])
def any_disk(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if request.param == "no links":
        no_links(monkeypatch)


def written(path: Path, text: str = "mine") -> None:
    with new_file(path) as part:
        part.write_text(text)


def texts(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text() for path in folder.iterdir()}


@pytest.mark.usefixtures("any_disk")
def test_a_new_file_is_there_whole_and_alone(tmp_path):
    with new_file(tmp_path / "a.txt") as part:
        part.write_text("mine")
        assert part.parent == tmp_path and part.name.startswith(".a.txt.")
        assert not (tmp_path / "a.txt").exists()
    assert texts(tmp_path) == {"a.txt": "mine"}


@pytest.mark.usefixtures("any_disk")
@pytest.mark.parametrize("theirs", ["", "theirs"])
def test_a_file_that_came_to_be_meanwhile_stays(tmp_path, theirs):
    path = tmp_path / "a.txt"
    with (
        pytest.raises(DataError, match=r"a\.txt already exists and is not overwritten"),
        new_file(path) as part,
    ):
        part.write_text("mine")
        path.write_text(theirs)
    assert texts(tmp_path) == {"a.txt": theirs}


def test_a_file_is_replaced_that_somebody_reads(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("theirs")
    reader = "import sys, time; file = open(sys.argv[1]); print(flush=True); time.sleep(0.5)"
    with subprocess.Popen([sys.executable, "-c", reader, str(path)], stdout=subprocess.PIPE) as reading:
        assert reading.stdout is not None and reading.stdout.readline()
        with whole_file(path, replace=True) as part:
            part.write_text("mine")
    assert texts(tmp_path) == {"a.txt": "mine"}


@pytest.mark.skipif(os.name == "nt", reason="Windows needs no claim")
def test_what_somebody_writes_into_the_claim_stays(tmp_path, monkeypatch):
    path = tmp_path / "a.txt"
    no_links(monkeypatch)
    empty = publishing._empty

    def late(claim: Path) -> bool:
        if claim.stat().st_size == 0:
            claim.write_text("theirs")
        return empty(claim)

    monkeypatch.setattr(publishing, "_empty", late)
    raises(DataError, "not overwritten", written, path)
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [("a.txt", "theirs")]


@pytest.mark.skipif(os.name == "nt", reason="Windows needs no claim")
def test_a_rename_that_fails_leaves_no_claim(tmp_path, monkeypatch):
    no_links(monkeypatch)
    monkeypatch.setattr(Path, "replace", raising(OSError(errno.EIO, "Input/output error")))
    raises(DataError, r"a\.txt cannot be written: Input/output error\.$", written, tmp_path / "a.txt")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(os.name == "nt", reason="a dangling link needs rights on Windows")
@pytest.mark.usefixtures("any_disk")
def test_a_name_that_points_nowhere_is_taken(tmp_path):
    (tmp_path / "a.txt").symlink_to(tmp_path / "b.txt")
    raises(DataError, "not overwritten", written, tmp_path / "a.txt")
    raises(ConfigurationError, "not overwritten", check_destination, tmp_path / "a.txt")
    with pytest.raises(FileExistsError), whole_file(tmp_path / "a.txt") as part:
        part.write_text("mine")
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


@pytest.mark.parametrize("length", [233, 256, 3000])
def test_a_name_that_no_disk_takes_is_told_before_anything_is_measured(tmp_path, length):
    """233 are too many as well: while it is written, a file has a longer name."""
    with pytest.raises(ConfigurationError, match=rf"^aaa.* has {length} characters, .* choose a shorter one"):
        check_destination(tmp_path / ("a" * (length - 3) + ".h5"))
    check_destination(tmp_path / ("a" * 200))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(os.name == "nt", reason="Windows renames without links")
def test_a_link_made_but_not_confirmed_counts(tmp_path, monkeypatch):
    link = os.link

    def twice(source: Path, destination: Path) -> None:
        link(source, destination)
        link(source, destination)

    monkeypatch.setattr(os, "link", twice)
    written(tmp_path / "a.txt")
    assert texts(tmp_path) == {"a.txt": "mine"}


@pytest.mark.usefixtures("any_disk")
def test_reserved_files_get_their_names_together(tmp_path):
    first, second, other = (tmp_path / name for name in ("a.txt", "b.txt", "c.txt"))
    with reserved(first, second, size=10_000):
        (held,) = tmp_path.iterdir()
        assert held.stat().st_size == 10_000
        written(first)
        assert held.stat().st_size == 0
        raises(DataError, "not overwritten", written, first)
        written(second)
        written(other)
        assert not first.exists() and not second.exists() and other.exists()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.txt", "b.txt", "c.txt"]
    with pytest.raises(ConfigurationError, match="not overwritten"), reserved(other, second, size=10_000):
        pass


@pytest.mark.usefixtures("any_disk")
@pytest.mark.parametrize("taken", ["a.txt", "b.txt"])
def test_of_reserved_files_none_or_all_are_there(tmp_path, taken):
    first, second = tmp_path / "a.txt", tmp_path / "b.txt"
    with pytest.raises(ZeroDivisionError), reserved(first, second, size=1):
        written(first)
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(DataError, match=f"{taken} already exists"), reserved(first, second, size=1):
        written(first)
        written(second)
        (tmp_path / taken).write_text("theirs")
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [(taken, "theirs")]


def test_room_is_given_back_as_it_is_used_and_that_of_a_killed_program_by_the_next(tmp_path):
    left = tmp_path / f".room.{'0' * 16}.part"
    left.write_bytes(b"killed")
    with room(tmp_path, 1000) as held:
        (own,) = tmp_path.iterdir()
        assert own != left
        for free, remains in ((300, 700), (500, 200), (900, 0)):
            held.free(free)
            assert own.stat().st_size == remains
    assert list(tmp_path.iterdir()) == []


def test_an_error_leaves_nothing_and_is_one_sentence(tmp_path):
    with pytest.raises(ZeroDivisionError), new_file(tmp_path / "a.txt") as part:
        part.write_text("mine")
        raise ZeroDivisionError
    with pytest.raises(DataError, match=r"a\.txt cannot be written: No such file or directory\.$"):
        written(tmp_path / "none" / "a.txt")
    with (
        pytest.raises(DataError, match=r"cannot be written: the disk may be full\.$"),
        new_file(tmp_path / "a.txt"),
    ):
        raise RuntimeError("Unable to synchronously close file")
    assert list(tmp_path.iterdir()) == []


def test_a_replaced_file_is_the_old_or_the_new_one(tmp_path, monkeypatch):
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(ZeroDivisionError), whole_file(path, replace=True) as part:
        part.write_text("ne")
        raise ZeroDivisionError
    assert path.read_text() == "old"
    with whole_file(path, replace=True) as part:
        part.write_text("new")
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [("a.txt", "new")]


@pytest.mark.skipif(os.name == "nt", reason="Windows has no sync of folders")
@pytest.mark.usefixtures("any_disk")
def test_a_file_is_synced_before_its_name(tmp_path, monkeypatch):
    synced: list[tuple[str, bool]] = []
    fsync = os.fsync

    def note(number: int) -> None:
        synced.append((Path(f"/proc/self/fd/{number}").readlink().name, (tmp_path / "a.txt").exists()))
        fsync(number)

    if not Path("/proc/self/fd").is_dir():
        pytest.skip("only Linux names a descriptor's file")
    monkeypatch.setattr(os, "fsync", note)
    written(tmp_path / "a.txt")
    (part, before), (folder, after) = synced
    assert part.startswith(".a.txt.") and not before
    assert folder == tmp_path.name and after


def test_a_move_never_replaces(tmp_path):
    (tmp_path / "a").write_text("a")
    (tmp_path / "b").write_text("b")
    raises(FileExistsError, "", publish, tmp_path / "a", tmp_path / "b")
    publish(tmp_path / "a", tmp_path / "c")
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == {"b": "b", "c": "a"}


RACER = """
import errno, os, sys, time
from pathlib import Path
from haploop.base.errors import DataError
from haploop.base.files import new_file

folder, name, links = Path(sys.argv[1]), sys.argv[2], sys.argv[3]
if links == "no links":
    def refuse(*_, **__):
        raise OSError(errno.EPERM, "no links")
    os.link = refuse
print("ready", flush=True)
sys.stdin.readline()
for number in range(60):
    try:
        with new_file(folder / f"{number}.txt") as part:
            part.write_text(name * 1000)
            time.sleep(0.0005)
        print("won", number)
    except DataError as error:
        assert "not overwritten" in str(error), error
"""


@pytest.mark.long
@pytest.mark.parametrize("disks", [("links", "links"), ("no links", "no links"), ("links", "no links")])
def test_of_two_programs_exactly_one_wins_each_name(tmp_path, disks):
    commands = [[sys.executable, "-c", RACER, str(tmp_path), *own] for own in zip("ab", disks, strict=True)]
    pipe = subprocess.PIPE
    racers = [subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) for command in commands]
    for racer in racers:
        assert racer.stdout is not None and racer.stdout.readline() == "ready\n"
    for racer in racers:
        racer.stdin.write("go\n")
        racer.stdin.flush()
    told = [racer.communicate(timeout=120)[0].split("\n")[:-1] for racer in racers]
    assert [racer.returncode for racer in racers] == [0, 0]
    winner = {int(line.split()[1]): name for name, lines in zip("ab", told, strict=True) for line in lines}
    assert sum(map(len, told)) == len(winner) == 60
    assert texts(tmp_path) == {f"{number}.txt": name * 1000 for number, name in winner.items()}
