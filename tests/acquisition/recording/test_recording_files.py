from __future__ import annotations

import hashlib
import json
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
from haploop.acquisition.checksum import add_checksum
from haploop.acquisition.recording.file_format import (
    from_codes,
    read_header,
    to_codes,
    write_header,
)
from haploop.acquisition.recording.salvage import finish
from haploop.acquisition.recording.writer import Writer
from haploop.instruments import DataError, load_rig_file
from tests.acquisition.presses.pressworld import world_rig
from tests.acquisition.recording.pattern import PRESS, block_of, header, unfinished


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> tuple[Recording, np.ndarray]:
    rig = world_rig(seed=4)
    recording = record(rig, "push", "P01", 2, tmp_path_factory.mktemp("finished"))
    return recording, np.concatenate(rig.daq.given, axis=1)


# Codes and names


@pytest.mark.parametrize("full_scale", [0.05, 0.2, 1.0, 5.0, 10.0])
def test_every_code_of_a_16_bit_converter_survives(full_scale):
    codes = np.arange(-32768, 32768).astype(np.int16)[None]
    volts = codes * (full_scale / 32768)
    back, beyond = to_codes(volts, np.array([full_scale]))
    assert np.array_equal(back, codes)
    assert not beyond.any()
    assert np.array_equal(from_codes(back, np.array([full_scale])), volts)


# Finished files


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
        assert (file.attrs["format"], file.attrs["format_version"]) == ("haploop recording", 4)
        assert file.attrs["software"].startswith("haploop ")
        assert "T" in file.attrs["started"]


def test_the_hash_is_the_one_that_the_format_describes(finished):
    """With h5py alone, by the words of docs/reference/format.md."""
    with h5py.File(finished[0].path) as file:
        a = file.attrs
        essential = {
            "about": file["about"].asstr()[()],
            "button": a["button"],
            "channels": list(a["channels"]),
            "delays": a["delays"].tolist(),
            "full_scale": a["full_scale"].tolist(),
            "notes": file["notes"].asstr()[()],
            "participant": a["participant"],
            "presses": int(a["presses"]),
            "protocol": file["protocol"].asstr()[()],
            "rate_hz": float(a["rate_hz"]),
            "rest": float(a["rest"]),
            "samples": file["codes"].shape[1],
            "sensors": json.loads(file["rig"].asstr()[()])["sensors"],
            "session": a["session"],
            "simulated": bool(a["simulated"]),
            "study": a["study"],
        }
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
        said = json.loads(raw[:512])
        assert said["haploop"] == "recording" and said["bytes"] == len(raw) - 512
        digest = hashlib.sha256(json.dumps([said["haploop"], said["bytes"], said["without"]]).encode())
        place = 512
        for first, count in (*said["without"], (len(raw), 0)):
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


def test_a_changed_sample_does_not_pass_for_what_was_recorded(finished, tmp_path):
    copy = Path(shutil.copy(finished[0].path, tmp_path))
    with h5py.File(copy, "r+") as file:
        file["codes"][3, 1000] += 1
    with pytest.raises(DataError, match="its content does not match its checksum"):
        Recording.open(copy)
    with pytest.raises(DataError, match="its content does not match its checksum"):
        verify(copy)
    add_checksum(copy, "recording")
    with pytest.raises(DataError, match="was changed after it was finished"):
        _ = Recording.open(copy).force
    with pytest.raises(DataError, match="its content hash does not match"):
        verify(copy)


def test_what_was_changed_afterwards_gives_no_arrays_and_no_hash(finished, tmp_path):
    copy = Path(shutil.copy(finished[0].path, tmp_path))
    assert np.array_equal(Recording.open(copy).force, finished[0].force)
    with h5py.File(copy, "r+") as file:
        file["codes"][0] = 2 * file["codes"][0]
    add_checksum(copy, "recording")
    for what in ("volts", "force", "saturated", "events", "content_hash", "duration"):
        with pytest.raises(DataError, match=r"P01-push\.h5 .*its content hash is .*, but the file states "):
            getattr(Recording.open(copy), what)


def test_a_changed_sensor_gives_no_force(finished, tmp_path):
    copy = Path(shutil.copy(finished[0].path, tmp_path))
    with h5py.File(copy, "r+") as file:
        rig = json.loads(file["rig"].asstr()[()])
        rig["sensors"]["acceleration"]["zero"][2] *= 2
        file["rig"][()] = json.dumps(rig)
    add_checksum(copy, "recording")
    with pytest.raises(DataError, match="its header does not match its hash"):
        Recording.open(copy)
    with h5py.File(copy, "r+") as file:
        file["rig"][()] = "{"
    add_checksum(copy, "recording")
    with pytest.raises(DataError, match="was not written by haploop"):
        Recording.open(copy)


