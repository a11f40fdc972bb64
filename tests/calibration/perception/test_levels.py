import tomllib
from importlib import resources
from itertools import product

import numpy as np
import pytest

from haploop.base.errors import DataError
from haploop.calibration import perception
from haploop.calibration.perception import levels_of, thresholds
from haploop.calibration.perception.levels import OCTAVES, mean_levels, pressing, resting
from tests.raising import raises
from tests.rows import thinned

RATE = 20000.0
TABLE = resources.files("haploop.calibration.perception").joinpath("thresholds.toml").read_text("utf-8")


def tone(hz: float, seconds: float = 1.4, rate: float = RATE, at: float = 0.0) -> np.ndarray:
    """A sine with the pressing threshold's rms at `hz`, faded over 0.1 s, beginning `at` s in 2 s."""
    t = np.arange(round(seconds * rate)) / rate
    fade = np.clip(np.minimum(t, seconds - t) / 0.1, 0, 1)
    smooth = 0.5 - 0.5 * np.cos(np.pi * fade)
    rms = 1e-6 * 10 ** (float(pressing(np.array([hz]))[0]) / 20)
    out = np.zeros(round(2 * rate))
    begin = round(at * rate)
    out[begin : begin + len(t)] = smooth * np.sqrt(2) * rms * np.sin(2 * np.pi * hz * t)
    return out


def burst(hz: float, seconds: float, at: float, times: float) -> np.ndarray:
    """A Hann burst with `times` the energy of `seconds` of a sine at the pressing threshold, in 2 s."""
    n = round(seconds * RATE)
    t = np.arange(n) / RATE
    shape = np.hanning(n) * np.sin(2 * np.pi * hz * t)
    rms = 1e-6 * 10 ** (float(pressing(np.array([hz]))[0]) / 20)
    out = np.zeros(round(2 * RATE))
    begin = round(at * RATE)
    out[begin : begin + n] = shape * rms * np.sqrt(times * n / np.sum(shape**2))
    return out


@pytest.mark.parametrize("hz", [50, 70, 90, 130, 170, 260, 310, 390, 450, 550, 710, 830])
def test_a_second_of_a_sine_at_threshold_is_at_0_db(hz):
    assert levels_of(tone(hz), RATE).pressing == pytest.approx(0, abs=0.1)
    lower = resting(np.array([hz])) - pressing(np.array([hz]))
    assert levels_of(tone(hz), RATE).resting == pytest.approx(-float(lower[0]), abs=0.1)


def test_the_window_is_as_long_as_the_bursts_of_the_thresholds():
    assert thresholds().burst == 1.0
    snap = burst(260, 0.016, 0.4, 100)
    # A short burst is broad, and the threshold is not flat: some tenths of a dB.
    assert levels_of(snap, RATE).pressing == pytest.approx(20 + 10 * np.log10(0.016 / 1.0), abs=0.5)


def test_a_second_burst_adds_its_energy_within_the_window_only():
    one = burst(260, 0.03, 0.2, 50)
    near, far = one + burst(260, 0.03, 0.6, 50), one + burst(260, 0.03, 1.5, 40)
    assert levels_of(near, RATE).pressing - levels_of(one, RATE).pressing == pytest.approx(3.01, abs=0.01)
    assert levels_of(far, RATE).pressing == pytest.approx(levels_of(one, RATE).pressing, abs=0.01)


def test_twice_the_amplitude_is_6_db_everywhere():
    signal = burst(170, 0.05, 0.3, 7) + burst(420, 0.03, 0.33, 3)
    one, two = levels_of(signal, RATE), levels_of(2 * signal, RATE)
    six = 20 * np.log10(2)
    assert two.pressing - one.pressing == pytest.approx(six)
    assert two.resting - one.resting == pytest.approx(six)
    np.testing.assert_allclose(two.bands - one.bands, six)
    assert two.estimated == pytest.approx(one.estimated)


def test_the_level_depends_neither_on_the_rate_nor_on_where_the_signal_stands():
    reference = levels_of(tone(130), RATE).pressing
    assert levels_of(tone(130, rate=50000.0), 50000.0).pressing == pytest.approx(reference, abs=0.01)
    assert levels_of(tone(130, at=0.25), RATE).pressing == pytest.approx(reference, abs=0.01)
    # A window that reaches beyond the record counts what is there.
    assert np.isfinite(levels_of(tone(130)[: round(0.02 * RATE)], RATE).pressing)


def test_nothing_is_counted_outside_the_table():
    for hz in (3.0, 1500.0, 4000.0):
        t = np.arange(round(0.9 * RATE)) / RATE
        loud = 0.5 * np.sin(np.pi * t / 0.9) ** 2 * np.sin(2 * np.pi * hz * t)
        assert levels_of(loud, RATE).pressing < -50
    assert levels_of(np.zeros(1000), RATE).pressing == -np.inf


def test_the_bands_show_the_tone():
    bands = levels_of(tone(100), RATE).bands
    assert OCTAVES[np.argmax(bands)] == pytest.approx(100)
    assert np.max(bands) == pytest.approx(float(pressing(np.array([100.0]))[0]), abs=0.1)


