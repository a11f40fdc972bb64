from __future__ import annotations

import dataclasses

import h5py
import numpy as np
import pytest
from pressworld import SHAPES, SyntheticPress, world_rig
from scipy.interpolate import CubicSpline

from acquisition import Recording, Representative, high_pass, record, representative
from acquisition.averaging import register
from instruments import ConfigurationError, DataError

RATE = 5000.0
TIMES = (np.arange(2000) - 600) / RATE
CLICKS = ((-0.05, 180, 6, 0.009), (0.0, 235, 10, 0.008), (0.004, 405, 4, 0.005), (0.18, 235, -5, 0.008))


def press(clicks, times=TIMES):
    total = np.zeros_like(times)
    for at, hz, peak, decay in clicks:
        since = np.maximum(times - at, 0)
        ring = peak * (1 - np.exp(-since / 3e-4)) * np.exp(-since / decay)
        total += ring * np.sin(2 * np.pi * hz * since)
    return total


TEMPLATE = press(CLICKS)


def smooth_warps(rng, count, stretch=0.05):
    """Tempo that changes smoothly (no spline of the method's own knots), zero at the activation."""
    knots = np.linspace(TIMES[0], TIMES[-1], 7)
    shifts = []
    for _ in range(count):
        tempo = CubicSpline(knots, rng.normal(0, stretch, 7))(TIMES)
        shift = np.cumsum(tempo) / RATE
        shifts.append(shift - np.interp(0, TIMES, shift))
    return np.array(shifts)


def noisy(curves, rng, noise=0.05):
    return (curves + noise * np.std(TEMPLATE) * rng.standard_normal(curves.shape))[:, None]


def error(curve, truth=TEMPLATE):
    return float(np.sqrt(np.mean((curve - truth) ** 2) / np.mean(truth**2)))


def shape_error(curve):
    """Error once a smooth warp between the two is taken away."""
    both = register(np.array([TEMPLATE, curve])[:, None], RATE)
    return error(both.aligned[1, 0], both.aligned[0, 0])


@pytest.mark.parametrize("seed", [0, 1, 100])
def test_smoothly_warped_presses_give_their_template_as_well_as_their_true_warps_would(seed):
    rng = np.random.default_rng(seed)
    shifts = smooth_warps(rng, 10)
    curves = noisy(np.array([press(CLICKS, TIMES + s) for s in shifts]), rng)
    result = register(curves, RATE).template[0]
    # What is known after taking the true warps away is the press at the mean of their times.
    limit = press(CLICKS, TIMES + shifts.mean(axis=0))
    assert shape_error(result) < 0.03
    assert shape_error(result) < 0.1 * shape_error(curves.mean(axis=0)[0])
    # The rest is the mean warp of ten presses, in which no method can see what is common to all.
    assert error(result, limit) < 0.12
    assert np.abs(result).max() == pytest.approx(np.abs(TEMPLATE).max(), rel=0.1)


def test_it_does_not_copy_noise_into_steps():
    rng = np.random.default_rng(3)
    curves = noisy(np.array([press(CLICKS, TIMES + s) for s in smooth_warps(rng, 10)]), rng)
    result = register(curves, RATE).template[0]
    high = np.abs(np.fft.rfft(result))[800:]  # above 2 kHz there is noise only
    assert np.sqrt(np.mean(high**2)) < 0.6 * np.sqrt(np.mean(np.abs(np.fft.rfft(curves[0, 0])[800:]) ** 2))


def test_equal_presses_are_left_alone():
    rng = np.random.default_rng(4)
    curves = noisy(np.array([TEMPLATE] * 8), rng, 0.02)
    assert error(register(curves, RATE).template[0]) < 0.015


def test_events_that_jitter_independently_keep_their_shape():
    rng = np.random.default_rng(5)
    curves = [
        press(
            [(at + rng.normal(0, 0.006), hz, peak, decay) for at, hz, peak, decay in CLICKS[:2] + CLICKS[3:]]
        )
        for _ in range(20)
    ]
    result = register(noisy(np.array(curves), rng, 0.01), RATE).template[0]
    assert np.abs(result).max() > 0.85 * np.abs(curves[0]).max()
    assert np.abs(np.mean(curves, axis=0)).max() < 0.6 * np.abs(curves[0]).max()


def test_one_outlier_in_ten_hardly_changes_it():
    rng = np.random.default_rng(6)
    curves = noisy(np.array([press(CLICKS, TIMES + s) for s in smooth_warps(rng, 10, 0.01)]), rng, 0.02)
    clean = register(curves[:9], RATE).template[0]
    curves[9, 0] = 3 * press(((0.02, 140, 10, 0.02), (-0.06, 300, 9, 0.01)))
    result = register(curves, RATE)
    assert result.weights[9] < 0.1
    assert error(result.template[0], clean) < 0.02
    assert result.weights[:9].min() > 0.9