@pytest.mark.parametrize("what", ["events", "notes", "session", "protocol", "blocks"])
def test_what_was_said_of_the_samples_cannot_be_changed_either(finished, tmp_path, what):
    copy = Path(shutil.copy(finished[0].path, tmp_path))
    with h5py.File(copy, "r+") as file:
        if what in file.attrs:
            file.attrs[what] = "another"
        elif file[what].shape:
            row = file[what][1]
            row["text" if what == "events" else "overload"] = 1
            file[what][1] = row
        else:
            file[what][()] = "another"
    with pytest.raises(DataError, match="its content does not match its checksum"):
        Recording.open(copy)
    add_checksum(copy, "recording")
    with pytest.raises(DataError, match=r"content hash is .*, but the file states|header does not match its"):
        _ = Recording.open(copy).events
    with pytest.raises(DataError, match="does not match"):
        verify(copy)


def test_an_edited_press_is_refused(tmp_path):
    path = tmp_path / "P01-push.h5"
    with Writer(path, header(), 250, 20) as writer:
        writer.write(block_of(0), 0.0)
        writer.write_verdict(PRESS._replace(accepted=False))
    finish(path)
    assert not Recording.open(path).verdicts[0].accepted
    with h5py.File(path, "r+") as file:
        row = file["presses"][0]
        row["accepted"] = 1
        file["presses"][0] = row
    add_checksum(path, "recording")
    with pytest.raises(DataError, match=r"its content hash is \w{64}, but the file states \w{64}\. "):
        _ = Recording.open(path).verdicts


def test_a_changed_scale_does_not_pass_either(finished, tmp_path):
    copy = Path(shutil.copy(finished[0].path, tmp_path))
    with h5py.File(copy, "r+") as file:
        file.attrs["full_scale"] = 2 * file.attrs["full_scale"]
    add_checksum(copy, "recording")
    with pytest.raises(DataError, match="its header does not match its hash"):
        verify(copy)


@pytest.mark.parametrize(
    ("keep", "told"),
    [
        (0, "is truncated: it is empty"),
        (5, "is damaged, or not a file of haploop"),
        (50, "is damaged, or not a file of haploop"),
        (600, "is truncated: it has 600 of {size} bytes"),
        (20_000, "is truncated: it has 20000 of {size} bytes"),
        (-1, "is truncated: it has {less} of {size} bytes"),
    ],
)
def test_a_file_that_was_cut_short_is_refused_in_one_plain_sentence(finished, tmp_path, keep, told):
    broken = tmp_path / "P09-push.h5"
    raw = finished[0].path.read_bytes()
    broken.write_bytes(raw[:keep])
    with pytest.raises(DataError) as caught:
        _ = Recording.open(broken).volts
    assert str(caught.value).startswith(f"{broken} {told.format(size=len(raw), less=len(raw) - 1)}")
    assert not re.search(r"eof|sblock|errno|\n", str(caught.value))


def test_other_files_are_refused(tmp_path):
    with pytest.raises(DataError, match="There is no file"):
        Recording.open(tmp_path / "nothing.h5")
    other = tmp_path / "other.h5"
    with h5py.File(other, "w") as file:
        file["x"] = 1
    with pytest.raises(DataError, match="is an HDF5 file, but was not written by"):
        Recording.open(other)
    with pytest.raises(DataError):
        Recording.open(tmp_path)


@pytest.mark.parametrize(
    "change",
    [
        {"full_scale": np.ones(2)},
        {"delays": np.zeros(2)},
        {"rate_hz": 0.0},
        {"rate_hz": np.nan},
        {"rig": "[]"},
    ],
)
def test_a_header_without_sense_is_refused_under_a_hash_that_fits(change, tmp_path):
    with h5py.File(tmp_path / "good.h5", "w") as file:
        write_header(file, replace(header(), rate_hz=0.5), "recording")
        assert read_header(file, tmp_path)[0].rate_hz == 0.5
    with h5py.File(tmp_path / "bad.h5", "w") as file:
        write_header(file, replace(header(), **change), "recording")
        with pytest.raises(ValueError, match=r"rig|channels"):
            read_header(file, tmp_path)


def test_a_newer_format_is_refused(finished, tmp_path):
    copy = Path(shutil.copy(finished[0].path, tmp_path))
    with h5py.File(copy, "r+") as file:
        file.attrs["format_version"] = 99
    add_checksum(copy, "recording")
    with pytest.raises(DataError, match="update"):
        Recording.open(copy)
