"""The audit log: every play, refusal and stop is one line, with who and which rig file."""

import getpass
import hashlib
import json
import os
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from haploop.acquisition import content_hash, verify
from haploop.base.errors import ConfigurationError, DataError, InstrumentError, LimitError
from haploop.base.validation import validate
from haploop.instruments import load_rig_file, log_entries, open_rig
from haploop.instruments.config.rig_file import AbortLimits, RigFile
from haploop.instruments.safety.audit import Audit, entries, state_folder
from tests.mutating import mutations
from tests.raising import raises, raising

pytestmark = pytest.mark.usefixtures("unproved")

FILE = load_rig_file("simulated")
DRIVE = 10 * np.sin(2 * np.pi * 250 * np.arange(5000) / 50_000) * np.hanning(5000)


def kinds(folder: Path) -> list[Any]:
    return [entry["kind"] for entry in entries(folder)]


def test_what_a_rig_did_is_in_the_log():
    with open_rig("simulated") as rig:
        rig.excite(DRIVE, ["B", "A"], ["drive"])
        raises(LimitError, "", rig.excite, DRIVE * 10, ["A"], ["drive"])
        raises(ZeroDivisionError, "", rig.excite, DRIVE, ["A"], ["drive"], progress=lambda *_: 1 // 0)
        rig.audit.note("activated", calibration="0007", reason="drift")
    found = list(entries(rig.audit.folder))
    assert [entry["kind"] for entry in found] == [
        "opened", "played", "connected", "refused", "played", "connected", "stopped", "activated", "closed",
    ]  # fmt: skip
    assert found[1] | {
        "output": "amplifier",
        "patches": ["A", "B"],
        "peak": float(np.abs(DRIVE).max()),
        "seconds": 4998 / 50_000,
        "rate_hz": 50_000,
        "sha256": hashlib.sha256(DRIVE.tobytes()).hexdigest(),
    } == dict(found[1])
    assert "beyond the" in found[3]["why"] and "ZeroDivisionError" in found[6]["why"]
    for entry in found:
        assert entry["rig"] == "simulated" and entry["rig_sha256"] == rig.file.digest and entry["simulated"]
        assert entry["pid"] == os.getpid() and entry["user"] == getpass.getuser() and entry["version"]
        assert datetime.fromisoformat(entry["time"]).tzinfo is not None


def test_of_several_drives_the_largest_is_in_the_log():
    with open_rig("four-channel") as rig:
        rig.excite_each({"A": 0.5 * DRIVE, "B": DRIVE}, ["drive"])
    played = [entry for entry in entries(rig.audit.folder) if entry["kind"] == "played"]
    assert played[-1]["peak"] == float(np.abs(DRIVE).max())


def test_a_play_is_in_the_log_before_it_sounds():
    seen: list[str] = []

    def look(*_: object) -> None:
        seen.extend(kinds(rig.audit.folder))

    with open_rig("simulated") as rig:
        rig.excite(DRIVE, ["A"], ["drive"], progress=look)
    assert seen[:3] == ["opened", "played", "connected"]


def test_without_a_log_nothing_is_played(monkeypatch):
    with open_rig("simulated") as rig:
        write = os.write

        def full(descriptor: int, line: bytes) -> int:
            if b'"kind"' in line:
                raise OSError(28, "No space left on device")
            return write(descriptor, line)

        with monkeypatch.context() as patch:
            patch.setattr("os.write", full)
            with pytest.raises(
                DataError, match=r"audit log .* cannot be written \(No space left on device\)"
            ):
                rig.excite(DRIVE, ["A"], ["drive"])
            rig.make_safe()
        assert rig.simulation.truth.peak == 0


@pytest.mark.skipif(sys.platform == "win32", reason="Windows limits no file")
def test_a_line_of_which_the_disk_took_a_part_is_not_logged_and_spoils_no_other(tmp_path):
    import resource

    log = Audit(FILE, tmp_path, True)
    log.note("one")
    (path,) = tmp_path.glob("log-*.jsonl")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size + 20, hard))
    try:
        raises(DataError, r"cannot be written \(File too large\), and nothing is played", log.note, "played")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    log.note("two")
    assert kinds(tmp_path) == ["one", "damaged", "two"]


def test_a_month_has_a_file_and_nothing_is_ever_rewritten(tmp_path):
    now = datetime(2026, 1, 31, 23, 59, tzinfo=UTC)
    log = Audit(FILE, tmp_path, True, lambda: now)
    log.note("one")
    before = (tmp_path / "log-2026-01.jsonl").read_bytes()
    now = datetime(2026, 2, 1, tzinfo=UTC)
    log.note("two")
    assert (tmp_path / "log-2026-01.jsonl").read_bytes() == before
    assert kinds(tmp_path) == ["one", "two"]
    assert len(before) < 600


def test_a_torn_or_changed_line_hides_no_other_and_is_told(tmp_path):
    log = Audit(FILE, tmp_path, True)
    log.note("one")
    (path,) = tmp_path.glob("log-*.jsonl")
    with path.open("ab") as torn:
        torn.write(b'{"kind": "to\n\xff\xfe\n[1]\n')
    log.note("two")
    assert kinds(tmp_path) == ["one", *3 * ["damaged"], "two"]
    assert verify(path)[0].startswith(f"{path} has 3 damaged lines. Line 2 of {path.name} was torn")
    path.write_bytes(path.read_bytes().replace(b'"kind": "two"', b'"kind": "too"'))
    damaged = [entry for entry in entries(tmp_path) if entry["kind"] == "damaged"]
    assert len(damaged) == 4 and "Line 5 of" in damaged[-1]["why"]
    # Of any rig, because nothing else is known of it.
    path.replace(state_folder(FILE, True) / path.name)
    assert [entry["kind"] for entry in log_entries(FILE)] == ["one", *4 * ["damaged"]]


