"""What a report says of the answers to an experiment: a table of `haploop experiment export`."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from pathlib import Path

from ...experiments import (
    METRICS,
    Confusion,
    Effect,
    Identification,
    MultivariateEffect,
    Ratings,
    analyse_identification,
    analyse_ratings,
    read_rows,
)
from ...instruments import DataError
from ..show import ANSWERS_SIMULATED, interval
from .sections import Section

__all__ = ["answers_section"]


def answers_section(path: Path) -> Section:
    """Analyse a CSV of answers or of ratings, as `haploop analyse` does by default. Raises DataError."""
    rows = read_rows(path)
    loaded: Identification | Ratings
    if {"presented", "answered"} <= set(rows.columns):
        loaded = analyse_identification(rows)
        title, facts = "Matching", list(_of_identification(loaded))
    elif {"pair", "rating"} <= set(rows.columns):
        loaded = analyse_ratings(rows)
        title, facts = "Ratings", list(_of_ratings(loaded))
    else:
        raise DataError(
            f"{path} has neither the columns presented and answered nor pair and rating: name a table of "
            "`haploop experiment export`."
        )
    notes = [*loaded.notes, *([ANSWERS_SIMULATED] if rows.simulated else [])]
    return Section(
        name=path.name,
        title=f"{title}, {path.name}",
        simulated=rows.simulated,
        rig="",
        facts=[*facts, *(("Note", note) for note in notes)],
        verdicts=[],
        sources=[(path.name, hashlib.sha256(path.read_bytes()).hexdigest())],
        loaded=loaded,
    )


def _of_identification(found: Identification) -> Iterator[tuple[str, str]]:
    for key, confusion in found.matrices.items():
        where = ", ".join(f"{column} {value}" for column, value in zip(found.by, key, strict=True))
        for name in confusion.classes:
            shares = ((m, confusion.value(m, name), confusion.interval(m, name)) for m in METRICS)
            told = ", ".join(f"{metric} {_share(value, edges)}" for metric, value, edges in shares)
            yield f"{where[:1].upper()}{where[1:]}, {name}", told
        yield f"{where[:1].upper()}{where[1:]}, correct", _correct(confusion)
    yield "Correct, all together", _correct(found.pooled)
    for one in found.performance:
        left_out = f", without {', '.join(one.left_out)}" if one.left_out else ""
        told = _effects(one.effects)
        yield f"Effects on {one.metric}", f"{told} (n = {one.people} participants{left_out})"


def _share(value: float | None, edges: tuple[float, float] | None) -> str:
    bounds = f" ({100 * edges[0]:.0f} to {100 * edges[1]:.0f} %)" if edges else ""
    return "not defined" if value is None else f"{100 * value:.2f} %{bounds}"


def _correct(confusion: Confusion) -> str:
    edges = confusion.overall_interval
    bounds = f" ({interval(edges)})" if edges else ""
    return f"{100 * confusion.overall:.2f} %{bounds} of {confusion.counts.sum()} trials"


def _of_ratings(found: Ratings) -> Iterator[tuple[str, str]]:
    yield "Participants", str(len(found.people))
    if found.left_out:
        yield "Left out", f"a rating of {', '.join(found.left_out)} is missing"
    for title, effects in (
        ("All pairs together, by person", found.repeated),
        ("All pairs together, rows as independent", found.independent),
    ):
        told = [_multivariate(one) for one in effects if one]
        if told:
            yield title, "; ".join(told)
    for pair in found.pairs:
        yield pair.pair, _effects(pair.effects)


def _multivariate(one: MultivariateEffect) -> str:
    eta = f"partial eta squared {one.partial_eta_squared:.3f}"
    return f"{one.name} F({one.df}, {one.error_df}) = {one.f:.2f}, {_p(one.p)}, {eta}"


def _effects(effects: Sequence[Effect]) -> str:
    return "; ".join(f"{e.name} F({e.df}, {e.error_df}) = {e.f:.2f}, {_p(e.reported_p)}" for e in effects)


def _p(value: float) -> str:
    return "p < 0.001" if value < 0.001 else f"p = {value:.3f}"
