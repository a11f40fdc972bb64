import hashlib
import json
import pickle
import re
import shutil
import subprocess
import zlib
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from haploop.acquisition import Recording, record, verify
from haploop.acquisition.recording.file_format import read_header, write_header
from haploop.base.checksum import add_checksum
from haploop.base.errors import DataError
from haploop.instruments import load_rig_file
from tests.acquisition.presses.pressworld import world_rig
from tests.acquisition.recording.pattern import header, unfinished
from tests.raising import raises


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> tuple[Recording, np.ndarray]:
    rig = world_rig(seed=4)
    recording = record(rig, "push", "P01", 2, tmp_path_factory.mktemp("finished"))
    return recording, np.concatenate(rig.daq.given, axis=1)


def test_what_the_card_gave_is_what_the_file_holds(finished):
    recording, given = finished
    with h5py.File(recording.path) as file:
        codes = file["codes"][:]
        scale = file["codes"].attrs["volts_per_code"]
    assert np.array_equal(codes, given[:, : codes.shape[1]])
    assert np.array_equal(recording.volts, codes * scale[:, None])
    assert recording.complete
    assert verify(recording.path) == ()
    assert recording.duration == codes.shape[1] / 5000
    assert np.allclose(np.diff(recording.blocks["time"]), 0.05)


def test_a_finished_file_says_who_what_and_how(finished):
    recording, _ = finished
    assert (recording.button, recording.participant, recording.rig) == ("push", "P01", "simulated")
    assert recording.sensors == load_rig_file("simulated").sensors
    assert recording.delay("activation") == pytest.approx(42e-6)
    assert recording.delay("force") == pytest.approx(30e-6)
    kinds = [event.kind for event in recording.events]
    assert kinds == ["rest", "prompt", "pressed", "prompt", "pressed"]
    with h5py.File(recording.path) as file:
        assert (file.attrs["format"], file.attrs["format_version"]) == ("haploop recording", 5)
        assert file.attrs["software"].startswith("haploop ")
        assert "T" in file.attrs["started"]


def test_the_hash_is_the_one_that_the_format_describes(finished):
    """With h5py alone, by the words of docs/reference/format.md."""
    with h5py.File(finished[0].path) as file:
        a = file.attrs
        essential = {name: a[name] for name in ("button", "participant", "session", "study")}
        essential |= {name: a[name].tolist() for name in ("channels", "delays", "full_scale")}
        essential |= {name: file[name].asstr()[()] for name in ("about", "notes", "protocol")}
        essential |= {"rate_hz": float(a["rate_hz"]), "rest": float(a["rest"])}
        essential |= {"presses": int(a["presses"]), "simulated": bool(a["simulated"])}
        essential["sensors"] = json.loads(file["rig"].asstr()[()])["sensors"]
        essential["samples"] = file["codes"].shape[1]
        parts = [json.dumps(essential, sort_keys=True).encode(), file["codes"][:].tobytes()]
        parts += [file["blocks"][column].tobytes() for column in ("first", "count", "overload")]
        parts += [file[name][:].tobytes() for name in ("events", "presses")]
        assert hashlib.sha256(b"".join(parts)).hexdigest() == a["content_hash"]
        row = file["events"][0]
        assert zlib.crc32(row.tobytes()[:-4]) == row["crc"]


def test_the_checksums_are_those_that_the_format_describes(finished, tmp_path):
    """By the words of docs/reference/format.md."""
    for path in (finished[0].path, unfinished(tmp_path / "P02-push.h5")):
        raw = path.read_bytes()
        start = raw[:8192].index(b'{"haploop": ')
        said = json.loads(raw[start : start + 512])
        assert said["haploop"] == "recording" and said["bytes"] == len(raw)
        digest = hashlib.sha256(json.dumps([said["haploop"], said["bytes"], said["without"]]).encode())
        place = 0
        for first, count in (*sorted([*said["without"], [start, 512]]), (len(raw), 0)):
            digest.update(raw[place:first])
            place = first + count
        assert digest.hexdigest() == said["sha256"]
        with h5py.File(path) as file:
            a = file.attrs
            names = ["button", "participant", "study", "session", "rig_name", "daq", "software", "started"]
            header = {name: a[name] for name in names}
            header |= {name: file[name].asstr()[()] for name in ("rig", "protocol", "notes", "about")}
            header |= {"state": a["state"], "presses": int(a["presses"]), "simulated": bool(a["simulated"])}
            header |= {"rate_hz": float(a["rate_hz"]), "rest": float(a["rest"])}
            header |= {name: a[name].tolist() for name in ("channels", "full_scale", "delays")}
            text = json.dumps(header, sort_keys=True)
            assert hashlib.sha256(text.encode()).hexdigest() == a["header_hash"]
            if a["state"] == "finished":
                assert said["without"] == []
                for row in file["blocks"][:]:
                    codes = file["codes"][:, row["first"] : row["first"] + row["count"]]
                    assert zlib.crc32(codes.tobytes()) == row["samples_crc"]
                    assert zlib.crc32(row.tobytes()[:-4]) == row["crc"]


