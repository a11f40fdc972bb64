"""A recording read part by part, while it is written and afterwards, is what it is as a whole."""

import numpy as np
import pytest

from haploop.acquisition import Recording, record
from haploop.acquisition.recording import PartReader, salvage
from haploop.base.errors import DataError
from haploop.instruments import open_rig


def same(reader: PartReader, recording: Recording) -> None:
    count = reader.samples
    assert count > 0
    for first, end in ((0, 100), (150, 450), (count - 300, count), (count - 10, count + 500)):
        stop = min(end, count)
        assert np.allclose(
            reader.along("acceleration", first, end), recording.vertical[first:stop], atol=1e-12
        )
        assert np.allclose(reader.along("force", first, end), recording.force[first:stop], rtol=0, atol=1e-12)


def test_each_look_reads_what_was_added_and_parts_are_those_of_the_whole(tmp_path, monkeypatch):
    path, looks = tmp_path / "P01-push.h5", []
    readers: list[PartReader] = []
    read = []
    records_after = salvage.records_after

    def counted(file, block, sample):
        for one in records_after(file, block, sample):
            read.append(block)
            yield one

    monkeypatch.setattr("haploop.acquisition.recording.part_reader.records_after", counted)

    def look(_press):
        if not readers:
            readers.append(PartReader(path))
        reader = readers[0]
        reader.look()
        looks.append((reader.samples, len(reader.verdicts), reader.state))
        # The same file at the same moment: nothing is written while a verdict is told.
        whole = Recording.open(path)
        assert reader.samples == round(whole.duration * whole.rate_hz)
        assert reader.verdicts == whole.verdicts and list(reader.events) == whole.events
        same(reader, whole)

    with open_rig("simulated", simulate="twin") as rig:
        recording = record(rig, "push", "P01", 4, tmp_path, on_verdict=look)
    reader = readers[0]
    assert len(looks) == 4 and {state for *_, state in looks} == {"recording"}
    assert len(read) * 250 == looks[-1][0], "each block was read once"
    reader.look()
    assert (reader.state, len(reader.verdicts)) == ("finished", 4)
    same(reader, recording)
    recording.path.unlink()
    with open_rig("simulated", simulate="twin") as rig:
        again = record(rig, "push", "P01", 2, tmp_path)
    reader.look()
    assert len(reader.verdicts) == 2
    same(reader, again)


def test_a_finished_file_that_was_changed_is_refused(tmp_path):
    with open_rig("simulated", simulate="twin") as rig:
        path = record(rig, "push", "P01", 1, tmp_path).path
    reader = PartReader(path)
    reader.look()
    with path.open("r+b") as file:
        file.seek(-100, 2)
        file.write(b"changed")
    for do in (reader.look, lambda: reader.along("force", 0, 100)):
        with pytest.raises(DataError):
            do()
