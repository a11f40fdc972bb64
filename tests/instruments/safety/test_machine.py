"""One place a computer for the locks of its hardware, whatever a program's environment and user are."""

import os
import stat
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from haploop.base.errors import InstrumentError
from haploop.base.marks import InUse
from haploop.instruments.safety import machine
from haploop.instruments.safety.lockout import Lockout, lockout_of, set_lockout
from haploop.instruments.safety.machine import hold
from tests.raising import raises

POSIX = pytest.mark.skipif(sys.platform == "win32", reason="links, pipes and users of POSIX")
PIECE = f"a card of test {os.getpid()}"

HOLDER = """
import os, sys
from pathlib import Path
from haploop.instruments.safety import machine
from haploop.base.marks import InUse, is_marked, marked
from haploop.instruments.safety.machine import hold
from haploop.instruments.safety.lockout import Lockout, clear_lockout, lockout_of, set_lockout
from haploop.base.json_files import as_file
if len(sys.argv) > 2:
    as_file("lockout", None)  # the other user may not read this one's environment
    machine._place = lambda: Path(sys.argv[2])
    os.umask(0o077)
    os.setgid(65534)
    os.setuid(65534)  # from here on another user
try:
    with hold({sys.argv[1]}, "The rig 'theirs'"):
        set_lockout(machine.folder(), {sys.argv[1]}, Lockout("now", "theirs", "them", ""))
        print("held", flush=True)
        sys.stdin.read()
except InUse as error:
    print("refused", error, flush=True)
"""


@contextmanager
def another(*arguments: str, **more: object) -> Iterator[str]:
    """Another program that holds the piece; what it says of that."""
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        **more,
    ) as process:
        try:
            yield process.stdout.readline().strip()
        finally:
            process.kill()


def test_programs_of_different_environments_exclude_each_other(tmp_path):
    names = ("TMPDIR", "TEMP", "TMP", "HOME", "HAPLOOP_STATE", "XDG_STATE_HOME", "XDG_RUNTIME_DIR")
    elsewhere = {**os.environ, **dict.fromkeys(names, str(tmp_path))}
    elsewhere |= {"PROGRAMDATA": str(tmp_path), "WIN_PD_OVERRIDE_COMMON_APPDATA": str(tmp_path)}
    with another(PIECE, env=elsewhere) as said:
        assert said == "held"
        with pytest.raises(InUse, match=r"The rig 'mine' is in use .* by process .* of .* on"):  # noqa: SIM117
            with hold({PIECE}, "The rig 'mine'"):
                pass
    with hold({PIECE}, "The rig 'mine'"), another(PIECE, env=elsewhere) as said:
        assert said.startswith("refused")
    # The lockout of the program that was killed holds for this one too.
    assert lockout_of(machine.folder(), {PIECE}) is not None
    (machine.folder() / machine.file_for(PIECE, "lockout")).unlink()
    assert not (machine.folder() / machine.file_for(PIECE, "lock")).exists(), "nothing is littered"


@POSIX
@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root can be another user")
def test_users_of_one_computer_exclude_each_other_and_clear_each_others_lockouts(monkeypatch):
    before = os.umask(0o077)
    try:
        # Not in pytest's own folder, which every session of it that begins closes to other users.
        with TemporaryDirectory(dir="/tmp") as name:
            Path(name).chmod(0o755)
            place = Path(name) / "place"
            monkeypatch.setattr(machine, "_place", lambda: place)
            set_lockout(machine.folder(), {PIECE}, Lockout("now", "mine", "me", ""))
            with another(PIECE, str(place)) as said:
                assert said == "held"
                with pytest.raises(InUse), hold({PIECE}, "The rig 'mine'"):
                    pass
            # What it left when it was killed keeps nobody out.
            with hold({PIECE}, "The rig 'mine'"), another(PIECE, str(place)) as said:
                assert said.startswith("refused")
            found = lockout_of(place, {PIECE})
            assert found is not None and found.why == "mine", "the first is kept"
            clear = HOLDER.split("try:", maxsplit=1)[0] + "clear_lockout(machine.folder(), {sys.argv[1]})"
            subprocess.run([sys.executable, "-c", clear, PIECE, str(place)], check=True)
            assert lockout_of(place, {PIECE}) is None
    finally:
        os.umask(before)


