"""What a recording derives from its samples, against the same sums in plain numpy."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from haploop.acquisition import Recording, content_hash
from haploop.acquisition.recording import recording as recording_module
from haploop.acquisition.recording.file_format import Header, from_codes
from haploop.acquisition.recording.salvage import finish, reopened
from haploop.acquisition.recording.writer import Writer
from haploop.base.errors import DataError
from haploop.instruments import AnalogChannel, Block
from tests.acquisition.recording.pattern import CHANNELS, PRESS, RIG, header, unfinished
from tests.rig_files import changed

COUNT, REST_END = 1000, 400
FULL = np.array([10.0] * 6 + [5.0] * 3 + [10.0] * (CHANNELS - 9))
SENSORS: Any = RIG.sensors


@pytest.fixture(scope="module")
def codes() -> np.ndarray:
    """Small enough for every sensor's range; the contact switches at sample 600."""
    rng = np.random.default_rng(4)
    found = rng.integers(-300, 300, (CHANNELS, COUNT)).astype(np.int16)
    found[6:9] += round(1.65 / 5 * 32768)
    found[9] = np.where(np.arange(COUNT) < 600, 0, round(5 / 10 * 32768))
    return found


def written(
    folder: Path, codes: np.ndarray, rest: float = 0.02, events: tuple[tuple[int, str], ...] = (), **more: Any
) -> Recording:
    head: Header = replace(
        header(), full_scale=FULL, rest=rest, delays=np.arange(CHANNELS) * 1e-5, about='{"age": 31}', **more
    )
    path = folder / "P01-push.h5"
    with Writer(path, head, 250, 8) as writer:
        for first in range(0, COUNT, 250):
            part = from_codes(codes[:, first : first + 250], FULL)
            writer.write(Block(first, part, np.zeros(CHANNELS, bool)), first / 5000)
        for sample, kind in events:
            writer.note(sample, kind, "text")
        writer.write_verdict(PRESS._replace(accepted=False, flags=("double",)))
        writer.write_verdict(PRESS._replace(attempt=2))
    finish(path)
    return Recording.open(path)


def test_every_quantity_is_the_sensors_own_of_the_volts(tmp_path, codes):
    found = written(tmp_path, codes, events=((REST_END, "rest"), (700, "pressed")))
    volts = codes * (FULL / 32768)[:, None]
    np.testing.assert_array_equal(found.volts, volts)
    rest = volts[:6, REST_END - 100 : REST_END].mean(axis=1, keepdims=True)  # 0.02 s before the event
    np.testing.assert_allclose(found.force, np.asarray(SENSORS.force.matrix)[2] @ (volts[:6] - rest))
    np.testing.assert_allclose(found.acceleration, (volts[6:9] - 1.65) * (9.80665 / 0.33))
    np.testing.assert_array_equal(found.activation, np.arange(COUNT) >= 600)
    assert not found.saturated.any() and found.duration == COUNT / 5000 and found.about == {"age": 31}
    assert found.complete and found.state == "finished" and not found.in_progress
    assert [press.attempt for press in found.verdicts] == [1, 2]
    assert [press.attempt for press in found.accepted] == [2]
    assert (found.button, found.participant, found.rig, found.rate_hz) == ("push", "P01", "simulated", 5000.0)
    assert found.simulated and found.channels == found.header.channels
    assert found.content_hash == content_hash(found.path)


def test_an_extra_channel_is_in_its_own_unit(tmp_path, codes):
    one = AnalogChannel(channel=header().channels[12], unit="mm", scale=0.5)
    found = written(tmp_path, codes, rig=changed(RIG, sensors={"extra": {"depth": one}}).model_dump_json())
    np.testing.assert_allclose(found.extra["depth"], codes[12] * (10.0 / 32768) / 2.0)
    assert list(found.extra) == ["depth"] and found.delay("depth") == pytest.approx(12e-5)


