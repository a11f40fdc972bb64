import numpy as np
import pytest

from haploop.calibration.perception import Feeling, Pressed, feeling_of, levels_of, thresholds

RATE, WHO = 20000.0, " person who presses with 2.0 N"


def snap(level: float, at: float = 0.4, hz: float = 264.0) -> np.ndarray:
    """A burst that lies `level` dB above the threshold of a finger that presses."""
    t = np.arange(round(0.9 * RATE)) / RATE
    shape = np.exp(-(((t - at) / 0.012) ** 2)) * np.sin(2 * np.pi * hz * t)
    return np.asarray(shape * 10 ** ((level - levels_of(shape, RATE).pressing) / 20))


def felt(target: np.ndarray, measured: np.ndarray, recorded: np.ndarray | None = None) -> Feeling:
    return feeling_of(target, measured, RATE, Pressed(recorded, 2.0))


def said(feeling: Feeling) -> str:
    return " ".join((feeling.sentence, *feeling.notes))


def test_a_loud_motion_is_felt_and_a_small_one_is_not():
    for level, answer, words in (
        (9, "yes", f"A{WHO} feels it (9 dB above threshold; "),
        (-4, "not known", f"Not known whether a{WHO} feels it (4 dB below threshold; "),
        (-40, "no", f"A{WHO} does not feel it (40 dB below threshold; "),
    ):
        feeling = felt(snap(level), snap(level))
        assert feeling.felt == answer
        assert feeling.measured.pressing == pytest.approx(level, abs=1e-6)
        assert feeling.sentence.startswith(words)


def test_each_act_has_its_own_level():
    pressing, resting, sliding = felt(snap(9), snap(9)).acts
    assert [one.act.name for one in (pressing, resting, sliding)] == ["pressing", "resting", "sliding"]
    # At 264 Hz the curve of the grip lies 17 dB below that of a finger at rest.
    assert pressing.level - resting.level == pytest.approx(17, abs=1) and sliding.level == resting.level
    assert (pressing.answer, resting.answer) == ("yes", "not known")


def test_a_motion_outside_the_table_is_not_called_felt():
    fast = 50 * np.sin(2 * np.pi * 3000 * np.arange(round(0.9 * RATE)) / RATE) * np.hanning(round(0.9 * RATE))
    assert felt(fast, fast).felt == "no"
    nothing = np.zeros(len(fast))
    assert "nothing moves between 18 and 1122 Hz" in felt(nothing, nothing).sentence


def test_an_error_is_judged_by_the_just_noticeable_difference_where_it_was_measured():
    target = snap(20)
    small, large = felt(target, 1.1 * target), felt(target, 1.4 * target)
    assert small.comparable and small.difference == "no" and "within the least just noticeable" in said(small)
    assert large.comparable and large.difference == "yes" and "it is felt." in said(large)
    assert small.ratio == pytest.approx(0.1) and large.ratio == pytest.approx(0.4)


@pytest.mark.parametrize("level", [9.9, 4, 0])
def test_near_threshold_nothing_is_claimed_by_the_just_noticeable_difference(level):
    target = snap(level)
    feeling = felt(target, 1.4 * target)
    assert not feeling.comparable and feeling.difference == "not known"
    assert "were measured 10 dB above threshold" in said(feeling) and "nothing is claimed" in said(feeling)
    # Nor is a small difference called unnoticeable by a figure that does not hold there.
    small = felt(target, 1.1 * target)
    assert small.difference == "not known" and "within the least" not in said(small)


def test_a_difference_that_nobody_feels_is_not_felt_however_large_it_is():
    target = snap(-62)
    feeling = felt(target, 2 * target)
    assert feeling.difference == "no" and "too weak to be felt by itself" in said(feeling)


def test_a_motion_where_there_should_be_none_is_felt_by_itself():
    feeling = felt(snap(-60), snap(8))
    assert feeling.difference == "yes" and "is felt by itself: the target is not" in said(feeling)


def test_the_parts_of_the_press_that_are_lost_are_named():
    first, second = snap(15, at=0.3), snap(9, at=0.6)
    feeling = felt(first, first, recorded=first + second)
    ((begin, end),) = feeling.lost
    assert 0.55 < begin < 0.6 < end < 0.65
    assert len(feeling.spans) == 1 and len(feeling.recorded_spans) == 2
    lost = 1e3 * (end - begin)
    wanted = 1e3 * sum(after - before for before, after in feeling.recorded_spans)
    assert f"Of the {wanted:.0f} ms" in said(feeling) and f"for {wanted - lost:.0f} ms (in" in said(feeling)
    whole = felt(first, first, recorded=0.9 * first)
    assert not whole.lost and "stay above it" in said(whole)
    quiet = felt(snap(-30), snap(-30), recorded=first)
    assert quiet.lost == quiet.recorded_spans and "above it for 0 ms" in said(quiet)


def test_loudness_is_relative_to_the_recorded_press_and_independent_of_both_sizes():
    press = snap(18) + snap(12, at=0.5, hz=60)
    for size in (0.01, 1.0, 30.0):
        feeling = felt(0.1 * size * press, 0.1 * size * press, recorded=size * press)
        assert feeling.loudness_db == pytest.approx(-20)
    assert felt(press, 2 * press, recorded=press).loudness_db == pytest.approx(6.02, abs=0.01)
    assert np.isnan(felt(press, press).loudness_db)


def test_the_noise_of_the_plays_is_stated_and_named():
    rng = np.random.default_rng(61151)
    target = snap(5)
    plays = target + rng.normal(scale=0.5, size=(8, len(target)))
    feeling = feeling_of(target, plays.mean(axis=0), RATE, plays=plays)
    truth = levels_of(rng.normal(scale=0.5, size=8 * len(target)), RATE).pressing
    assert feeling.noise_total == pytest.approx(truth - 10 * np.log10(8), abs=0.7)
    assert feeling.noise is not None and feeling.noise.shape == feeling.octaves_hz.shape
    assert "no larger than the noise of the plays" in said(feeling)
    quiet = 1.4 * np.array([target, 1.001 * target])
    assert "noise" not in said(feeling_of(target, 1.4 * target, RATE, plays=quiet))


def test_an_estimated_form_of_the_threshold_is_named_where_the_level_depends_on_it():
    assert "the form of the threshold is estimated" in said(felt(snap(5, hz=550), snap(5, hz=550)))
    assert "the form" not in said(felt(snap(5), snap(5)))


def test_the_figures_in_the_sentences_are_those_of_the_table():
    least = min(thresholds().differences, key=lambda d: d.fraction)
    assert (least.fraction, least.sensation, least.mark) == (0.20, 10.0, "found")
