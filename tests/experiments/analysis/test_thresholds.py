"""Thresholds are stated of answers that show one; a person who guesses has none, by name."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from haploop.base.errors import DataError
from haploop.experiments import Threshold, analyse_thresholds, lab_threshold_of, read_rows
from tests.experiments.analysis.test_lab_threshold import played

pytest.importorskip("psignifit")
VALUES = (0.1, 0.2, 0.4, 0.8)
GUESSES, ALL_RIGHT, FALLING, WEAK, GOOD = (
    (9, 11, 15, 13),
    (25, 25, 25, 25),
    (25, 19, 17, 9),
    (13, 12, 15, 18),
    (13, 13, 18, 25),
)


def table(
    folder: Path, right: dict[str, tuple[int, ...]], sign: int = 1, standard: float | None = None
) -> Path:
    lines = ["participant,comparison,correct" + (",first_value,second_value" if standard is not None else "")]
    for who, counts in right.items():
        for value, count in zip(VALUES, counts, strict=True):
            both = "" if standard is None else f",{sign * value},{standard}"
            lines += [f"{who},{sign * value},{str(n < count).lower()}{both}" for n in range(25)]
    path = folder / "answers.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("answers", "why"),
    [
        (GUESSES, "no better than chance (48 of 100 right)"),
        ((12, 13, 14, 17), "no better than chance"),
        (ALL_RIGHT, "lies below 0.1, the last value that was compared (100 of 100 right)"),
        (FALLING, "become wrong towards 0.8, where they should become right (25 of 25 right at 0.1, 9 of 25"),
        (WEAK, "lies above 0.8"),
        (GOOD, ""),
    ],
)
def test_only_answers_that_show_a_threshold_have_one(tmp_path, answers, why):
    (found,) = analyse_thresholds(read_rows(table(tmp_path, {"P1": answers})))
    assert why in found.why_none and bool(why) == bool(found.why_none)
    if why:
        assert math.isnan(found.threshold) and found.difference is None
    else:
        assert found.threshold == pytest.approx(0.41, abs=0.03)


def test_below_a_standard_answers_become_right_as_the_value_falls(tmp_path):
    (found,) = analyse_thresholds(read_rows(table(tmp_path, {"P1": FALLING}, sign=-1, standard=0.0)))
    assert "become wrong towards 0.8" in found.why_none


def test_a_guesser_is_left_out_of_a_labs_threshold_by_name():
    felt = [
        Threshold((f"P{n}",), value, (value / 2, value * 2), 0.1, 0.0, 100, 0.0)
        for n, value in enumerate((0.2, 0.25, 0.3))
    ]
    nothing = (math.nan, math.nan)
    why = "the answers are no better than chance"
    guesser = Threshold(("P9",), math.nan, nothing, math.nan, math.nan, 100, 0.0, why)
    assert lab_threshold_of([*felt, guesser], played()) == lab_threshold_of(felt, played())
    with pytest.raises(DataError, match="P9 has none: the answers are no better than chance"):
        lab_threshold_of([*felt[:2], guesser], played())


def test_the_command_names_who_has_none_and_says_so_by_its_exit_code(run, tmp_path):
    path = table(tmp_path, {"P1": GUESSES, "P2": FALLING})
    said = run("analyse thresholds", path, ends=1)
    assert "No threshold of P1: the answers are no better than chance" in said.stdout
    assert "No threshold of P2: the answers become wrong towards 0.8" in said.stdout
    found = run.json("analyse thresholds", path, ends=1)
    assert [one["threshold"] for one in found["thresholds"]] == [None, None]