def test_what_was_forgotten_is_read_again(tmp_path, codes):
    found = written(tmp_path, codes)
    before, sha256 = found.volts, found.content_hash
    assert found.volts is before
    found.forget()
    assert "volts" not in vars(found) and "_checked" not in vars(found)
    assert vars(found)["content_hash"] == sha256 and found.path.name == "P01-push.h5"
    np.testing.assert_array_equal(found.volts, before)


@pytest.mark.parametrize("changed", ["participant", "button", "study", "session", "started"])
def test_a_recording_that_has_taken_a_file_s_place_is_another_one(changed, tmp_path, codes):
    found = written(tmp_path, codes)
    (tmp_path / "other").mkdir()
    other = written(tmp_path / "other", codes, **{changed: "2026-11-20T10:00:00+00:00"})
    with pytest.raises(DataError, match="is another recording now"), reopened(other.path, found.header, ()):
        pass
    with reopened(found.path, found.header, ()):
        pass


@pytest.mark.skipif(sys.platform == "win32", reason="Windows replaces no file that is open")
def test_a_recording_that_ends_meanwhile_is_finished(tmp_path, monkeypatch):
    path = unfinished(tmp_path / "P01-push.h5")

    def marked(_path: Path) -> bool:
        """Not any more: its program has ended between the header and this question."""
        finish(path)
        return False

    monkeypatch.setattr(recording_module, "is_marked", marked)
    assert Recording.open(path).state == "finished"


@pytest.mark.parametrize(("events", "rest", "taken"), [
    ((), 0.02, slice(0, 100)),  # it was stopped before
    (((50, "rest"),), 0.02, slice(0, 100)),  # less than that has passed
    (((400, "note"), (300, "rest"), (500, "rest")), 0.01, slice(250, 300)),
    (((300, "rest"),), 0.0, slice(299, 300)),
])  # fmt: skip
def test_the_force_is_relative_to_the_rest(events, rest, taken, tmp_path, codes):
    found = written(tmp_path, codes, rest, events)
    gauges = codes[:6] * (10.0 / 32768)
    expected = np.asarray(SENSORS.force.matrix)[2] @ (gauges - gauges[:, taken].mean(axis=1, keepdims=True))
    np.testing.assert_allclose(found.force, expected, atol=1e-12)


def test_delays_are_of_the_channels_that_make_a_quantity(tmp_path, codes):
    found = written(tmp_path, codes)
    weights = np.abs(np.asarray(SENSORS.force.matrix)[2])
    assert found.delay("force") == pytest.approx(weights @ (np.arange(6) * 1e-5) / weights.sum())
    assert found.delay("acceleration") == pytest.approx(8e-5)  # z
    assert found.delay("activation") == pytest.approx(9e-5)


@pytest.mark.parametrize(("row", "code", "said"), [
    (0, 32767, True), (0, -32768, True), (0, -32767, True), (0, 32766, False),
    (6, 32767, True), (9, 32767, False), (9, -32767, False),  # a contact: only its threshold counts
    (12, 32767, False),  # of no sensor
    (8, round((1.65 + 0.33 * 3.1) / 5 * 32768), True), (8, round((1.65 + 0.33 * 2.9) / 5 * 32768), False),
])  # fmt: skip
def test_a_sample_is_clipped(row, code, said, tmp_path, codes):
    changed = codes.copy()
    changed[row, 777] = code
    found = written(tmp_path, changed).saturated
    assert np.flatnonzero(found).tolist() == ([777] if said else [])


def test_what_a_rig_did_not_have_is_said(tmp_path, codes):
    found = written(tmp_path, codes, rig=changed(RIG, sensors={"activation": None}).model_dump_json())
    with pytest.raises(DataError, match="was recorded without a sensor for activation"):
        _ = found.activation
    (tmp_path / "P01-push.h5").unlink()
    odd = written(tmp_path, codes, rig='{"sensors": {"force": 3}}')
    with pytest.raises(DataError, match="describes its sensors in a way"):
        _ = odd.force
