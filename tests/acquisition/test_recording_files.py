from __future__ import annotations

import errno
import json
import os
import re
import shutil
import subprocess
import sys
from collections import namedtuple
from pathlib import Path

import h5py
import numpy as np
import pytest
from pressworld import world_rig

from acquisition import Recording, find_presses, record, recover, verify
from acquisition.layout import Header, file_name, from_codes, to_codes
from acquisition.store import Writer
from instruments import Block, ConfigurationError, DataError, InstrumentError, load_rig_file

CHANNELS = 16


def header(channels: int = CHANNELS) -> Header:
    return Header(
        button="push",
        participant="P01",
        presses=1,
        rig_name="simulated",
        simulated=True,
        rate_hz=5000.0,
        channels=tuple(f"c{i}" for i in range(channels)),
        full_scale=np.full(channels, 10.0),
        delays=np.zeros(channels),
        rest=0.5,
        rig=load_rig_file("simulated").model_dump_json(),
        daq="none",
        software="test",
        started="2026-01-01T00:00:00+00:00",
    )


def codes_of(first: int, count: int, channels: int = CHANNELS) -> np.ndarray:
    """Any sample of any channel differs from its neighbours, and can be told from its index."""
    k = np.arange(first, first + count) * 7919 + np.arange(channels)[:, None] * 104729
    return (k % 65536 - 32768).astype(np.int16)


def block_of(first: int, count: int = 250) -> Block:
    full_scale = np.full(CHANNELS, 10.0)
    return Block(first, from_codes(codes_of(first, count), full_scale), np.zeros(CHANNELS, dtype=bool))


def unfinished(path: Path, blocks: int = 8) -> Path:
    with Writer(path, header(), 250, 20) as writer:
        for i in range(blocks):
            writer.write(block_of(250 * i), 0.05 * (i + 1))
        writer.note(500, "pressed", "Press 1 of 1 was seen.")
    return path


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


def test_volts_between_codes_are_off_by_half_a_code_at_most_and_beyond_the_range_are_flagged():
    volts = np.random.default_rng(0).uniform(-10, 9.9995, (1, 10_000))
    codes, beyond = to_codes(volts, np.array([10.0]))
    assert np.abs(from_codes(codes, np.array([10.0])) - volts).max() <= 0.5000001 * 10 / 32768
    assert not beyond.any()
    codes, beyond = to_codes(np.array([[10.2, -10.2]]), np.array([10.0]))
    assert codes.tolist() == [[32767, -32768]]
    assert beyond.all()


@pytest.mark.parametrize("name", ["", "../P01", "P 01", "Anna", "P01/x", "P01\\x", "01P", "P01\n", "P00001"])
def test_only_pseudonyms_are_participants(name):
    with pytest.raises(ConfigurationError, match="pseudonym"):
        file_name(name, "push")


@pytest.mark.parametrize("name", ["", "..", "../push", "a/b", "a\\b", "a b", "-x", "push\n", "x" * 41, "C:"])
def test_a_button_cannot_lead_out_of_the_folder(name):
    with pytest.raises(ConfigurationError, match="button's name"):
        file_name("P01", name)


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
        assert file.attrs["software"].startswith("haploop ")
        assert "T" in file.attrs["started"]


def test_a_changed_sample_does_not_pass_for_what_was_recorded(finished, tmp_path):
    copy = Path(shutil.copy(finished[0].path, tmp_path))
    with h5py.File(copy, "r+") as file:
        file["codes"][3, 1000] += 1
    with pytest.raises(DataError, match="was changed after it was finished"):
        _ = Recording.open(copy).force
    (problem,) = verify(copy)
    assert "content hash" in problem


def test_what_was_changed_afterwards_gives_no_arrays_and_no_hash(finished, tmp_path):
    copy = Path(shutil.copy(finished[0].path, tmp_path))
    assert np.array_equal(Recording.open(copy).force, finished[0].force)
    with h5py.File(copy, "r+") as file:
        file["codes"][0] = 2 * file["codes"][0]
    for what in ("volts", "force", "saturated", "events", "content_hash", "duration"):
        with pytest.raises(DataError, match=r"P01-push\.h5 .*its content does not match its hash: "):
            getattr(Recording.open(copy), what)


def test_a_changed_sensor_gives_no_force(finished, tmp_path):
    copy = Path(shutil.copy(finished[0].path, tmp_path))
    with h5py.File(copy, "r+") as file:
        rig = json.loads(file["rig"].asstr()[()])
        rig["sensors"]["acceleration"]["sensitivity"] *= 2
        file["rig"][()] = json.dumps(rig)
    with pytest.raises(DataError, match="does not match its hash"):
        _ = Recording.open(copy).acceleration
    with h5py.File(copy, "r+") as file:
        file["rig"][()] = "{"
    with pytest.raises(DataError, match="damaged"):
        Recording.open(copy)