@POSIX
@pytest.mark.parametrize("make", ["link", "dangling link", "hard link", "pipe", "folder"])
def test_what_lies_under_the_name_of_a_lock_is_not_opened(place, tmp_path, make):
    victim = tmp_path / "victim"
    if make != "dangling link":
        victim.write_text("somebody's work")
    name = machine.folder() / machine.file_for(PIECE, "lock")
    match make:
        case "link" | "dangling link":
            name.symlink_to(victim)
        case "hard link":
            name.hardlink_to(victim)
        case "pipe":
            os.mkfifo(name)
        case "folder":
            name.mkdir()
    with pytest.raises(InstrumentError, match=r"The lock of .* cannot be opened .*: remove what is there"):  # noqa: SIM117
        with hold({PIECE}, "The rig 'mine'"):
            pass
    assert not victim.exists() if make == "dangling link" else victim.read_text() == "somebody's work"
    name.rename(machine.folder() / machine.file_for(PIECE, "lockout"))
    found = lockout_of(machine.folder(), {PIECE})
    assert found is not None and "cannot be read" in found.why


@POSIX
@pytest.mark.parametrize("make", ["link", "file"])
def test_a_place_that_is_not_a_folder_is_refused(place, tmp_path, make):
    (tmp_path / "other").mkdir()
    if make == "link":
        place.symlink_to(tmp_path / "other", target_is_directory=True)
    else:
        place.write_text("")
    raises(InstrumentError, r"which cannot be used \(it is not a folder of its own\)", machine.folder)


@POSIX
def test_everybody_may_write_there_and_nobody_removes_what_is_not_theirs(place):
    before = os.umask(0o077)
    try:
        assert stat.S_IMODE(machine.folder().stat().st_mode) == 0o1777
        machine.write(place / "a", b"x")
        assert stat.S_IMODE((place / "a").stat().st_mode) & 0o666 == 0o666
    finally:
        os.umask(before)


def test_a_place_that_may_not_be_written_is_refused(place, monkeypatch):
    machine.folder()
    monkeypatch.setattr(os, "access", lambda _path, mode: not mode & os.W_OK)  # as for a user who is not root
    raises(InstrumentError, r"cannot be used \(permission denied\): make it a folder", machine.folder)


def test_the_name_of_a_piece_s_file_is_the_same_in_every_version():
    """Programs of two versions on one computer find each other's locks."""
    assert machine.file_for("card Dev1", "lock") == "b895f5b9c803046c.lock"


@POSIX
def test_a_file_for_all_users_is_read_to_a_mebibyte_and_replaced_whole(place):
    path = machine.folder() / "a.duty"
    machine.write(path, b"long" * (1 << 19))
    assert stat.S_IMODE(path.stat().st_mode) == 0o1666
    assert len(machine.read(path)) == 1 << 20
    machine.write(path, b"short")
    assert machine.read(path) == path.read_bytes() == b"short"
    raises(FileNotFoundError, "", machine.read, place / "b.duty")
    assert not (place / "b.duty").exists()


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="open files are counted on Linux")
def test_what_is_refused_is_not_left_open(place):
    path = machine.folder() / "a.lock"
    path.touch()
    path.with_name("b.lock").hardlink_to(path)
    before = len(list(Path("/proc/self/fd").iterdir()))
    for _ in range(3):
        raises(OSError, "not a file of its own", machine.read, path)
    assert len(list(Path("/proc/self/fd").iterdir())) == before


@POSIX
def test_what_is_synced_is_the_whole_content(place, monkeypatch):
    synced: list[bytes] = []
    monkeypatch.setattr(os, "fsync", lambda number: synced.append(os.pread(number, 100, 0)))
    machine.write(machine.folder() / "a.duty", b"content")
    assert synced == [b"content"]


@pytest.mark.skipif(sys.platform != "linux", reason="mount namespaces are Linux's")
def test_a_program_that_sees_another_folder_there_excludes_others_too(place):
    """A service with a private /var/tmp has the same path, and finds no lock of ours in it."""
    theirs = f"""
import sys
from pathlib import Path
from haploop.instruments.safety import machine
from haploop.instruments.safety.machine import hold
machine._place = lambda: Path({str(place)!r})
with hold({{{PIECE!r}}}, "The rig 'theirs'"):
    print("held", flush=True)
    sys.stdin.read()
"""
    pipe = subprocess.PIPE
    with subprocess.Popen([sys.executable, "-c", theirs], stdin=pipe, stdout=pipe, text=True) as program:
        assert program.stdout is not None and program.stdout.readline() == "held\n"
        for path in place.glob("*.lock"):
            path.unlink()
        with pytest.raises(InUse, match=r"a program that has a .* of its own"), hold({PIECE}, "The rig"):
            pass
        program.kill()
    with hold({PIECE}, "The rig 'mine'"):
        pass
