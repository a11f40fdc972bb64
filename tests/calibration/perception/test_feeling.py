from __future__ import annotations

import numpy as np
import pytest

from haploop.calibration.perception import Feeling, feeling_of, levels_of, thresholds

RATE = 20000.0


def snap(level: float, at: float = 0.4, hz: float = 264.0) -> np.ndarray:
    """A burst whose loudest 100 ms lie `level` dB above the threshold of a finger at rest."""
    t = np.arange(round(0.9 * RATE)) / RATE
    shape = np.exp(-(((t - at) / 0.012) ** 2)) * np.sin(2 * np.pi * hz * t)
    return np.asarray(shape * 10 ** ((level - levels_of(shape, RATE, 0.1).total) / 20))


def felt(target: np.ndarray, measured: np.ndarray, recorded: np.ndarray | None = None) -> Feeling:
    return feeling_of(target, measured, RATE, recorded)


def said(feeling: Feeling) -> str:
    return " ".join(feeling.notes)


def test_a_loud_motion_is_felt_and_a_small_one_is_not() -> None:
    # At 264 Hz the lowest curve lies 17 dB below that of a finger at rest, and what is recalled of
    # fingers that press 22 dB lower still.
    for level, answer, words in (
        (3, "yes", "3.0 dB above the threshold of detection of a finger at rest: the motion can be felt."),
        (-10, "perhaps", "it can perhaps be felt by a finger that presses."),
        (-25, "perhaps", "only what is recalled of fingers that press hard lies lower"),
        (-60, "no", "nothing can be felt."),
    ):
        feeling = felt(snap(level), snap(level))
        assert feeling.felt == answer
        assert feeling.measured[0].total == pytest.approx(level, abs=1e-6)
        assert words in said(feeling)


def test_the_spread_between_people_is_said_near_a_threshold_only() -> None:
    assert "People differ by about 6 dB (one standard deviation, recalled)" in said(felt(snap(3), snap(3)))
    assert "People differ" not in said(felt(snap(30), snap(30)))


def test_a_motion_outside_the_table_is_not_called_felt() -> None:
    fast = snap(0, hz=300.0) * 0 + 50 * np.sin(2 * np.pi * 3000 * np.arange(round(0.9 * RATE)) / RATE) * (
        np.hanning(round(0.9 * RATE))
    )
    assert felt(fast, fast).felt == "no"
    nothing = np.zeros(len(fast))
    assert said(felt(nothing, nothing)).startswith("The measured motion has no part between")


def test_an_error_is_judged_by_the_just_noticeable_difference_where_it_was_measured() -> None:
    target = snap(20)
    small, large = felt(target, 1.1 * target), felt(target, 1.4 * target)
    assert small.comparable and small.difference == "no" and "within the least just noticeable" in said(small)
    assert large.comparable and large.difference == "yes" and "it is felt." in said(large)
    assert small.ratio == pytest.approx(0.1) and large.ratio == pytest.approx(0.4)


@pytest.mark.parametrize("level", [9.9, 4, -8])
def test_near_threshold_nothing_is_claimed_by_the_just_noticeable_difference(level: float) -> None:
    target = snap(level)
    feeling = felt(target, 1.4 * target)
    assert not feeling.comparable and feeling.difference == "perhaps"
    assert "measured 10 dB above it: nothing is claimed" in said(feeling)
    # Nor is a small difference called unnoticeable by a figure that does not hold there.
    small = felt(target, 1.1 * target)
    assert small.difference == "perhaps" and "within the least" not in said(small)


def test_a_difference_below_the_whole_table_is_not_felt_however_large_it_is() -> None:
    target = snap(-62)
    feeling = felt(target, 2 * target)
    assert feeling.difference == "no" and "below everything in the table: it is not felt" in said(feeling)


def test_a_motion_where_there_should_be_none_is_felt_by_itself() -> None:
    feeling = felt(snap(-60), snap(8))
    assert feeling.difference == "yes" and "it is felt by itself" in said(feeling)


def test_the_parts_of_the_press_that_are_lost_are_named() -> None:
    first, second = snap(15, at=0.3), snap(9, at=0.6)
    feeling = felt(first, first, recorded=first + second)
    ((begin, end),) = feeling.lost
    assert 0.55 < begin < 0.6 < end < 0.65
    assert len(feeling.spans) == 1 and len(feeling.recorded_spans) == 2
    assert f"{1e3 * begin:.0f} to {1e3 * end:.0f} ms" in said(feeling)
    whole = felt(first, first, recorded=0.9 * first)
    assert not whole.lost and "the measured motion for all of it" in said(whole)
    quiet = felt(snap(-20), snap(-20), recorded=first)
    assert quiet.lost == quiet.recorded_spans and "and the measured motion never" in said(quiet)


def test_loudness_is_relative_to_the_recorded_press_and_independent_of_both_sizes() -> None:
    press = snap(18) + snap(12, at=0.5, hz=60)
    for size in (0.01, 1.0, 30.0):
        feeling = felt(0.1 * size * press, 0.1 * size * press, recorded=size * press)
        assert feeling.loudness_db == pytest.approx(-20)
        assert "20.0 dB quieter than the recorded press" in said(feeling)
    assert "louder" in said(felt(press, 2 * press, recorded=press))
    assert np.isnan(felt(press, press).loudness_db)


def test_the_noise_of_the_plays_is_stated_and_named() -> None:
    rng = np.random.default_rng(61151)
    target = snap(5)
    plays = target + rng.normal(scale=0.5, size=(8, len(target)))
    feeling = feeling_of(target, plays.mean(axis=0), RATE, plays=plays)
    truth = [
        levels_of(noise, RATE, len(target) / RATE).total
        for noise in rng.normal(scale=0.5, size=(4, len(target)))
    ]
    assert feeling.noise_total == pytest.approx(np.mean(truth) - 10 * np.log10(8), abs=0.7)
    assert feeling.noise is not None and feeling.noise.shape == feeling.octaves_hz.shape
    assert "no larger than the noise of the plays" in said(feeling)
    assert "noise" not in said(
        feeling_of(target, 1.4 * target, RATE, plays=np.array([target, 1.001 * target]))
    )


def test_an_estimated_threshold_is_named_where_the_level_depends_on_it() -> None:
    assert "where the threshold is an estimate" in said(felt(snap(5, hz=550), snap(5, hz=550)))
    assert "estimate" not in said(felt(snap(5), snap(5)))


def test_the_figures_in_the_sentences_are_those_of_the_table() -> None:
    table = thresholds()
    least = min(table.differences, key=lambda d: d.fraction)
    assert (least.fraction, least.sensation, least.mark) == (0.20, 10.0, "found")
    assert table.pressing == pytest.approx(68.5 - 90.1) and table.pressing_mark == "recalled"
