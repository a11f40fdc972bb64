"""Which part of a damaged or unfinished recording is kept, block by block and row by row."""

import hashlib
from pathlib import Path

import h5py
import numpy as np
import pytest

from haploop.acquisition import Recording, content_hash, recover, verify
from haploop.acquisition.recording import salvage
from haploop.acquisition.recording.file_format import from_codes, read_header
from haploop.acquisition.recording.rows import EVENT, VERDICT, block_dtype
from haploop.acquisition.recording.salvage import finish
from haploop.acquisition.recording.writer import Writer
from haploop.base.checksum import add_checksum
from haploop.base.errors import DataError
from haploop.base.json_files import as_line
from haploop.base.marks import marked
from tests.acquisition.recording.pattern import CHANNELS, FULL_SCALE, PRESS, block_of, codes_of, header
from tests.raising import raises

BLOCKS = 12


@pytest.fixture
def path(tmp_path: Path) -> Path:
    """Twelve blocks of 250 samples, the last of 100; an event and a verdict at the end of each."""
    found = tmp_path / "P01-push.h5"
    with Writer(found, header(), 250, 20) as writer:
        for number in range(BLOCKS):
            writer.write(block_of(250 * number, 250 if number < BLOCKS - 1 else 100), 0.05 * number)
            writer.note(writer.written, "note", f"After block {number}.")
            writer.write_verdict(PRESS._replace(number=number + 1, first=0, end=writer.written))
    return found


def places(path: Path) -> dict[str, int]:
    with h5py.File(path, "r", locking=False) as file:
        return {name: file[name].id.get_offset() for name in ("blocks", "events", "presses")}


def spoil(path: Path, place: int) -> None:
    """Change one byte."""
    raw = bytearray(path.read_bytes())
    raw[place] ^= 0xFF
    path.write_bytes(raw)


@pytest.mark.parametrize("number", [0, 1, 6, BLOCKS - 1])
def test_of_an_unfinished_recording_the_blocks_before_a_damaged_one_are_kept(number, path):
    spoil(path, places(path)["blocks"] + number * block_dtype(CHANNELS, 250).itemsize + 24)
    with h5py.File(path, "r", locking=False) as file:
        head, _ = read_header(file, path)
        contents = salvage.read_blocks(file, head)
        later, kept = BLOCKS - 1 - number, 250 * number
        assert salvage.later_rows(file) == ({"blocks": later} if later else {})
        np.testing.assert_array_equal(contents.codes, codes_of(0, kept))
    assert contents.blocks["first"].tolist() == list(range(0, kept, 250))
    assert contents.events["sample"].tolist() == [250 * (n + 1) for n in range(number)]
    assert contents.presses["end"].tolist() == [250 * (n + 1) for n in range(number)]
    if later:
        assert any(f"{later} blocks after damaged ones" in problem for problem in verify(path))
    if number:
        recovered = Recording.open(recover(path))
        np.testing.assert_array_equal(recovered.volts, from_codes(codes_of(0, kept), FULL_SCALE))
        told = recovered.events[-1]
        assert told.kind == "recovered" and told.sample == kept and verify(recovered.path) == ()
        told_later = f"{later} blocks after damaged ones; only blocks before a damaged one are kept."
        assert told.text.endswith(told_later if later else "samples after the last block are lost.")
        assert told.text.startswith(f"Recovered {kept / 5000:.2f} s with {number} of 1 presses accepted;")


@pytest.mark.parametrize(("name", "size"), [("events", EVENT.itemsize), ("presses", VERDICT.itemsize)])
def test_a_damaged_row_hides_no_other(name, size, path):
    spoil(path, places(path)[name] + 3 * size)
    with h5py.File(path, "r", locking=False) as file:
        head, _ = read_header(file, path)
        contents = salvage.read_blocks(file, head)
        assert salvage.later_rows(file) == {name: BLOCKS - 4}
    counts = {"events": len(contents.events), "presses": len(contents.presses)}
    assert counts == {"events": BLOCKS, "presses": BLOCKS} | {name: BLOCKS - 1}
    assert contents.codes.shape == (CHANNELS, 250 * 11 + 100)


@pytest.mark.parametrize("sample", [0, 249, 250, 1700, 2849])
def test_of_a_finished_recording_the_blocks_before_a_changed_sample_are_kept(sample, path):
    finish(path)
    with h5py.File(path, "r+", locking=False) as file:
        codes = file["codes"][:]
        codes[CHANNELS - 1, sample] ^= 1
        file["codes"][:] = codes
    with h5py.File(path, "r", locking=False) as file:
        head, state = read_header(file, path)
        contents, kept = salvage.intact_part(file, head), sample // 250 * 250
        np.testing.assert_array_equal(contents.codes, codes_of(0, kept))
    assert state == "finished"
    assert contents.blocks["count"].sum() == kept and len(contents.events) == len(contents.presses)
    assert contents.events["sample"].tolist() == list(range(250, kept + 1, 250))


def test_a_finished_recording_that_is_whole_is_kept_whole(path):
    finish(path)
    with h5py.File(path, "r", locking=False) as file:
        head, _ = read_header(file, path)
        contents = salvage.intact_part(file, head)
        np.testing.assert_array_equal(contents.codes, codes_of(0, 2850))
    assert len(contents.events) == len(contents.presses) == len(contents.blocks) == BLOCKS
    assert contents.blocks["count"].tolist() == [250] * 11 + [100]


@pytest.mark.parametrize("state", ["recording", "finished"])
def test_codes_between_two_samples(state, path):
    if state == "finished":
        finish(path)
    with h5py.File(path, "r", locking=False) as file:
        head, found = read_header(file, path)
        assert found == state
        for first, end in ((0, 1), (0, 250), (249, 251), (700, 1300), (2500, 2850)):
            np.testing.assert_array_equal(
                salvage.codes_between(file, head, first, end), codes_of(first, end - first)
            )


@pytest.mark.parametrize("change", ["shorter", "longer", "wider", "type", "chunks", "missing"])
def test_samples_that_do_not_fit_their_blocks_are_not_read(change, path):
    finish(path)
    with h5py.File(path, "r+", locking=False) as file:
        shape, dtype = [CHANNELS, 2850], "<i4" if change == "type" else "<i2"
        shape[1] += {"shorter": -1, "longer": 1}.get(change, 0)
        shape[0] += change == "wider"
        chunks = [shape[0], 100] if change == "chunks" else shape
        del file["codes"]
        codes = file.create_dataset(
            "codes", shape, "<i4" if change == "type" else dtype, chunks=tuple(chunks)
        )
        if change != "missing":
            codes[:] = 0
    add_checksum(path, "recording")
    raises(DataError, "was not written by haploop", salvage.read_contents, path)


def test_blocks_of_other_channels_are_not_read(path):
    with h5py.File(path, "r", locking=False) as file, pytest.raises(ValueError, match="blocks"):
        salvage.read_blocks(file, header(CHANNELS - 1))


def test_logs_recordings_in_progress_and_hashes(path, tmp_path):
    log = tmp_path / "session-1.jsonl"
    line = as_line({"number": 1, "previous": ""})
    log.write_text(line, encoding="utf-8")
    assert not verify(log) and content_hash(log) == hashlib.sha256(log.read_bytes()).hexdigest()
    log.write_text(line[:-5], encoding="utf-8")
    raises(DataError, "no line that was written completely", verify, log)
    with marked(path):
        assert verify(path) == (f"{path} is being recorded now: verify it when the session has ended.",)
    finish(path)
    assert content_hash(path) == Recording.open(path).content_hash
    with marked(path):  # by a program that exports it, say
        assert verify(path) == ()
