"""Files that are being recorded, were interrupted, truncated or damaged: their contents, and recovery."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from haploop.acquisition import Recording, content_hash, record, recover, verify
from haploop.acquisition.recording import AlongFile
from haploop.acquisition.recording.file_format import from_codes
from haploop.acquisition.recording.recovery import recover_damaged
from haploop.acquisition.recording.salvage import CHUNK, finish
from haploop.acquisition.recording.writer import Writer
from haploop.base.errors import ConfigurationError, DataError
from haploop.instruments import Block
from tests.acquisition.presses.pressworld import world_rig
from tests.acquisition.recording.pattern import (
    CHANNELS,
    FULL_SCALE,
    PRESS,
    block_of,
    codes_of,
    header,
    unfinished,
)
from tests.raising import raises


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


@pytest.mark.long
def test_a_report_of_it_says_what_it_is(tmp_path, run):
    path = unfinished(tmp_path / "P01-push.h5")
    assert content_hash(path) == Recording.open(path).content_hash
    result = run("report", path, "--out", tmp_path / "report.html", "--no-open")
    assert result.exit_code == 0, result.output
    assert "incomplete: the recording ended early" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_recovering_makes_it_whole_and_leaves_the_original_alone(tmp_path):
    path = unfinished(tmp_path / "P01-push.h5")
    before = path.read_bytes()
    whole = recover(path)
    assert path.read_bytes() == before
    assert whole.name == "P01-push.recovered.h5"
    assert verify(whole) == ()
    assert verify(path) == (f"{path} was interrupted: `haploop recover` salvages it into a finished file.",)
    recovered = Recording.open(whole)
    assert np.array_equal(recovered.volts, Recording.open(path).volts)
    assert recovered.content_hash != Recording.open(path).content_hash
    assert recovered.events[-1].text == (
        "Recovered 0.40 s with 1 of 1 presses accepted; samples after the last block are lost."
    )
    raises(ConfigurationError, "not overwritten", recover, path)
    raises(ConfigurationError, "nothing to recover", recover, whole)
    for folder in (tmp_path, ""):
        raises(DataError, "is a folder", recover, folder)


def test_recovering_names_the_files_of_streams_that_a_kill_left(tmp_path):
    path = tmp_path / "P01-push.h5"
    rig = json.dumps({"streams": {"inlets": {"eeg": {}, "cues": {}, "gone": {}}}})
    with Writer(path, replace(header(), rig=rig), 250, 20) as writer:
        writer.write(block_of(0), 0.05)
    for name in ("eeg", "eeg.2", "eeg.10", "cues", "other-eeg"):
        (tmp_path / f"P01-push-{name}.xdf").write_bytes(name.encode())
    recovered = Recording.open(recover(path))
    assert verify(recovered.path) == ()
    assert recovered.files == tuple(
        AlongFile(250, "streams", name, f"P01-push-{file}.xdf", hashlib.sha256(file.encode()).hexdigest())
        for name, file in (("eeg", "eeg.10"), ("cues", "cues"))
    )
    assert [event.kind for event in recovered.events] == ["file", "file", "recovered"]
    assert recovered.events[-1].text.endswith("are lost. No file is there of the stream gone.")


def cut(path: Path, folder: Path, keep: int) -> Path:
    broken = folder / f"P09-{keep}.h5"
    broken.write_bytes(path.read_bytes()[:keep])
    return broken


def saved_of(broken: Path) -> Path:
    """What `recover` does in a process of its own, in this one: to start one takes a second."""
    destination = broken.with_suffix(".recovered.h5")
    recover_damaged(broken, destination)
    return destination


@pytest.mark.long
def test_of_a_file_that_was_cut_short_everything_before_the_cut_is_saved(tmp_path):
    path = tmp_path / "P01-push.h5"
    volts = from_codes(
        np.random.default_rng(0).integers(-9000, 9000, (CHANNELS, 100_000)).astype(np.int16), FULL_SCALE
    )
    with Writer(path, header(), 250, 400) as writer:
        for first in range(0, 100_000, 250):
            writer.write(Block(first, volts[:, first : first + 250], np.zeros(CHANNELS, dtype=bool)), 0.0)
        writer.write_verdict(PRESS)
        writer.write_verdict(PRESS._replace(number=2, first=90_000, end=91_000))
    unfinished = path.read_bytes()
    finish(path)
    size = path.stat().st_size
    for keep in (size - 1, size // 2, size // 4):
        broken = cut(path, tmp_path, keep)
        before = broken.read_bytes()
        raises(DataError, "truncated", verify, broken)
        whole = Recording.open(saved_of(broken))
        samples = whole.volts.shape[1]
        assert 100_000 * keep / size - 1.2 * CHUNK < samples < 100_000
        assert np.array_equal(whole.volts, volts[:, :samples])
        assert verify(whole.path) == ()
        assert [press.number for press in whole.verdicts] == ([1, 2] if samples >= 91_000 else [1])
        assert "the rest of 20.00 s is damaged" in whole.events[-1].text
        assert broken.read_bytes() == before
    for keep in (2500, 100, 0):
        with pytest.raises(DataError, match=r"truncated|damaged"):
            saved_of(cut(path, tmp_path, keep))
    path.write_bytes(unfinished)
    whole = Recording.open(recover(cut(path, tmp_path, len(unfinished) // 2)))
    assert 47_000 < whole.volts.shape[1] < 50_000
    assert np.array_equal(whole.volts, volts[:, : whole.volts.shape[1]])


def test_nothing_is_ever_overwritten(tmp_path):
    path = unfinished(tmp_path / "P01-push.h5")
    before = path.read_bytes()
    raises(ConfigurationError, "not overwritten", Writer, path, header(), 250, 20)
    with pytest.raises(ConfigurationError, match=r"P01-push\.h5 already exists and is not overwritten"):
        record(world_rig(), "push", "P01", 1, tmp_path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