def test_the_mean_level_is_that_of_the_whole_record():
    rng = np.random.default_rng(7793)
    noise = rng.normal(scale=0.3, size=round(4 * RATE))
    bands, total = mean_levels(noise, RATE)
    width = OCTAVES * (10**0.05 - 10**-0.05)
    density = 0.3**2 / (RATE / 2)
    np.testing.assert_allclose(bands, 10 * np.log10(density * width / 1e-12), atol=1.5)
    assert total == pytest.approx(levels_of(noise, RATE).pressing, abs=0.7)


def test_the_running_level_is_centred():
    level = perception.running_level(burst(260, 0.01, 0.4, 100), RATE, perception.SHORT)
    loud = np.flatnonzero(level > level.max() - 3)
    assert loud.mean() / RATE == pytest.approx(0.405, abs=0.001)


def test_the_table_agrees_with_what_the_literature_says_of_it():
    """Flat in displacement at low frequencies, then -12 dB an octave (Gescheider and Verrillo)."""
    hz = np.array([60.0, 200.0])
    displacement = resting(hz) - 40 * np.log10(hz)
    assert np.diff(displacement)[0] / np.log2(200 / 60) == pytest.approx(-12, abs=1)
    low = np.array([18.0, 30.0])
    assert abs(np.diff(resting(low) - 40 * np.log10(low))[0]) < 2
    # 0.1 to 0.2 micrometres at 250 Hz.
    peak = np.sqrt(2) * 1e-6 * 10 ** (float(resting(np.array([250.0]))[0]) / 20) / (2 * np.pi * 250) ** 2
    assert 1e-7 < peak < 2e-7


def test_a_finger_that_presses_is_more_sensitive_than_one_at_rest_where_it_was_found_so():
    fast = OCTAVES[OCTAVES > 100]
    assert np.all(pressing(fast) < resting(fast) - 6)
    assert not np.isfinite(resting(np.array([5.0, 1200.0]))).any()


@pytest.mark.parametrize(("was", "other", "says"), [
    *((f'source = "{source}"', f'source = "{other}"', "names no source")
      for source in ("aosp", "forta", "assumed", "hif", "bursts") for other in ("", "somebody")),
    *((f'mark = "{mark}"', 'mark = "known"', "has no mark") for mark in ("found", "estimate")),
])  # fmt: skip
def test_a_row_without_a_source_or_a_mark_is_refused(was, other, says):
    perception.parse_thresholds(TABLE)
    raises(DataError, says, perception.parse_thresholds, TABLE.replace(was, other, 1))


def test_every_source_is_that_of_some_row_and_none_was_recalled():
    assert '"recalled"' not in TABLE
    for source in tomllib.loads(TABLE)["sources"]:
        assert f'source = "{source}"' in TABLE


def test_estimates_are_said_to_be_estimates():
    assert thresholds().act("pressing").curve.found_to_hz == 315
    assert levels_of(tone(260), RATE).estimated < 0.01
    assert levels_of(tone(550), RATE).estimated > 0.99
    assert {act.name: act.mark for act in thresholds().acts} == dict.fromkeys(
        ("pressing", "resting", "sliding"), "estimate"
    )


def test_the_most_sensitive_people_found_lie_within_what_pressing_may_be():
    """0.01 micrometres between 150 and 200 Hz (Brisben et al.), 9 dB below the curve."""
    rms = 0.01e-6 * (2 * np.pi * 175) ** 2 / np.sqrt(2)
    act = thresholds().act("pressing")
    below = float(act.level(np.array([175.0]))[0]) - 20 * np.log10(rms / 1e-6)
    assert below == pytest.approx(9, abs=0.5) and below < act.lower


@pytest.mark.parametrize(("level", "noise"), thinned(product([-25.0, -15.0, 0.0, 20.0], [0.0, 0.01, 0.1]), 4))
def test_the_noise_of_plays_is_not_felt(level, noise):
    """Of a motion 25 dB below threshold a laser's noise made one of 9 to 21 below."""
    rng = np.random.default_rng(5)
    moved, held = tone(260) * 10 ** (level / 20), 0
    for _ in range(10):
        plays = moved + noise * rng.standard_normal((8, len(moved)))
        found = levels_of(plays, RATE)
        low, high = found.interval
        held += low <= level + 0.05 and high >= level - 0.05
        events = perception.event_levels(plays, RATE, 0.2, 0.03, 17)
        quiet = perception.event_levels(plays - moved, RATE, 0.2, 0.03, 17)
        heard = perception.event_levels((plays - moved).mean(axis=0), RATE, 0.2, 0.03, 17)
        assert events.shape == quiet.shape == (17,)
        if noise:
            # Four in five windows without motion have none, the others a tenth of the mean's noise.
            assert np.mean(10 ** (quiet / 10)) < 0.2 * np.mean(10 ** (heard / 10))
    assert held >= 9
    if noise == 0.1 and level == -25.0:
        assert levels_of(plays.mean(axis=0), RATE).pressing > -22 and not np.isfinite(low)


def test_a_level_of_a_finer_signal_is_the_same():
    for hz in (90, 260, 830):
        fine = levels_of(tone(hz, rate=50e3)[: round(2 * 50e3)], 50e3)
        assert fine.pressing == pytest.approx(0, abs=0.1)