def test_a_changed_scale_does_not_pass_either(finished, tmp_path):
    copy = Path(shutil.copy(finished[0].path, tmp_path))
    with h5py.File(copy, "r+") as file:
        file.attrs["full_scale"] = 2 * file.attrs["full_scale"]
    assert verify(copy)


@pytest.mark.parametrize(
    ("keep", "told"),
    [
        (0, "is cut short: it is empty"),
        (5, "is damaged, or not a recording"),
        (50, "is cut short: 50 of {size} bytes"),
        (20_000, "is cut short: 20000 of {size} bytes"),
        (-1, "is cut short: {less} of {size} bytes"),
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


def test_damage_inside_the_samples_is_found(finished, tmp_path):
    raw = bytearray(finished[0].path.read_bytes())
    with h5py.File(finished[0].path) as file:
        chunk = file["codes"].id.get_chunk_info(4)
    raw[chunk.byte_offset + 50] ^= 0xFF
    broken = tmp_path / "P09-push.h5"
    broken.write_bytes(raw)
    with pytest.raises(DataError, match="damaged"):
        _ = Recording.open(broken).volts


def test_other_files_are_refused(tmp_path):
    with pytest.raises(DataError, match="no recording"):
        Recording.open(tmp_path / "nothing.h5")
    other = tmp_path / "other.h5"
    with h5py.File(other, "w") as file:
        file["x"] = 1
    with pytest.raises(DataError, match="not a recording of haploop"):
        Recording.open(other)
    with pytest.raises(DataError):
        Recording.open(tmp_path)


def test_a_newer_format_is_refused(finished, tmp_path):
    copy = Path(shutil.copy(finished[0].path, tmp_path))
    with h5py.File(copy, "r+") as file:
        file.attrs["format_version"] = 99
    with pytest.raises(DataError, match="update"):
        Recording.open(copy)


# Unfinished files


def test_an_unfinished_file_is_an_ordinary_hdf5_file_while_it_grows(tmp_path):
    path = tmp_path / "P01-push.h5"
    with Writer(path, header(), 250, 20) as writer:
        for i in range(3):
            writer.write(block_of(250 * i), 0.0)
            with h5py.File(path, "r") as file:
                assert file["blocks"]["first"][i] == 250 * i
                assert np.array_equal(file["blocks"]["samples"][i], codes_of(250 * i, 250))
            recording = Recording.open(path)
            assert recording.volts.shape == (CHANNELS, 250 * (i + 1))
            assert not recording.complete


def test_a_short_last_block_and_a_block_written_twice_leave_no_wrong_row(tmp_path):
    path = tmp_path / "P01-push.h5"
    with Writer(path, header(), 250, 20) as writer:
        writer.write(block_of(0), 0.0)
        writer.write(block_of(0), 0.0)
        writer.write(block_of(250, 17), 0.0)
        with pytest.raises(InstrumentError, match="does not follow"):
            writer.write(block_of(1000), 0.0)
        assert writer.written == 267
    assert writer.committed == 267
    full_scale = np.full(CHANNELS, 10.0)
    assert np.array_equal(Recording.open(path).volts, from_codes(codes_of(0, 267), full_scale))


def test_recovering_makes_it_whole_and_leaves_the_original_alone(tmp_path):
    path = unfinished(tmp_path / "P01-push.h5")
    before = path.read_bytes()
    whole = recover(path)
    assert path.read_bytes() == before
    assert whole.name == "P01-push.recovered.h5"
    assert verify(whole) == ()
    assert verify(path) == (f"{path} was interrupted; recover it.",)
    recovered = Recording.open(whole)
    assert np.array_equal(recovered.volts, Recording.open(path).volts)
    assert recovered.content_hash == Recording.open(path).content_hash
    assert recovered.events[-1].text == "Recovered 0.40 s with 1 of 1 presses."
    with pytest.raises(ConfigurationError, match="never overwritten"):
        recover(path)
    with pytest.raises(ConfigurationError, match="nothing to recover"):
        recover(whole)


def test_a_torn_block_ends_the_recording_there(tmp_path):
    path = unfinished(tmp_path / "P01-push.h5")
    with h5py.File(path) as file:
        place = file["blocks"].id.get_offset() + 5 * file["blocks"].dtype.itemsize
    with path.open("r+b") as raw:
        raw.seek(place + 1000)
        raw.write(b"torn")
    assert Recording.open(path).volts.shape[1] == 5 * 250
    assert any("2 blocks behind a damaged one" in problem for problem in verify(path))
    assert "2 blocks behind a damaged one" in Recording.open(recover(path)).events[-1].text


def test_nothing_is_ever_overwritten(tmp_path):
    path = unfinished(tmp_path / "P01-push.h5")
    before = path.read_bytes()
    with pytest.raises(ConfigurationError, match="never overwritten"):
        Writer(path, header(), 250, 20)
    with pytest.raises(ConfigurationError, match=r"P01-push\.h5 exists and is never overwritten"):
        record(world_rig(), "push", "P01", 1, tmp_path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


# Disks


def test_a_disk_that_is_too_small_is_refused_before_the_first_sample(tmp_path, monkeypatch):
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda _path: usage(10**9, 10**9 - 5000, 5000))
    rig = world_rig()
    with pytest.raises(ConfigurationError, match="0 MB free, and this recording needs"):
        record(rig, "push", "P01", 10, tmp_path)
    assert rig.daq.given == []
    assert rig.operator.requests == []
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not hasattr(os, "posix_fallocate"), reason="a disk's refusal is simulated at this call")
def test_a_disk_that_refuses_the_room_leaves_nothing_behind(tmp_path, monkeypatch):
    def full(*_place):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(ConfigurationError, match="No space left"):
        record(world_rig(), "push", "P01", 1, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_room_is_taken_without_posix_too(tmp_path, monkeypatch):
    monkeypatch.delattr(os, "posix_fallocate", raising=False)
    monkeypatch.delattr(os, "pwrite", raising=False)
    monkeypatch.delattr(os, "fdatasync", raising=False)
    path = unfinished(tmp_path / "P01-push.h5")
    assert Recording.open(path).volts.shape == (CHANNELS, 8 * 250)


@pytest.mark.skipif(not hasattr(os, "pwrite"), reason="a disk's refusal is simulated at this call")
def test_a_disk_that_fails_while_recording_stops_it_and_what_was_written_stays(tmp_path, monkeypatch):
    real = os.pwrite
    calls = []

    def failing(*arguments):
        calls.append(1)
        if len(calls) > 30:
            raise OSError(errno.EIO, "Input/output error")
        return real(*arguments)

    monkeypatch.setattr(os, "pwrite", failing)
    rig = world_rig()
    with pytest.raises(InstrumentError, match=r"refused to write .*Input/output error"):
        record(rig, "push", "P01", 3, tmp_path)
    given = np.concatenate(rig.daq.given, axis=1)
    volts = Recording.open(tmp_path / "P01-push.h5").volts
    assert volts.shape[1] >= 25 * 250
    assert np.array_equal(to_codes(volts, rig.daq.streams[0].full_scale)[0], given[:, : volts.shape[1]])
    assert rig.daq.streams[0].closed


def test_a_folder_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigurationError, match="cannot be written"):
        record(world_rig(), "push", "P01", 1, tmp_path / "file" / "data")


# Kill -9

WRITE = """
import sys
sys.path.insert(0, {here!r})
from test_recording_files import Writer, header, block_of
from pathlib import Path
with Writer(Path({path!r}), header(), 250, 4000) as writer:
    for i in range(4000):
        writer.write(block_of(250 * i), 0.0)
        print(writer.written, flush=True)
"""


@pytest.mark.parametrize("lines", np.random.default_rng().integers(1, 2000, 3).tolist())
def test_kill_9_loses_nothing_that_was_reported_as_written(tmp_path, lines):
    path = tmp_path / "P01-push.h5"
    script = WRITE.format(here=str(Path(__file__).parent), path=str(path))
    process = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    for _ in range(lines):
        process.stdout.readline()
    process.kill()
    reported = [int(line) for line in process.stdout.read().splitlines(keepends=True) if line.endswith("\n")]
    process.wait(30)
    process.stdout.close()
    least = max([250 * lines, *reported])
    volts = Recording.open(path).volts
    assert volts.shape[1] >= least
    whole = Recording.open(recover(path))
    assert np.array_equal(whole.volts, from_codes(codes_of(0, volts.shape[1]), np.full(CHANNELS, 10.0)))


RECORD = """
import sys
sys.path.insert(0, {here!r})
from pressworld import world_rig
from acquisition import record
record(world_rig(seed=2), "push", "P01", 500, {out!r}, progress=lambda done, of: print(done, flush=True))
"""


def test_kill_9_in_the_middle_of_a_sitting_keeps_every_press_that_was_seen(tmp_path):
    script = RECORD.format(here=str(Path(__file__).parent), out=str(tmp_path))
    process = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    while process.stdout.readline() != "7\n":
        assert process.poll() is None
    process.kill()
    process.stdout.read()
    process.wait(30)
    process.stdout.close()
    recording = Recording.open(tmp_path / "P01-push.h5")
    assert not recording.complete
    assert sum(event.kind == "pressed" for event in recording.events) >= 7
    assert len(find_presses(recording)) >= 7
    assert verify(recover(recording.path)) == ()
