from __future__ import annotations

import tomllib
from importlib import resources

import numpy as np
import pytest

from haploop.calibration.perception import LONG, SHORT, levels_of, parse_thresholds, running_level, thresholds
from haploop.calibration.perception.levels import OCTAVES, mean_levels, resting, sensitive
from haploop.instruments import DataError

RATE = 20000.0


def tone(hz: float, seconds: float = 0.6, rate: float = RATE, at: float = 0.0) -> np.ndarray:
    """A sine with the resting threshold's rms at `hz`, faded over 0.1 s, beginning `at` s in 0.9 s."""
    t = np.arange(round(seconds * rate)) / rate
    fade = np.clip(np.minimum(t, seconds - t) / 0.1, 0, 1)
    smooth = 0.5 - 0.5 * np.cos(np.pi * fade)
    rms = 1e-6 * 10 ** (float(resting(np.array([hz]))[0]) / 20)
    out = np.zeros(round(0.9 * rate))
    begin = round(at * rate)
    out[begin : begin + len(t)] = smooth * np.sqrt(2) * rms * np.sin(2 * np.pi * hz * t)
    return out


def burst(hz: float, seconds: float, at: float, times: float) -> np.ndarray:
    """A Hann burst with `times` the energy of `seconds` of a sine at threshold."""
    n = round(seconds * RATE)
    t = np.arange(n) / RATE
    shape = np.hanning(n) * np.sin(2 * np.pi * hz * t)
    rms = 1e-6 * 10 ** (float(resting(np.array([hz]))[0]) / 20)
    out = np.zeros(round(0.9 * RATE))
    begin = round(at * RATE)
    out[begin : begin + n] = shape * rms * np.sqrt(times * n / np.sum(shape**2))
    return out


@pytest.mark.parametrize("hz", [50, 70, 90, 130, 170, 260, 310, 390, 450, 550, 710, 830])
def test_a_sine_at_threshold_is_at_0_db(hz: float) -> None:
    assert levels_of(tone(hz), RATE, LONG).total == pytest.approx(0, abs=0.1)
    if hz % 50 == 0:
        assert levels_of(tone(hz), RATE, SHORT).total == pytest.approx(0, abs=0.1)


def test_the_level_is_the_energy_of_the_loudest_window() -> None:
    snap = burst(260, 0.016, 0.4, 100)
    long, short = levels_of(snap, RATE, LONG), levels_of(snap, RATE, SHORT)
    # A short burst is broad, and the threshold is not flat: some tenths of a dB.
    assert long.total == pytest.approx(20 + 10 * np.log10(0.016 / LONG), abs=0.5)
    assert short.total == pytest.approx(20 + 10 * np.log10(0.016 / SHORT), abs=0.5)
    assert short.start <= 0.402 and short.start + SHORT >= 0.414


def test_a_second_burst_outside_the_window_adds_nothing() -> None:
    one = burst(260, 0.03, 0.2, 50)
    both = one + burst(260, 0.03, 0.6, 40)
    assert levels_of(both, RATE, LONG).total == pytest.approx(levels_of(one, RATE, LONG).total, abs=0.01)


def test_twice_the_amplitude_is_6_db_everywhere() -> None:
    signal = burst(170, 0.05, 0.3, 7) + burst(420, 0.03, 0.33, 3)
    one, two = levels_of(signal, RATE, LONG), levels_of(2 * signal, RATE, LONG)
    six = 20 * np.log10(2)
    assert two.total - one.total == pytest.approx(six)
    assert two.sensitive - one.sensitive == pytest.approx(six)
    np.testing.assert_allclose((two.bands - one.bands)[~np.isnan(one.bands)], six)
    assert two.start == one.start and two.estimated == pytest.approx(one.estimated)


def test_the_level_depends_neither_on_the_rate_nor_on_where_the_signal_stands() -> None:
    reference = levels_of(tone(130), RATE, LONG).total
    assert levels_of(tone(130, rate=50000.0), 50000.0, LONG).total == pytest.approx(reference, abs=0.01)
    assert levels_of(tone(130, at=0.25), RATE, LONG).total == pytest.approx(reference, abs=0.01)
    # A window that reaches beyond the record counts what is there.
    assert np.isfinite(levels_of(tone(130)[: round(0.02 * RATE)], RATE, LONG).total)


