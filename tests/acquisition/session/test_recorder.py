import errno

import numpy as np
import pytest

from haploop.acquisition import Protocol, Recording, find_presses, record, recover, representative, verify
from haploop.acquisition.recording.file_format import to_codes
from haploop.acquisition.session.recorder import MOST_PRESSES
from haploop.base.errors import ConfigurationError, DataError, InstrumentError
from haploop.instruments import Press, Rest
from tests.acquisition.presses.pressworld import world_rig
from tests.raising import raises, raising

BLOCK = round(Protocol().block * 5000)
"""Samples."""


def assert_kept(rig, path, at_least: int) -> Recording:
    """The file holds exactly what the card gave, and no other row."""
    recording = Recording.open(path)
    codes, _ = to_codes(recording.volts, recording.header.full_scale)
    given = np.concatenate(rig.daq.given, axis=1)
    assert codes.shape[1] >= at_least
    assert np.array_equal(codes, given[:, : codes.shape[1]])
    assert not recording.complete
    assert rig.daq.streams[0].closed
    return recording


@pytest.mark.parametrize("button", ["latch", "doorbell"])
def test_every_press_is_asked_for_once_the_one_before_has_ended(tmp_path, button):
    rig = world_rig(seed=1)
    told = []
    found = record(rig, button, "P01", 4, tmp_path, progress=lambda _, done, of, __: told.append((done, of)))
    assert found.path == tmp_path / f"P01-{button}.h5"
    assert rig.operator.requests == [Rest(0.5), *(Press(button, "P01", n, 4) for n in (1, 2, 3, 4))]
    assert told == [(0, 4), (1, 4), (2, 4), (3, 4), (4, 4)]
    prompts = [e.sample / 5000 for e in found.events if e.kind == "prompt"]
    for press, prompt in zip(rig.daq.world.presses[:-1], prompts[1:], strict=True):
        assert 0.25 < prompt - press.end < 0.45
    assert found.duration - rig.daq.world.presses[-1].end > 0.5
    assert np.abs(found.force[:2000].mean()) < 0.01


def test_rest_is_measured_once_the_hands_are_off(tmp_path):
    rig = world_rig(seed=2)
    rig.daq.world.press("push", 0.1)  # somebody is still playing with it
    recording = record(rig, "push", "P01", 1, tmp_path)
    (rest,) = [e.sample for e in recording.events if e.kind == "rest"]
    assert rest / 5000 > rig.daq.world.presses[0].end
    assert abs(recording.force[rest - 1000 : rest].mean()) < 0.01
    assert len([e for e in recording.events if e.kind == "pressed"]) == 1
    assert len(find_presses(recording)) == 2


def test_no_press_within_15_seconds_is_an_error_and_the_file_stays(tmp_path):
    rig = world_rig(answers=False)
    raises(DataError, "No press 1 of 3 arrived within 15 s", record, rig, "push", "P01", 3, tmp_path)
    recording = assert_kept(rig, tmp_path / "P01-push.h5", 15 * 5000)
    assert recording.duration < 16.5
    assert recording.events[-1].kind == "error"


def test_a_finger_that_never_lets_go_is_an_error(tmp_path):
    rig = world_rig()
    drop = rig.daq.world.volts
    rig.daq.world.volts = lambda c, t: drop(c, t) + (0.3 * (t[-1] > 1) if c in ("gauge0", "gauge2") else 0)
    raises(DataError, r"Press 1 of 1 did not end within 15 s", record, rig, "push", "P01", 1, tmp_path)


@pytest.mark.parametrize("number", [1, 3])
def test_ctrl_c_leaves_a_readable_recording_of_all_that_was_read(tmp_path, number):
    rig = world_rig(seed=5)
    tell = rig.operator.tell

    def interrupted(request):
        tell(request)
        if isinstance(request, Press) and request.number == number:
            raise KeyboardInterrupt

    rig.operator.tell = interrupted
    raises(KeyboardInterrupt, "", record, rig, "push", "P01", 4, tmp_path)
    recording = assert_kept(rig, tmp_path / "P01-push.h5", len(rig.daq.given) * BLOCK)
    assert recording.events[-1].kind == "interrupted"
    assert len(find_presses(recording)) == number - 1
    assert recording.path.parent == tmp_path
    assert len(list(tmp_path.iterdir())) == 1
    # It keeps no room for what was never recorded, and nothing of it is left to recover.
    assert recording.path.stat().st_size < recording.volts.size * 2 + 50_000
    assert verify(recording.path) == ()
    raises(ConfigurationError, "nothing to recover", recover, recording.path)


