"""A stated rate and the stamps of a column: they agree within 1 %, or it is asked which is right."""

from pathlib import Path

import numpy as np
import pytest

from haploop.exchange.columns import Column, Stated, Table
from haploop.exchange.importing.clock import base_of
from haploop.exchange.importing.timebase import TimeBase
from haploop.exchange.importing.understood import FileMapping, Question


@pytest.mark.parametrize("off", [-0.5, -0.05, -0.012, -0.008, 0.0, 0.008, 0.012, 0.05, 0.5])
def test_a_stated_rate_is_held_against_the_stamps(off):
    stamps = np.arange(5000) / 1000
    stated = 1000 * (1 + off)
    table = Table(
        Path("a.csv"), "text", (Column("time", "s", stamps),), rates=(Stated(stated, f"Rate: {stated:g}"),)
    )
    found = base_of(table, 0, (1.0, "s"), [0], FileMapping())
    if abs(off) > 0.01:
        assert isinstance(found, Question) and found.what.startswith("which is right, its stamps of 1000")
    else:
        assert isinstance(found, TimeBase) and found.rate_hz == pytest.approx(1000)


@pytest.mark.parametrize(("other", "asked"), [(1000.05, False), (1010.0, True), (990.0, True)])
def test_two_stated_rates_without_stamps(other, asked):
    rates = (Stated(1000.0, "Rate: 1000"), Stated(other, f"Other: {other}"))
    table = Table(Path("a.csv"), "text", (Column("force", "N", np.arange(9.0)),), rates=rates)
    assert isinstance(base_of(table, None, None, [0], FileMapping()), Question) == asked