def test_nothing_is_counted_outside_the_table() -> None:
    for hz in (3.0, 1500.0, 4000.0):
        t = np.arange(round(0.9 * RATE)) / RATE
        loud = 0.5 * np.sin(np.pi * t / 0.9) ** 2 * np.sin(2 * np.pi * hz * t)
        assert levels_of(loud, RATE, LONG).total < -60
    assert levels_of(np.zeros(1000), RATE, LONG).total == -np.inf


def test_a_band_is_stated_where_the_window_resolves_it() -> None:
    width = OCTAVES * (10**0.05 - 10**-0.05)
    for window in (LONG, SHORT):
        assert np.array_equal(~np.isnan(levels_of(tone(260), RATE, window).bands), width * window >= 1)
    bands = levels_of(tone(100), RATE, LONG).bands
    assert OCTAVES[np.nanargmax(bands)] == pytest.approx(100)
    assert np.nanmax(bands) == pytest.approx(float(resting(np.array([100.0]))[0]), abs=0.1)


def test_the_mean_level_is_that_of_the_whole_record() -> None:
    rng = np.random.default_rng(7793)
    noise = rng.normal(scale=0.3, size=round(4 * RATE))
    bands, total = mean_levels(noise, RATE)
    width = OCTAVES * (10**0.05 - 10**-0.05)
    density = 0.3**2 / (RATE / 2)
    np.testing.assert_allclose(bands, 10 * np.log10(density * width / 1e-12), atol=1.5)
    assert total == pytest.approx(levels_of(noise, RATE, 4.0).total, abs=0.01)


def test_the_running_level_is_centred() -> None:
    level = running_level(burst(260, 0.01, 0.4, 100), RATE, SHORT)
    loud = np.flatnonzero(level > level.max() - 3)
    assert loud.mean() / RATE == pytest.approx(0.405, abs=0.001)


def test_the_table_agrees_with_what_the_literature_says_of_it() -> None:
    """Flat in displacement at low frequencies, then -12 dB an octave (Gescheider and Verrillo)."""
    hz = np.array([60.0, 200.0])
    displacement = resting(hz) - 40 * np.log10(hz)
    assert np.diff(displacement)[0] / np.log2(200 / 60) == pytest.approx(-12, abs=1)
    low = np.array([18.0, 30.0])
    assert abs(np.diff(resting(low) - 40 * np.log10(low))[0]) < 2
    # 0.1 to 0.2 micrometres at 250 Hz.
    peak = np.sqrt(2) * 1e-6 * 10 ** (float(resting(np.array([250.0]))[0]) / 20) / (2 * np.pi * 250) ** 2
    assert 1e-7 < peak < 2e-7


def test_the_lowest_threshold_is_nowhere_above_the_resting_one() -> None:
    assert np.all(sensitive(OCTAVES) <= resting(OCTAVES))
    assert not np.isfinite(resting(np.array([5.0, 1200.0]))).any()


@pytest.mark.parametrize(
    "gone", ['source = "aosp"', 'source = "forta"', 'source = "people"', 'source = "hif"']
)
def test_a_row_without_a_source_is_refused(gone: str) -> None:
    text = resources.files("haploop.calibration.perception").joinpath("thresholds.toml").read_text("utf-8")
    parse_thresholds(text)
    with pytest.raises(DataError, match="names no source"):
        parse_thresholds(text.replace(gone, 'source = ""', 1))
    with pytest.raises(DataError, match="names no source"):
        parse_thresholds(text.replace(gone, 'source = "somebody"', 1))


def test_a_row_without_a_mark_is_refused() -> None:
    text = resources.files("haploop.calibration.perception").joinpath("thresholds.toml").read_text("utf-8")
    for mark in ("found", "recalled", "estimate"):
        with pytest.raises(DataError, match="has no mark"):
            parse_thresholds(text.replace(f'mark = "{mark}"', 'mark = "known"', 1))


def test_every_source_is_that_of_some_row() -> None:
    text = resources.files("haploop.calibration.perception").joinpath("thresholds.toml").read_text("utf-8")
    for source in tomllib.loads(text)["sources"]:
        assert f'source = "{source}"' in text


def test_estimates_are_said_to_be_estimates() -> None:
    assert thresholds().resting.found_to_hz == 400
    assert levels_of(tone(260), RATE, LONG).estimated < 0.01
    assert levels_of(tone(550), RATE, LONG).estimated > 0.99
