"""Equal to what R printed: `tests/data/statistics/r_output.txt`, made by `r_session.R` in the same folder."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from haploop.experiments import eta_squared_interval
from haploop.experiments.analysis.anova import Effect, anova, cohen_interval, compare_levels
from haploop.experiments.analysis.identification import wilson_interval
from haploop.experiments.analysis.ratings import MultivariateEffect, manova_independent, manova_repeated
from haploop.experiments.analysis.table import Cells, cells_of, read_rows

DATA = Path(__file__).parents[2] / "data" / "statistics"
NAMES = {"g": "group", "g2": "group"}
EXACT = 1e-10
"""Relative; R printed 12 digits."""


def printed(section: str) -> dict[str, list[list[float]]]:
    """Rows of numbers of a section of R's output, by name; a name has a row in several tables."""
    text = (DATA / "r_output.txt").read_text(encoding="utf-8")
    body = text.split(f"== {section}\n")[1].split("\n== ")[0]
    rows: dict[str, list[list[float]]] = {}
    for line in body.splitlines():
        match = re.match(r"^([A-Za-z(][\w.:()]*)((?:\s+(?:-?\d[\d.e+-]*|NA))+)\s*(?:\*+)?\s*$", line)
        if match:
            name = ":".join(NAMES.get(part, part) for part in match[1].split(":"))
            rows.setdefault(name, []).append([float(word) for word in match[2].split() if word != "NA"])
    return rows


def numbers(section: str) -> list[float]:
    """All numbers of a section that holds vectors only."""
    text = (DATA / "r_output.txt").read_text(encoding="utf-8")
    body = text.split(f"== {section}\n")[1].split("\n== ")[0]
    lines = [line for line in body.splitlines() if re.fullmatch(r"\s*(\[1\])?(\s*-?\d[\d.e+-]*)+\s*", line)]
    return [float(word) for line in lines for word in line.replace("[1]", "").split()]


def cells(file: str, factors: Sequence[str], variables: Sequence[str], between: str = "group") -> Cells:
    return cells_of(read_rows(DATA / file), factors, variables, between)


def agree(effects: Sequence[Effect], rows: dict[str, list[list[float]]]) -> None:
    for effect in effects:
        first, *later = rows[":".join(effect.factors)]
        # A column that does not fit the page follows in a block of its own.
        flat = [*first, *(number for row in later for number in row)]
        found: list[float] = [
            effect.sum_of_squares, effect.df, effect.error_sum_of_squares, effect.error_df, effect.f,
            effect.p,
        ]  # fmt: skip
        if (s := effect.sphericity) is not None:
            found += [s.mauchly_w, s.mauchly_p, s.greenhouse_geisser, s.p_greenhouse_geisser, s.huynh_feldt]
            found += [s.p_huynh_feldt]
        assert found == pytest.approx(flat, rel=EXACT), effect.name


@pytest.mark.parametrize(
    ("file", "within", "variable", "between", "section", "count"),
    [
        ("balanced.csv", ["confirmation", "button"], "v1", "group", "balanced, v1", 7),
        ("unbalanced.csv", ["phase", "hour"], "value", "group", "unbalanced", 7),
        ("balanced.csv", ["confirmation", "button"], "v2", "", "no between, balanced v2", 3),
    ],
)
def test_two_within_and_one_between(file, within, variable, between, section, count):
    data = cells(file, within, [variable], between)
    told = (data.groups, between) if between else ()
    effects = anova(data.values[..., 0], data.factors, *told)
    assert len(effects) == count
    agree(effects, printed(section))


def test_pairs_of_levels():
    data = cells("unbalanced.csv", ["phase", "hour"], ["value"])
    found = compare_levels(data.values[..., 0], 0, data.levels[0], data.groups)
    r = np.array(numbers("pairs, unbalanced, phase")).reshape(3, 7)
    for one, (estimate, _, t, p, df, low, high) in zip(found, r, strict=True):
        assert (one.difference, one.t, one.p, one.df) == pytest.approx((estimate, t, p, df), rel=EXACT)
        assert one.interval == pytest.approx((low, high), rel=EXACT)
        assert one.p_bonferroni == pytest.approx(min(1, 3 * p), rel=EXACT)


