from dataclasses import replace

import numpy as np
import pytest
import scipy

from haploop.calibration.perception import Sensation, shares, thresholds

PRESSING = thresholds().act("pressing")
WHO = "A person who presses with 2.0 N"


def test_the_answer_is_known_where_both_ends_of_the_threshold_say_the_same():
    for level, answer, words in (
        (PRESSING.higher + 0.1, "yes", f"{WHO} feels it (6 dB above threshold; "),
        (PRESSING.higher - 0.1, "not known", "Not known whether a person who presses with 2.0 N feels it ("),
        (-PRESSING.lower + 0.1, "not known", "Not known whether "),
        (-PRESSING.lower - 0.1, "no", f"{WHO} mostly does not feel it (13 dB below "),
        (-40, "no", f"{WHO} does not feel it (40 dB below threshold; under 1 % of people)."),
        (-np.inf, "no", "does not feel it: nothing moves between 18 and 1122 Hz."),
    ):
        sensation = Sensation(PRESSING, level)
        assert sensation.answer == answer
        assert words in sensation.sentence(2.0)


def test_the_share_of_people_is_that_of_a_crowd_with_its_own_thresholds():
    rng = np.random.default_rng(4711)
    for level in (-8.0, 2.0, 11.0):
        least, most = Sensation(PRESSING, level).people
        for edge, shift in ((least, PRESSING.higher), (most, -PRESSING.lower)):
            crowd = shift + PRESSING.spread * rng.normal(size=200_000)
            assert edge == pytest.approx(np.mean(level > crowd), abs=0.005)


def test_a_known_threshold_narrows_the_share_and_decides():
    known = replace(PRESSING, higher=1.0, lower=1.0, mark="measured", basis="that of 12 people of this lab")
    assert Sensation(PRESSING, 3.0).answer == "not known"
    assert Sensation(known, 3.0).answer == "yes"
    least, most = Sensation(known, 3.0).people
    assert (least, most) == pytest.approx(scipy.stats.norm.cdf([2 / 6, 4 / 6]))
    assert "12 people of this lab, known to 1 dB" in Sensation(known, 3.0).reservation


def test_what_hardly_anybody_feels_is_told_from_what_some_do():
    at = -PRESSING.lower + PRESSING.spread * scipy.stats.norm.ppf(0.05)
    assert Sensation(PRESSING, at - 0.1).nobody and not Sensation(PRESSING, at + 0.1).nobody


def test_shares_are_ranges_in_whole_percent():
    assert shares(0.631, 0.9987) == "63 to over 99 %"
    assert shares(0.001, 0.002) == "under 1 %"
    assert shares(0.5, 0.502) == "50 %"


def test_the_estimate_is_marked_with_what_it_changes_and_what_settles_it():
    said = Sensation(PRESSING, 0.0).reservation
    for words in ("an estimate", "6 dB higher or 13 dB lower", "people differ by 6 dB", "settles it"):
        assert words in said
