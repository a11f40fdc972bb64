"""The scope's buckets: every click is seen, whatever blocks it comes in."""

import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from haploop.console.server.follower import Buckets, LiveScope
from haploop.instruments import LiveBlock, Sensors, load_rig_file
from haploop.instruments.live import Run

SIZE = 50


def fed(values, cuts, kept=1000):
    buckets = Buckets(len(values), SIZE, kept)
    edges = [0, *sorted(cuts), values.shape[1]]
    for first, end in itertools.pairwise(edges):
        if end > first:
            buckets.add(first, values[:, first:end])
    return buckets


@given(st.sets(st.integers(1, 999)), st.integers(0, 990))
def test_a_click_of_two_samples_is_in_its_own_bucket(cuts, at):
    values = np.zeros((2, 1000))
    values[1, at : at + 2] = 7.0, -7.0
    first, extremes = fed(values, cuts).since(0)
    assert (first, extremes.shape) == (0, (2, 2, 20))
    assert extremes[1, 1, at // SIZE] == 7.0
    assert extremes[0, 1, (at + 1) // SIZE] == -7.0
    assert not extremes[:, 0].any()


@given(st.sets(st.integers(1, 999)), st.sets(st.integers(1, 999)))
def test_buckets_do_not_depend_on_how_the_samples_came(cuts, others):
    values = np.random.default_rng(1).standard_normal((3, 1000))
    one, other = (fed(values, found).since(4) for found in (cuts, others))
    assert one[0] == other[0] == 4
    np.testing.assert_array_equal(one[1], other[1])


def test_a_bucket_with_a_missing_sample_shows_nothing():
    buckets = Buckets(1, SIZE, 1000)
    buckets.add(0, np.ones((1, 120)))
    buckets.add(260, np.ones((1, 240)))
    first, extremes = buckets.since(0)
    assert (first, buckets.end, buckets.missed) == (0, 10, 140)
    np.testing.assert_array_equal(np.isnan(extremes[0, 0]), [False] * 2 + [True] * 4 + [False] * 4)


def test_only_the_newest_buckets_are_kept():
    buckets = fed(np.arange(1000.0)[None], {300, 601}, kept=5)
    first, extremes = buckets.since(0)
    assert (first, list(extremes[1, 0])) == (15, [799, 849, 899, 949, 999])
    assert buckets.since(20)[1].shape == (2, 1, 0)
    late = Buckets(1, SIZE, 1000)
    late.add(10_020, np.ones((1, 200)))
    assert (late.since(0)[0], late.missed) == (201, 0)


def test_a_run_without_any_sensor_has_no_rows_and_is_followed_all_the_same():
    run = Run("r", True, "record", "", ("a", "b"), 5000.0, Sensors(), None)
    scope = LiveScope(load_rig_file("simulated"), None)
    try:
        for first in (0, 200):
            scope._add(LiveBlock(run, first, np.zeros((2, 200)), np.zeros(2, bool)))
        about = scope.about()
    finally:
        scope.close()
    assert about["rows"] == [] and about["received"] == 400
