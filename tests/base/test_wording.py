"""Words that all layers share."""

import pytest

from haploop.base.wording import capital, error_said

NAN = float("nan")


@pytest.mark.parametrize(("error", "interval", "said", "brief"), [
    (0.109, (0.02, 0.177), "10.9 % (2.0 to 17.7 %)", "10.9 %"),
    (0.109, (0.0, 0.177), "10.9 % (0.0 to 17.7 %)", "10.9 %"),
    (0.0, (0.0, 0.132), "at most 13.2 %", "at most 13.2 %"),
    (0.0004, (0.0, 0.132), "at most 13.2 %", "at most 13.2 %"),
    (0.0, (0.0, 0.0), "at most 0.1 %", "at most 0.1 %"),
    (0.0, (NAN, NAN), "not known", "not known"),
    (NAN, (NAN, NAN), "not known", "not known"),
    (None, (None, None), "not known", "not known"),
    (0.05, (None, None), "5.0 %", "5.0 %"),
])  # fmt: skip
def test_an_error_of_zero_is_a_bound(error, interval, said, brief):
    assert error_said(error, interval) == said
    assert error_said(error, interval, brief=True) == brief


@pytest.mark.parametrize(
    ("text", "begins"), [("", ""), ("263.2 Hz", "263.2 Hz"), ("uSB key, 2 N", "USB key, 2 N")]
)
def test_a_capital_changes_nothing_else(text, begins):
    assert capital(text) == begins
