from itertools import product

import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d

from haploop.acquisition import Recording, find_presses, record
from haploop.acquisition.presses import pressing
from haploop.acquisition.presses.filtering import running_mean, smoothed
from haploop.acquisition.presses.segmentation import Detector
from haploop.base import parts
from tests.acquisition.presses.pressworld import world_rig
from tests.rows import thinned

BUTTONS = ("latch", "toggle", "push")


def recorded(tmp_path, button, presses=6, **world):
    rig = world_rig(**world)
    return record(rig, button, "P01", presses, tmp_path), rig.daq.world.presses


@pytest.mark.parametrize("button", BUTTONS)
def test_every_press_is_found_where_it_was(tmp_path, button):
    recording, truth = recorded(tmp_path, button, drift=0.05 / 60)
    presses = find_presses(recording)
    assert len(presses) == len(truth)
    instants = np.array([p.activation for p in presses]) - [5000 * t.activation for t in truth]
    assert np.median(np.abs(instants)) <= 0.5
    assert np.abs(instants).max() <= 1.0
    forces = np.array([p.force_at_activation for p in presses])
    true = np.array([t.force(t.activation) for t in truth])
    assert np.abs(np.mean(forces / true) - 1) < 0.01
    assert np.abs(forces / true - 1).max() < 0.03
    for press, t in zip(presses, truth, strict=True):
        assert press.start <= press.onset < press.activation < press.peak < press.release <= press.stop
        assert t.start * 5000 - 5 <= press.onset <= t.activation * 5000
        assert abs(press.release - t.end * 5000) < 0.05 * 5000
        if button == "push":
            assert abs(press.opened - t.opening * 5000) <= 1.0
        else:
            assert press.opened is None
        if button == "latch":
            assert abs(press.first_stage - 5000 * (t.activation - 0.06 / t.speed)) < 6
        else:
            assert press.first_stage is None


@pytest.mark.parametrize(("button", "size"), thinned(product(BUTTONS, [7001, -1]), 3))
def test_a_long_recording_is_read_in_parts_as_at_once(tmp_path, button, size, monkeypatch):
    recording, _ = recorded(tmp_path, button)
    whole = pressing.shaken(recording.in_parts("vertical"), recording.rate_hz, 40.0)[:]
    found = find_presses(recording)
    monkeypatch.setattr(parts, "PART", size % len(recording))  # -1: the last part is one sample
    again = Recording.open(recording.path)
    assert find_presses(again) == found
    np.testing.assert_array_equal(smoothed(again.in_parts("force"), 25)[:], running_mean(again.force, 25))
    shaken = pressing.shaken(again.in_parts("vertical"), recording.rate_hz, 40.0)
    np.testing.assert_allclose(shaken, whole, rtol=1e-9, atol=1e-12)
    for signal in ("force", "acceleration", "activation", "saturated"):
        np.testing.assert_allclose(getattr(again, signal), getattr(recording, signal), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("samples", [0, 1, 2, 5, 30, 10_000])
@pytest.mark.parametrize("size", [1, 2, 3, 24, 25])
def test_a_running_mean_is_scipys(samples, size):
    signal = np.random.default_rng(samples).normal(1e6, 1.0, samples)
    np.testing.assert_allclose(running_mean(signal, size), uniform_filter1d(signal, size), rtol=0, atol=1e-8)


@pytest.mark.parametrize("trouble", [
    {"drift": 0.02, "offset": -20.0},
    {"drift": -0.02, "offset": 30.0},
    {"noise": 0.1},
    {"bounce": 0.0045},
])  # fmt: skip
def test_drift_offset_noise_and_bounce_neither_hide_nor_invent_a_press(tmp_path, trouble):
    recording, truth = recorded(tmp_path, "toggle", seed=7, **trouble)
    presses = find_presses(recording)
    assert len(presses) == len(truth) == 6, "each is asked for once"
    error = [p.activation - 5000 * t.activation for p, t in zip(presses, truth, strict=True)]
    assert np.abs(error).max() <= 1.0
    true = np.array([t.force(t.activation) for t in truth])
    assert np.mean([p.force_at_activation for p in presses] / true) == pytest.approx(1, abs=0.02)


def test_silence_holds_no_press():
    rng = np.random.default_rng(0)
    t = np.arange(100 * 5000) / 5000
    for drift in (0.0, 0.05 / 60, -0.05 / 60, 0.01):
        detector = Detector(5000.0)
        detector.feed(drift * t + 0.03 * rng.standard_normal(len(t)))
        detector.finish()
        assert detector.spans == []


def test_a_finger_that_lands_with_a_knock_makes_no_second_stage(tmp_path):
    rig = world_rig(seed=12)
    volts = rig.daq.world.volts

    def knocking(channel, t):
        # As strong as a first click, 20 ms after the finger has come.
        knocks = sum(
            5 * np.exp(-np.maximum(t - p.start - 0.02, 0) / 0.004) * (t > p.start + 0.02)
            for p in rig.daq.world.presses
        )
        return volts(channel, t) + (0.03 * knocks if channel.endswith("z") else 0)

    rig.daq.world.volts = knocking
    for press in find_presses(record(rig, "push", "P01", 3, tmp_path)):
        assert press.first_stage is None