@pytest.mark.skipif(shutil.which("h5dump") is None, reason="HDF5's own h5dump is not installed")
def test_h5dump_reads_both_states(finished, tmp_path):
    for path in (finished[0].path, unfinished(tmp_path / "P02-push.h5")):
        told = subprocess.run(["h5dump", "-d", "/events", path], capture_output=True, text=True, check=True)
        assert "Press 1 of" in told.stdout


def set_row(name, column, value):
    """Change a row of one of the tables."""

    def change(file):
        row = file[name][1]
        row[column] = value
        file[name][1] = row

    return change


def set_to(name, value):
    """Change an attribute, or a text."""

    def change(file):
        if name in file.attrs:
            file.attrs[name] = value(file.attrs[name]) if callable(value) else value
        else:
            file[name][()] = value

    return change


def add_to_a_code(file):
    file["codes"][3, 1000] += 1


def turn_the_sensor(file):
    rig = json.loads(file["rig"].asstr()[()])
    rig["sensors"]["acceleration"]["zero"][2] *= 2
    del file["rig"]
    file["rig"] = json.dumps(rig)


CONTENT, HEADER = r"its content hash (is|does)", "header does not match its hash"


@pytest.mark.parametrize(("change", "says"), [
    (add_to_a_code, CONTENT),
    (set_row("events", "text", b"1"), CONTENT),
    (set_row("blocks", "overload", 1), CONTENT),
    (set_row("presses", "accepted", 0), CONTENT),
    (turn_the_sensor, HEADER),
    (set_to("full_scale", lambda scale: 2 * scale), HEADER),
    *((set_to(name, "another"), HEADER) for name in ("notes", "session", "protocol")),
    (set_to("rig", "{"), "was not written by haploop"),
    (set_to("format_version", 99), "update"),
])  # fmt: skip
def test_a_changed_recording_gives_nothing_and_is_not_verified(finished, tmp_path, change, says):
    """Neither as another program leaves it, nor under a checksum of the changed bytes."""
    copy = Path(shutil.copy(finished[0].path, tmp_path))
    with h5py.File(copy, "r+") as file:
        change(file)
    for use in (Recording.open, verify):
        raises(DataError, "its content does not match its checksum", use, copy)
    add_checksum(copy, "recording")
    for what in ("volts", "force", "saturated", "events", "verdicts", "content_hash", "duration"):
        with pytest.raises(DataError, match=says):
            getattr(Recording.open(copy), what)
    raises(DataError, says, verify, copy)


@pytest.mark.parametrize(("keep", "told"), [
    (0, "is truncated: it is empty"),
    (5, "is damaged, or not a file of haploop"),
    (600, "is an HDF5 file, but was not written by this version of haploop, or is damaged"),
    (3000, "is truncated: it has 3000 of {size} bytes"),
    (20_000, "is truncated: it has 20000 of {size} bytes"),
    (-1, "is truncated: it has {less} of {size} bytes"),
])  # fmt: skip
def test_a_file_that_was_cut_short_is_refused_in_one_plain_sentence(finished, tmp_path, keep, told):
    broken = tmp_path / "P09-push.h5"
    raw = finished[0].path.read_bytes()
    broken.write_bytes(raw[:keep])
    with pytest.raises(DataError) as caught:
        _ = Recording.open(broken).volts
    assert str(caught.value).startswith(f"{broken} {told.format(size=len(raw), less=len(raw) - 1)}")
    assert not re.search(r"eof|sblock|errno|\n", str(caught.value))


def test_other_files_are_refused(tmp_path):
    raises(DataError, "There is no file", Recording.open, tmp_path / "nothing.h5")
    other = tmp_path / "other.h5"
    with h5py.File(other, "w") as file:
        file["x"] = 1
    raises(DataError, "is an HDF5 file, but was not written by", Recording.open, other)
    raises(DataError, "", Recording.open, tmp_path)


@pytest.mark.parametrize("change", [
    {"full_scale": np.ones(2)},
    {"delays": np.zeros(2)},
    {"rate_hz": 0.0},
    {"rate_hz": np.nan},
    {"rig": "[]"},
])  # fmt: skip
def test_a_header_without_sense_is_refused_under_a_hash_that_fits(change, tmp_path):
    with h5py.File(tmp_path / "good.h5", "w") as file:
        write_header(file, replace(header(), rate_hz=0.5), "recording")
        assert read_header(file, tmp_path)[0].rate_hz == 0.5
    with h5py.File(tmp_path / "bad.h5", "w") as file:
        write_header(file, replace(header(), **change), "recording")
        raises(ValueError, r"rig|channels", read_header, file, tmp_path)


def test_a_recording_goes_to_another_process_as_its_file(finished):
    """Without a sample, so that hours of them go to a pool of processes."""
    read = Recording.open(finished[0].path)
    assert read.force.size > 1000
    sent = pickle.dumps(read)
    assert len(sent) < 20_000
    np.testing.assert_array_equal(pickle.loads(sent).force, read.force)


def test_a_signal_that_there_is_not_is_refused_with_those_that_there_are(finished):
    with pytest.raises(DataError, match=r"has no signal 'forec': ask for one of force, travel, "):
        Recording.open(finished[0].path).in_parts("forec")