def test_pairs_without_groups():
    data = cells("balanced.csv", ["confirmation", "button"], ["v2"], "")
    found = compare_levels(data.values[..., 0], 1, data.levels[1])
    r = np.array(numbers("pairs, no between, button of v2")).reshape(3, 6)
    for one, (t, df, p, low, high, mean) in zip(found, r, strict=True):
        assert (one.difference, one.t, one.p, one.df) == pytest.approx((mean, t, p, df), rel=EXACT)
        assert one.interval == pytest.approx((low, high), rel=EXACT)


def multivariate(effect: MultivariateEffect | None, row: Sequence[float], rel: float = EXACT) -> None:
    found = (effect.pillai, effect.f, effect.df, effect.error_df, effect.p)
    assert found == pytest.approx(row[1:6], rel=rel)


def test_manova_with_rows_as_independent_and_that_respects_repeated_measures():
    data = cells("balanced.csv", ["confirmation", "button"], [f"v{n}" for n in range(1, 8)], "")
    rows = printed("manova, rows independent")
    for effect in manova_independent(data.values, data.factors):
        first, second = rows[effect.name.replace(" x ", ":")]
        multivariate(effect, [*first, *second])
    category, button, _ = manova_repeated(data.values, data.factors)
    r = printed("manova, repeated (doubly multivariate), no between")["(Intercept)"]
    multivariate(category, r[0])
    multivariate(button, r[1])


def test_manova_with_a_group():
    data = cells("balanced.csv", ["confirmation", "button"], [f"v{n}" for n in range(1, 8)])
    effects = {
        effect.name: effect
        for effect in manova_repeated(data.values, data.factors, data.groups, "group")
        if effect is not None
    }
    r = printed("manova, repeated, with group")
    multivariate(effects["confirmation"], r["(Intercept)"][0], rel=1e-4)  # R printed p with five digits
    multivariate(effects["group x confirmation"], r["group"][0], rel=1e-4)


def test_intervals():
    assert [*(wilson_interval(27, 30) or ()), *(wilson_interval(0, 10) or ())] == pytest.approx(
        numbers("intervals"), rel=EXACT, abs=1e-15
    )
    low, high, t_low, t_high = numbers("ncp")
    total = 7 + 108 + 1
    assert eta_squared_interval(7.46, 7, 108) == pytest.approx(
        (low / (low + total), high / (high + total)), rel=1e-8
    )
    assert cohen_interval(3.1, 19, 20) == pytest.approx((t_low / 20**0.5, t_high / 20**0.5), rel=1e-8)


def test_the_paper_s_degrees_of_freedom():
    """F(7, 108) = 7.46, F(14, 218) = 26.41 and 5.36."""
    values = np.random.default_rng(1).normal(size=(20, 2, 3, 7))
    effects = manova_independent(values, ("category", "button"))
    assert [(e.df, e.error_df) for e in effects if e] == [(7, 108), (14, 218), (14, 218)]


@pytest.mark.parametrize("sign", [1, -1])
def test_answers_that_hardly_differ_have_an_interval_too(sign):
    """Of a t of 1e12 as of 1e3, where noncentral t can be computed: only the deviation is uncertain."""
    near = np.array(cohen_interval(sign * 1e3, 11, 12))
    np.testing.assert_allclose(cohen_interval(sign * 1e12, 11, 12), near * 1e9, rtol=1e-5)
    assert eta_squared_interval(1e12, 2, 22) == pytest.approx((1, 1), abs=1e-8)
    small, large = (1 - np.array(eta_squared_interval(f, 2, 22)) for f in (1.01e8, 0.99e8))
    np.testing.assert_allclose(small, large, rtol=0.03)
    assert cohen_interval(0.0, 11, 12) == pytest.approx((-1.959964 / 12**0.5, 1.959964 / 12**0.5), rel=1e-5)
