"""Stamps that are rounded: what they tell of the rate, and how well."""

from pathlib import Path

import numpy as np
import pytest

from haploop.base.errors import DataError
from haploop.exchange.importing.timebase import TimeBase, time_base


def rounded(seconds: float, rate_hz: float = 5000.0, stated: float | None = None) -> TimeBase:
    """From stamps with three digits: a millisecond over `seconds`."""
    stamps = np.round(np.arange(round(seconds * rate_hz) + 1) / rate_hz, 3)
    return time_base(Path("a.csv"), stamps, 1.0, stated)


def test_a_rate_is_told_with_its_uncertainty_and_a_stated_one_within_it_believed():
    found = rounded(2.0)
    assert found.rate_hz == 5000.0  # the three digits that are certain
    assert found.said == ("5000 samples/s to 0.05%, evenly: stamps are rounded to 1 ms",)
    # 5003 is further from three digits than a quarter of what is uncertain.
    assert rounded(2.0, 5003.0).rate_hz == pytest.approx(5003.0, rel=1e-4)
    assert rounded(2.0, stated=5002.0).rate_hz == 5002.0
    assert "as stated" in rounded(2.0, stated=5002.0).said[0]
    assert rounded(2.0, stated=5003.0).rate_hz == 5000.0


def test_stamps_that_tell_too_little_are_refused():
    assert rounded(0.51).rate_hz == 5000.0
    with pytest.raises(DataError, match=r"they tell the rate to 0\.2% only: state it"):
        rounded(0.49)
    assert rounded(0.49, stated=5000.0).rate_hz == 5000.0
