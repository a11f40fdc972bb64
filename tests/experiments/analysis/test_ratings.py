"""Ratings: normalisation, and known effects that are found where they are."""

from pathlib import Path

import numpy as np
import pytest

from haploop.base.errors import DataError
from haploop.experiments.analysis.ratings import analyse_ratings, normalise
from haploop.experiments.analysis.table import Rows, read_rows
from tests.mutating import mutations, refused

PAIRS = ("pleasant", "clear", "quick")
HEADER = "participant,category,button,pair,rating"


def ratings(folder: Path, people: int = 12, pleasant: float = 0.0, seed: int = 1) -> Rows:
    """Digital buttons are more pleasant by `pleasant`; each person uses the scale in its own way."""
    rng = np.random.default_rng(seed)
    lines = [HEADER]
    for person in range(people):
        scale = rng.uniform(0.5, 2)
        for category in ("physical", "digital"):
            for button in ("latch", "toggle", "push"):
                for pair in PAIRS:
                    shift = pleasant if (category, pair) == ("digital", "pleasant") else 0.0
                    value = scale * 50 * np.exp(shift + 0.15 * rng.normal())
                    lines.append(f"P{person:02},{category},{button},{pair},{value:.3f}")
    path = folder / "ratings.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    return read_rows(path)


@pytest.mark.parametrize("low", [0.0, -3.0])
def test_a_scale_that_is_not_positive_is_refused(tmp_path, low):
    rows = ratings(tmp_path)
    path = tmp_path / "low.csv"
    text = (tmp_path / "ratings.csv").read_text(encoding="utf-8").splitlines()
    text[40] = text[40].rpartition(",")[0] + f",{low}"
    path.write_text("\n".join(text), encoding="utf-8")
    with pytest.raises(DataError, match=rf"P02 is {low:g}, and a geometric mean needs positive"):
        analyse_ratings(read_rows(path))
    assert not analyse_ratings(read_rows(path), normalised=False).normalised
    assert analyse_ratings(rows).normalised


def test_an_effect_is_found_where_it_is(tmp_path):
    rows = ratings(tmp_path, pleasant=0.4)
    result = analyse_ratings(rows)
    by_pair = {pair.pair: {effect.name: effect.p for effect in pair.effects} for pair in result.pairs}
    assert by_pair["pleasant"]["category"] < 1e-4
    together = {effect.name: effect for effect in result.repeated if effect}
    assert together["category"].p < 1e-3
    for some in result.pairs[0].simple.values():
        assert [one.p_bonferroni < 0.05 for one in some] == [True]
        assert some[0].first == "physical" and some[0].difference < 0
    raw = analyse_ratings(rows, normalised=False)
    assert np.all(result.pairs[0].deviation.mean() < 0.6 * raw.pairs[0].deviation.mean())
    values = np.random.default_rng(2).uniform(1, 100, size=(5, 2, 3))
    own, grand = np.exp(np.log(values).reshape(5, -1).mean(axis=1)), np.exp(np.log(values).mean())
    assert normalise(values) == pytest.approx(values * (grand / own)[:, None, None])


def test_what_too_few_people_allow(tmp_path):
    """Three pairs and two degrees of freedom need seven people."""
    result = analyse_ratings(ratings(tmp_path, people=6))
    assert [effect is None for effect in result.repeated] == [False, True, True]
    assert None not in result.independent and len(result.notes) == 2


def test_a_person_without_a_rating_is_named(tmp_path):
    ratings(tmp_path)
    text = (tmp_path / "ratings.csv").read_text(encoding="utf-8").splitlines()
    path = tmp_path / "hole.csv"
    path.write_text("\n".join(text[:20] + text[21:]), encoding="utf-8")
    result = analyse_ratings(read_rows(path))
    assert result.left_out == ("P01",) and len(result.people) == 11


def test_a_changed_table_is_refused_in_one_sentence_or_read(tmp_path, full):
    ratings(tmp_path, people=4)
    path = tmp_path / "ratings.csv"
    raw, number = path.read_bytes(), 0
    for changed in mutations(raw, 500 if full else 24, seed=12):
        path.write_bytes(changed)
        number += refused(lambda: analyse_ratings(read_rows(path)))
    assert number > 4