def test_the_high_pass_keeps_the_click_and_its_time_and_takes_the_hand_away():
    slow = 9.81 + 2 * np.sin(2 * np.pi * 1.0 * TIMES) + 5 * TIMES
    filtered = high_pass(np.array([slow + TEMPLATE, slow]), RATE)
    assert error(filtered[0] - filtered[1]) < 0.1
    assert np.argmax(filtered[0]) == np.argmax(TEMPLATE)
    assert np.abs(filtered[1]).max() < 0.1 * np.ptp(slow)
    with pytest.raises(DataError):
        high_pass(np.zeros(1), RATE)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory) -> list[Recording]:
    out = tmp_path_factory.mktemp("presses")
    return [record(world_rig(seed=20 + p), "push", f"P0{p}", 6, out) for p in range(3)]


def test_the_representative_stands_for_all_presses_of_all_participants(recordings):
    result = representative(recordings)
    true = SyntheticPress(SHAPES["push"], 0.0, 1.0, 1.0)
    samples = np.arange(len(result.acceleration)) - result.activation_index
    truth = high_pass(true.acceleration(true.activation + samples / RATE), RATE)
    assert result.members == 18
    assert result.left_out == ()
    assert result.simulated is False
    assert result.sources == tuple((r.path.name, r.content_hash) for r in recordings)
    assert result.bandwidth_hz == 500
    assert result.acceleration[0] == result.acceleration[-1] == 0
    # Fingers differ in pace by a third, clicks do not: the first 50 ms behind the activation tell.
    near = slice(result.activation_index - 25, result.activation_index + 250)
    assert error(result.acceleration[near], truth[near]) < 0.12
    assert result.force[result.activation_index] == pytest.approx(true.force(true.activation), rel=0.1)
    assert np.argmax(result.activation > 0.5) == result.activation_index
    # The contact opens at very different lags; its click is kept all the same.
    opening = result.activation_index + int(np.argmax(result.activation[result.activation_index :] < 0.5))
    again = slice(opening, opening + 100)
    assert np.abs(result.acceleration[again]).max() > 0.8 * np.abs(truth).max() / 2
    assert result.activation[opening - 10] > 0.95
    assert result.activation[opening + 10] < 0.05
    assert result.spread[near].max() < 0.5 * np.abs(result.acceleration).max()


def test_saving_keeps_everything_and_overwrites_nothing(recordings, tmp_path):
    result = dataclasses.replace(representative(recordings[:1]), left_out=("P01, press 3: why",))
    result.save(tmp_path / "push.h5")
    back = Representative.load(tmp_path / "push.h5")
    for field in dataclasses.fields(result):
        mine, theirs = getattr(result, field.name), getattr(back, field.name)
        assert np.array_equal(mine, theirs), field.name
        assert type(mine) is type(theirs), field.name
    with pytest.raises(ConfigurationError, match="never overwritten"):
        result.save(tmp_path / "push.h5")
    with pytest.raises(DataError, match="not a representative"):
        Representative.load(recordings[0].path)
    with pytest.raises(DataError, match="not a recording"):
        Recording.open(tmp_path / "push.h5")
    with h5py.File(tmp_path / "cut.h5", "w") as file:
        file.attrs["format"] = "haploop representative"
    with pytest.raises(DataError, match="damaged"):
        Representative.load(tmp_path / "cut.h5")


def test_saturated_presses_are_left_out_and_said_so(tmp_path):
    rig = world_rig(seed=30)
    tell = rig.operator.tell

    def loud(request):
        tell(request)
        rig.daq.world.gain = 6.0 if getattr(request, "number", 0) == 2 else 1.0

    rig.operator.tell = loud
    result = representative([record(rig, "push", "P01", 4, tmp_path)])
    assert result.members == 3
    assert result.left_out == ("P01, press 2: a sensor was saturated",)

    rig = world_rig(seed=31)
    rig.daq.world.gain = 6.0
    with pytest.raises(DataError, match=r"No press of the push button can be used .*saturated"):
        representative([record(rig, "push", "P02", 2, tmp_path)])


def test_recordings_that_do_not_belong_together_are_refused(recordings, tmp_path):
    latch = record(world_rig(seed=40), "latch", "P01", 1, tmp_path)
    with pytest.raises(ConfigurationError, match="the button is push in one and latch in the other"):
        representative([recordings[0], latch])
    with pytest.raises(ConfigurationError, match="given twice"):
        representative([recordings[0], recordings[0]])
    with pytest.raises(ConfigurationError, match="at least one"):
        representative([])
    assert representative([latch]).members == 1
