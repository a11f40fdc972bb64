"""What a signal's levels say: its rest, and whether it switches."""

import h5py
import numpy as np
import pytest

import haploop
from haploop.exchange import understand
from haploop.exchange.importing.roles import is_switching
from haploop.exchange.importing.understood import Rest


@pytest.mark.parametrize(
    ("start", "end", "told", "rest"),
    [
        (0.0, 0.5, None, 0.25),  # they agree: their mean
        (0.0, 2.0, None, 0.0),
        (0.0, 2.0, "start", 0.0),
        (0.0, 2.0, "end", 2.0),
        (0.0, 0.5, "start", 0.0),
    ],
)
def test_rest_is_of_both_ends_where_they_agree(start, end, told, rest):
    assert Rest(start, end, 0.1, 0.0, 10.0).at(told) == rest


@pytest.mark.parametrize(
    ("values", "switches"),
    [
        (np.repeat([0.0, 1.0, 0.0], 400), True),
        (np.repeat([0.1, 4.9, 0.1, 4.9], 300), True),
        (np.tile([0.0, 1.0], 600), False),  # at every sample: a clock, or noise of one bit
        (np.linspace(0.0, 1.0, 1200), False),
        (np.zeros(1200), False),
        (np.array([0.0, np.nan, np.nan]), False),
    ],
)
def test_a_switch_is_at_one_of_two_levels_and_changes_seldom(values, switches):
    assert is_switching(values) == switches


def test_columns_without_names_are_called_by_number_and_unit(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["time"] = np.arange(2000) / 1000
        file["time"].attrs["units"] = "s"
        file["acc"] = np.random.default_rng(1).normal(size=(3, 2000))
        file["acc"].attrs["units"] = "m/s^2"
    asked = str(understand(tmp_path / "a.h5").questions)
    assert all(f"column {number} [m/s^2]" in asked for number in range(3)), asked


@pytest.mark.parametrize(("every", "taken"), [(12, True), (8, False)])
def test_of_a_signal_at_most_a_tenth_is_missing(every, taken, tmp_path):
    force = 5 * np.sin(np.arange(1200) / 40) ** 2
    rows = [f"{n / 1000:.3f},{'' if n % every == 5 else f'{f:.4f}'},{n % 7:.1f}" for n, f in enumerate(force)]
    path = tmp_path / "gaps.csv"
    path.write_text("time (s),force (N),acceleration (m/s^2)\n" + "\n".join(rows) + "\n", encoding="utf-8")
    if taken:
        notes = understand(path).notes
        assert any("100 values are missing" in one for one in notes), notes
    else:
        with pytest.raises(haploop.DataError, match="lacks 150 of 1200 values"):
            understand(path)
