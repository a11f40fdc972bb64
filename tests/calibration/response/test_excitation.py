import numpy as np
import pytest

from haploop.base.errors import ConfigurationError
from haploop.calibration import LinearSweep, Multisine, linear_sweep, measure_response, plan_excitation
from haploop.instruments import Limits
from tests.raising import raises

RATE = 50e3


def test_a_sweep_may_be_played_and_rises_linearly():
    sweep = linear_sweep(50e3, 7.0, 625.0, 48.0)
    Limits(min=-48, max=48, max_offset=0.01, max_end=0.5, slew=0.5e6).check(sweep, 50e3)
    assert np.abs(sweep).max() == pytest.approx(48)
    for second in (1.0, 3.5, 6.0):
        piece = sweep[round((second - 0.1) * 50e3) : round((second + 0.1) * 50e3)]
        crossings = np.flatnonzero(np.diff(np.signbit(piece)))
        rate = (len(crossings) - 1) / 2 / ((crossings[-1] - crossings[0]) / 50e3)
        assert rate == pytest.approx(625 / 7 * second, rel=0.02)


@pytest.mark.parametrize(("duration", "stop"), [(0.1, 625), (7, 25e3), (7, 0)])
def test_a_sweep_that_cannot_be_sampled_is_refused(duration, stop):
    raises(ConfigurationError, "sweep", linear_sweep, 50e3, duration, stop, 1.0)


@pytest.mark.parametrize("multisine", [
    Multisine(),
    Multisine(lines="all", seed=3),
    Multisine(periods=2, settle=0.7),
    Multisine(lines=(1, 4), settle=0.8),
    Multisine(low=100, high=300, period=1.0),
])  # fmt: skip
def test_a_multisine_may_be_played_and_holds_its_lines_alone(multisine):
    drive = multisine.volts(RATE, 48.0)
    Limits(min=-48, max=48, max_offset=0.5, max_end=0.5, slew=0.5e6).check(drive, RATE)
    assert np.abs(drive).max() == pytest.approx(48)
    assert len(drive) / RATE == pytest.approx(multisine.duration, abs=1 / RATE)
    one = multisine.samples(RATE)
    amplitudes = np.abs(np.fft.rfft(drive[-one:])) * 2 / one
    own = multisine.excited()
    assert np.ptp(amplitudes[own]) < 1e-6 * amplitudes[own].mean()
    others = np.setdiff1d(np.arange(len(amplitudes)), own)
    assert amplitudes[others].max() < 1e-9 * amplitudes[own].mean()
    assert own[0] / multisine.period == pytest.approx(multisine.low, abs=12 / multisine.period)
    assert own[-1] / multisine.period == pytest.approx(multisine.high, abs=12 / multisine.period)
    for silent in multisine.silent():
        assert not np.isin(silent, own).any()


def test_optimised_phases_bring_the_rms_near_that_of_a_sine():
    odd = Multisine()
    wave = odd.volts(RATE, 1.0)
    assert np.abs(wave).max() / wave.std() < 1.7
    # With phases as they fall it is 3.4 at best.
    rng = np.random.default_rng(0)
    spectrum = np.zeros(8193, dtype=complex)
    spectrum[odd.excited()] = np.exp(2j * np.pi * rng.random(len(odd.excited())))
    wave = np.fft.irfft(spectrum)
    assert np.abs(wave).max() / wave.std() > 3.4
    again, other = Multisine(), Multisine(seed=1)
    assert np.array_equal(again.volts(RATE, 1.0), odd.volts(RATE, 1.0))
    assert abs(np.corrcoef(other.volts(RATE, 1.0), odd.volts(RATE, 1.0))[0, 1]) < 0.2


def test_odd_lines_leave_even_ones_to_distortion_and_one_in_four_as_well():
    odd = Multisine()
    even, left_out = odd.silent()
    assert np.all(odd.excited() % 2 == 1) and np.all(left_out % 2 == 1) and np.all(even % 2 == 0)
    assert len(left_out) == pytest.approx(len(odd.excited()) / 3, rel=0.02)


def test_patches_that_play_at_once_share_no_line_and_leave_out_the_same():
    each = [Multisine(lines=(k, 4), settle=0.8, seed=7) for k in range(4)]
    lines = np.concatenate([one.excited() for one in each])
    assert len(np.unique(lines)) == len(lines)
    for one in each:
        assert np.array_equal(one.silent()[1], each[0].silent()[1])
        assert not np.isin(one.silent()[1], lines).any()


@pytest.mark.parametrize(("wrong", "said"), [
    ({"low": 50, "high": 52}, "fewer than 20 lines"),
    ({"low": 300, "high": 200}, "fewer than 20 lines"),
    ({"periods": 3}, "settle"),
    ({"periods": 0}, "at least one period"),
    ({"lines": (4, 4)}, "every n"),
    ({}, "sample rate"),  # 2 kS/s are too few for it
])  # fmt: skip
def test_a_multisine_that_makes_no_sense_is_refused(wrong, said):
    with pytest.raises(ConfigurationError, match=said):
        Multisine(**wrong).volts(2000.0, 1.0)


def test_each_says_how_long_it_takes():
    assert Multisine().duration == 2.05 and "2.05 s of measuring" in str(Multisine())
    assert LinearSweep().duration == pytest.approx(6 * 8.2) and "49.2 s" in str(LinearSweep())
    assert Multisine(periods=4, settle=1).duration == pytest.approx(9.2)


def test_a_plan_takes_no_longer_than_it_must():
    easy, hard = plan_excitation(0.01, 45, peak=48), plan_excitation(0.001, 45, peak=48)
    assert easy.excitation.from_rest and easy.duration == 2.05 and easy.level < 48
    assert not hard.excitation.from_rest and hard.level == 48
    assert easy.expected_error <= 0.01 and hard.expected_error <= 0.001
    assert plan_excitation(0.01, 45, peak=48, decay=2.0).duration > easy.duration
    raises(ConfigurationError, "raise the level", plan_excitation, 0.0001, 20, peak=48)
    raises(ConfigurationError, "target error between", plan_excitation, 0.0, 20, peak=48)


@pytest.mark.long
@pytest.mark.parametrize("target", [0.006, 0.0025])
def test_a_plan_keeps_its_word(open, target):
    rig = open(hysteresis=0, vibrometer_noise_scale=10, seed=31)
    first = measure_response(rig, excitation=Multisine(seed=5))
    planned = plan_excitation(target, first.snr_db(rig.limits.peak), peak=rig.limits.peak)
    response = measure_response(rig, excitation=planned.excitation, level=planned.level)
    if rig.simulation is None:
        pytest.skip("only a simulation knows the truth")
    truth = rig.simulation.truth.velocity_response("A", "button", response.frequencies)
    kept = response.frequencies > 30
    error = np.linalg.norm((response.velocity - truth)[kept]) / np.linalg.norm(truth[kept])
    assert target / 4 < error < target