def test_where_an_interrupted_file_cannot_be_finished_it_stays_recoverable(tmp_path, monkeypatch):
    refused = raising(OSError(errno.ENOSPC, "No space left on device"))
    monkeypatch.setattr("haploop.acquisition.recording.salvage.write_header", refused)
    rig = world_rig(answers=False)
    raises(DataError, "No press 1 of 3 arrived", record, rig, "push", "P01", 3, tmp_path)
    monkeypatch.undo()
    path = tmp_path / "P01-push.h5"
    recording = assert_kept(rig, path, 15 * 5000)
    assert list(tmp_path.iterdir()) == [path]
    assert np.array_equal(Recording.open(recover(path)).volts, recording.volts)


@pytest.mark.parametrize(("presses", "says"), [
    *((presses, "is not a number of presses: use a whole number") for presses in (-1, 3.0, "3", None)),
    (0, "at least 1"),
    (MOST_PRESSES + 1, "presses are too many for one recording"),
])  # fmt: skip
def test_presses_are_counted_in_whole_numbers(tmp_path, presses, says):
    raises(ConfigurationError, says, record, world_rig(), "push", "P01", presses, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_ctrl_c_while_a_block_is_being_written_loses_no_block(tmp_path, monkeypatch):
    from haploop.acquisition.recording.writer import Writer

    put = Writer._put
    calls = []

    def interrupted(self, data, place):
        put(self, data, place)
        calls.append(1)
        if len(calls) == 20:
            raise KeyboardInterrupt

    monkeypatch.setattr(Writer, "_put", interrupted)
    rig = world_rig()
    raises(KeyboardInterrupt, "", record, rig, "push", "P01", 4, tmp_path)
    recording = assert_kept(rig, tmp_path / "P01-push.h5", len(rig.daq.given) * BLOCK)
    assert recording.volts.shape[1] == len(rig.daq.given) * BLOCK


def test_a_gap_is_an_event_in_the_file_and_an_error(tmp_path):
    rig = world_rig()
    rig.daq.gap_at = 25
    with pytest.raises(InstrumentError, match=f"Samples {25 * BLOCK} to {26 * BLOCK - 1} were lost"):
        record(rig, "push", "P01", 4, tmp_path)
    recording = assert_kept(rig, tmp_path / "P01-push.h5", 25 * BLOCK)
    assert recording.volts.shape[1] == 25 * BLOCK
    assert (recording.events[-1].kind, recording.events[-1].sample) == ("gap", 25 * BLOCK)


def test_a_rig_without_a_sensor_is_refused(tmp_path):
    rig = world_rig(sensors={"force": None, "acceleration": None})
    raises(ConfigurationError, r"describe one of \[sensors\.force\]", record, rig, "push", "P01", 1, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_weight_on_the_sensor_is_not_taken_for_a_force_beyond_its_rating(tmp_path):
    recording = record(world_rig(seed=1, offset=119.0), "push", "P01", 1, tmp_path)
    assert recording.force.max() > 3
    assert not recording.saturated.any()


def test_a_recording_that_ended_before_its_first_block_is_empty_and_readable(tmp_path):
    rig = world_rig()
    rig.daq.fails_at = 0
    raises(InstrumentError, "", record, rig, "push", "P01", 1, tmp_path)
    recording = Recording.open(tmp_path / "P01-push.h5")
    assert recording.duration == 0 and find_presses(recording) == ()
    assert recording.force.shape == recording.saturated.shape == (0,)
    raises(DataError, "none was found", representative, [recording])
