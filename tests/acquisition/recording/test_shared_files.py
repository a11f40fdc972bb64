"""Files that several programs write, files of people, and what killed programs left."""

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import pytest

from haploop.acquisition import record, recover
from haploop.acquisition.recording import Rejection, add_rejections
from haploop.acquisition.recording.recording import _rejections
from haploop.acquisition.recording.writer import Writer
from haploop.base.errors import DataError
from haploop.base.files import new_file, whole_file
from haploop.base.json_files import append_json, changing, read_json
from tests.acquisition.presses.pressworld import world_rig
from tests.acquisition.recording.pattern import header, unfinished

posix = pytest.mark.skipif(os.name == "nt", reason="Windows has access lists, which folders hand down")


def begun(program: str, path: Path, word: str, **more: Any) -> subprocess.Popen[str]:
    command, pipe = [sys.executable, "-c", program, str(path), word], subprocess.PIPE
    return subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, **more)


WRITER = """
import os, sys, tempfile
from pathlib import Path
from haploop.acquisition.recording import Rejection, add_rejections

folder, name = Path(sys.argv[1]), sys.argv[2]
print("ready", flush=True)
sys.stdin.readline()
for number in range(30):
    add_rejections(folder, [Rejection("P01-push.h5", "0" * 64, number, 1, name, "now")])
"""


def test_two_programs_lose_none_of_each_others_rejections(tmp_path):
    """With another TMPDIR each: the lock is beside the file."""
    writers = []
    for name in "ab":
        (tmp_path / name).mkdir()
        own = {**os.environ, "TMPDIR": str(tmp_path / name)}
        writers.append(begun(WRITER, tmp_path, name, env=own))
    for writer in writers:
        assert writer.stdout is not None and writer.stdout.readline() == "ready\n"
    for writer in writers:
        writer.stdin.write("go\n")
        writer.stdin.flush()
    for writer in writers:
        writer.communicate(timeout=120)
    assert [writer.returncode for writer in writers] == [0, 0]
    found = [(one.reason, one.number) for one in _rejections(tmp_path)]
    assert sorted(found) == [(name, number) for name in "ab" for number in range(30)]
    assert not list(tmp_path.glob(".*"))


def test_threads_of_one_program_wait_for_each_other_too(tmp_path):
    path = tmp_path / "a.json"
    threads = [
        threading.Thread(target=lambda: [append_json(path, "looks", [{}]) for _ in range(10)])
        for _ in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(read_json(path, "looks", list)) == 40


def test_a_program_that_never_ends_its_change(tmp_path, monkeypatch):
    monkeypatch.setattr("haploop.base.json_files._PATIENCE", 0.05)
    with changing(tmp_path / "a.json"), pytest.raises(DataError, match="is being changed by another program"):
        append_json(tmp_path / "a.json", "looks", [{}])


@posix
def test_recordings_of_people_can_be_read_by_their_owner_only(tmp_path):
    folder = tmp_path / "study" / "recordings"
    recording = record(world_rig(seed=4), "push", "P01", 1, folder)
    add_rejections(folder, [Rejection("P01-push.h5", recording.content_hash, 1, 1, "why", "now")])
    assert folder.stat().st_mode & 0o777 == 0o700
    left = unfinished(folder / "P02-push.h5")
    for path in (recording.path, folder / "rejections.json", left, recover(left)):
        assert path.stat().st_mode & 0o777 == 0o600, path
    with new_file(tmp_path / "press.h5") as part:
        part.write_bytes(b"no person's")
    assert (tmp_path / "press.h5").stat().st_mode & 0o777 == 0o666 & ~os.umask(os.umask(0o22) or 0o22)


KILLED = """
import os, signal, sys
from pathlib import Path
from haploop.base.files import whole_file

with whole_file(Path(sys.argv[1])) as part:
    part.write_bytes(bytes(1000))
    print(part, flush=True)
    if sys.argv[2] == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    sys.stdin.readline()
"""


@posix
def test_what_a_killed_program_left_is_removed_by_the_next_and_nothing_else(tmp_path):
    path = tmp_path / "P01-push.h5"
    killed, alive = (begun(KILLED, path, how) for how in ("killed", "alive"))
    kept, left = Path(alive.stdout.readline().strip()), Path(killed.stdout.readline().strip())
    assert killed.wait(60) == -signal.SIGKILL
    killed.communicate()
    others = [tmp_path / name for name in (".P01-push.h5.part", "a.0123456789abcdef.part", ".x.lock")]
    for other in others:
        other.write_bytes(b"somebody else's")
    assert left.exists() or not left.exists()  # the living one may have begun after the other's end
    (tmp_path / ".P02-push.h5.0123456789abcdef.part").write_bytes(b"of an older version")
    Writer(tmp_path / "P03-push.h5", header(), 250, 20).close()
    assert sorted(tmp_path.iterdir()) == sorted([*others, kept, tmp_path / "P03-push.h5"])
    alive.communicate("go on\n")
    assert alive.returncode == 0
    assert path.stat().st_size == 1000
    with pytest.raises(FileExistsError), whole_file(path):
        pass
