"""Comparisons of pairs, by their definitions: corrected p, d, its interval, and degrees of freedom."""

import math

import numpy as np
import pytest
import scipy

from haploop.experiments.analysis.anova import bonferroni, cohen_interval, paired
from haploop.experiments.analysis.identification import clustered_interval, wilson_interval
from haploop.experiments.analysis.ratings import analyse_ratings
from haploop.experiments.analysis.table import Rows, cells_of

DIFFERENCES = np.array([1.0, 3.0, 2.0, 6.0, -1.0, 4.0, 2.5, 0.5])


def rows(*lines: dict[str, str]) -> Rows:
    return Rows("table", tuple(lines[0]), tuple(enumerate(lines, 2)))


def test_bonferroni_multiplies_and_ends_at_one():
    found = [paired("a", "b", DIFFERENCES - shift) for shift in (0.0, 2.0, 2.2)]
    corrected = [one.p_bonferroni for one in bonferroni(found)]
    assert corrected == [pytest.approx(3 * found[0].p), 1.0, 1.0]
    assert found[1].p > 1 / 3 and found[2].p > 1 / 3


def test_within_groups_d_has_the_deviation_within_them():
    found = paired("a", "b", DIFFERENCES)
    assert found.d == pytest.approx(DIFFERENCES.mean() / DIFFERENCES.std(ddof=1))
    assert (found.df, found.weight) == (7, pytest.approx(8))
    assert found.p == pytest.approx(scipy.stats.ttest_1samp(DIFFERENCES, 0).pvalue)
    found = paired("a", "b", DIFFERENCES, (0, 0, 0, 0, 0, 1, 1, 1))
    parts = DIFFERENCES[:5], DIFFERENCES[5:]
    within = math.sqrt(sum(np.sum((part - part.mean()) ** 2) for part in parts) / 6)
    mean = (parts[0].mean() + parts[1].mean()) / 2
    assert (found.df, found.difference) == (6, pytest.approx(mean))
    assert found.weight == pytest.approx(4 / (1 / 5 + 1 / 3))
    assert found.d == pytest.approx(mean / within)


def test_the_interval_of_d_leaves_out_a_fortieth_on_each_side():
    found = paired("a", "b", DIFFERENCES)
    low, high = found.d_interval
    tails = [scipy.stats.nct.sf(found.t, 7, bound * math.sqrt(8)) for bound in (low, high)]
    assert tails == pytest.approx([0.025, 0.975], abs=1e-6) and low < found.d < high
    assert cohen_interval(found.t, 7, 4 * 8) == pytest.approx((low / 2, high / 2))


def test_people_who_all_differ_alike_leave_nothing_to_test_against():
    (found,) = bonferroni([paired("a", "b", np.full(4, 0.3))])
    assert found.difference == pytest.approx(0.3)
    others = (found.t, found.p, found.p_bonferroni, found.d, *found.interval, *found.d_interval)
    assert all(map(math.isnan, others))


def test_intervals_of_proportions_stay_between_0_and_1():
    for hits, total in ((0, 3), (3, 3), (16, 16), (0, 27), (1e6, 1e6), (0, 1e-3)):
        low, high = wilson_interval(hits, total) or (math.nan, math.nan)
        assert 0 <= low < high <= 1
    low, high = wilson_interval(8, 10) or (math.nan, math.nan)
    assert (low, high) == pytest.approx((0.490162, 0.943318), abs=1e-6)  # by hand


def test_few_people_have_the_variance_between_them_of_a_sample():
    """Korn and Graubard's number of trials, by hand, for three people of ten trials each."""
    hits, total = np.array([3.0, 6.0, 9.0]), 30.0
    variance = 3 / 2 * float(np.sum((hits - 6.0) ** 2)) / total**2
    shrink = scipy.stats.norm.ppf(0.975) / scipy.stats.t.ppf(0.975, 2)
    effective = 0.6 * 0.4 / variance * shrink**2
    assert clustered_interval(hits, [10.0] * 3) == pytest.approx(wilson_interval(0.6 * effective, effective))


def test_several_lines_of_a_cell_are_averaged():
    lines = [
        {"participant": who, "button": button, "rating": str(value)}
        for who, button, *values in (
            ("P1", "a", 1, 3),
            ("P1", "b", 5, 5),
            ("P2", "a", 2, 8),
            ("P2", "b", 0, 1),
        )
        for value in values
    ]
    assert cells_of(rows(*lines), ["button"], ["rating"]).values[..., 0].tolist() == [[2, 5], [5, 0.5]]


def test_the_deviation_of_ratings_is_that_of_a_sample_of_people():
    values = np.random.default_rng(1).uniform(10, 90, (5, 2, 2)).round()
    lines = [
        {
            "participant": f"P{who}", "category": f"c{i}", "button": f"b{j}", "pair": "p",
            "rating": f"{value:g}",
        }
        for (who, i, j), value in np.ndenumerate(values)
    ]  # fmt: skip
    (pair,) = analyse_ratings(rows(*lines), normalised=False).pairs
    assert pair.mean == pytest.approx(values.mean(axis=0))
    assert pair.deviation == pytest.approx(values.std(axis=0, ddof=1))