def test_no_changed_line_is_taken_for_another(tmp_path, full):
    log = Audit(FILE, tmp_path, True)
    for kind in ("one", "two", "three"):
        log.note(kind, peak=39.8, patches=["A"])
    (path,) = tmp_path.glob("log-*.jsonl")
    raw, whole = path.read_bytes(), list(entries(tmp_path))
    assert verify(path) == () and content_hash(path) == hashlib.sha256(raw).hexdigest()
    damaged = 0
    for changed in mutations(raw, 500 if full else 100, seed=6):
        path.write_bytes(changed)
        found = list(entries(tmp_path))
        assert all(entry in whole or "rig" not in entry for entry in found)
        damaged += bool(verify(path))
    assert damaged > (400 if full else 80)


def test_what_json_does_not_have_is_not_logged(tmp_path):
    log = Audit(FILE, tmp_path, True)
    for value in (float("nan"), float("inf"), Path("a"), {1, 2}):
        raises(DataError, "'one' cannot be logged", log.note, "one", value=value)
    assert not list(entries(tmp_path))


@pytest.mark.long
def test_two_programs_write_one_log_line_by_line(tmp_path, full):
    lines = 2000 if full else 200
    script = (
        "import sys; from pathlib import Path; from haploop.instruments import load_rig_file\n"
        "from haploop.instruments.safety.audit import Audit\n"
        "log = Audit(load_rig_file('simulated'), Path(sys.argv[1]), True)\n"
        f"for k in range({lines}): log.note('line', k=k, filling='x' * 300)"
    )
    log, written = Audit(FILE, tmp_path, True), 0
    with subprocess.Popen([sys.executable, "-c", script, str(tmp_path)]) as other:
        while other.poll() is None:
            log.note("line", k=written, filling="y" * 300)
            written += 1
    assert other.returncode == 0
    (path,) = tmp_path.glob("log-*.jsonl")
    found = [json.loads(line) for line in path.read_text().splitlines() if line]
    for pid, count in ((other.pid, lines), (os.getpid(), written)):
        assert [entry["k"] for entry in found if entry["pid"] == pid] == list(range(count))


def test_where_the_log_is(tmp_path, monkeypatch):
    own = FILE.model_copy(update={"state": str(tmp_path / "lab")})
    assert state_folder(own, True).parent == Path(os.environ["HAPLOOP_STATE"])
    monkeypatch.delenv("HAPLOOP_STATE")
    assert state_folder(own, False) == tmp_path / "lab" / "rigs"
    monkeypatch.setattr("platformdirs.user_state_path", lambda _: tmp_path / "user")
    assert state_folder(FILE, False) == tmp_path / "user" / "rigs"
    assert state_folder(FILE, True) == tmp_path / "user" / "simulated"


def test_a_labs_folder_is_one_place_wherever_a_program_starts():
    with pytest.raises(ConfigurationError, match=r"state: .*absolute path"):
        validate(RigFile, FILE.model_dump() | {"state": "logs"}, "lab.toml")


@pytest.mark.skipif(sys.platform == "win32", reason="Windows' folders hand their rights on")
@pytest.mark.parametrize("rights", [0o700, 0o755, 0o1777, 0o2770])
def test_logs_have_the_folders_rights(tmp_path, monkeypatch, rights):
    monkeypatch.delenv("HAPLOOP_STATE")
    place = tmp_path / "lab"
    place.mkdir()
    place.chmod(rights)
    limited = FILE.model_copy(update={"state": str(place), "abort": AbortLimits(drive=5.0)})
    monkeypatch.setattr("platformdirs.user_state_path", lambda _: place)
    with open_rig(limited) as rig, pytest.raises(InstrumentError, match="allows 5 V"):
        rig.excite(DRIVE, ["A"], ["drive"])
    for folder in (place / "simulated", place / "simulated" / "trips"):
        assert folder.stat().st_mode == place.stat().st_mode
    (log,) = (place / "simulated").glob("log-*.jsonl")
    assert log.stat().st_mode & 0o777 == rights & 0o666


def test_a_folder_that_cannot_be_written(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("HAPLOOP_STATE", str(tmp_path / "file"))
    for simulated in (True, False):
        with pytest.raises(ConfigurationError, match="set HAPLOOP_STATE to a writable folder") as refused:
            state_folder(FILE, simulated)
        assert "\n" not in str(refused.value)


def test_a_simulation_needs_no_home(tmp_path, monkeypatch):
    monkeypatch.delenv("HAPLOOP_STATE")
    monkeypatch.setattr(
        "platformdirs.user_state_path", raising(RuntimeError("Could not determine home directory."))
    )
    with open_rig("simulated") as rig:
        rig.excite(DRIVE, ["A"], ["drive"])
    assert [entry["kind"] for entry in entries(rig.audit.folder)][-1] == "closed"
    raises(ConfigurationError, "HAPLOOP_STATE", state_folder, FILE, False)
