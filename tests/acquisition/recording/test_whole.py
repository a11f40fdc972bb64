"""Recordings of other programs are written whole, or not at all, and take nobody's place."""

from pathlib import Path

from haploop.acquisition.recording import write_recording, writer
from haploop.base.errors import ConfigurationError
from tests.acquisition.recording.pattern import block_of, header
from tests.raising import raises, raising


def test_a_file_that_appears_meanwhile_is_kept(tmp_path, monkeypatch):
    path = tmp_path / "P01-latch.h5"

    def quicker(_path: Path) -> None:
        path.write_text("another program's")

    monkeypatch.setattr(writer, "check_destination", quicker)
    raises(ConfigurationError, "exists", write_recording, path, header(), block_of(0).volts, [], lambda _: [])
    assert path.read_text() == "another program's"


def test_what_cannot_be_judged_leaves_no_file(tmp_path):
    path = tmp_path / "P01-latch.h5"
    judge = raising(RuntimeError("judged wrongly"))
    raises(RuntimeError, "", write_recording, path, header(), block_of(0).volts, [], judge)
    assert list(tmp_path.iterdir()) == []
