"""What the analyses of an experiment say: answers, ratings, thresholds, and the power of a plan."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from typing import Any

from ...base.wording import capital
from ...calibration import LabThreshold
from ...reports.contents import (
    ANSWERS_SIMULATED,
    Contents,
    Drawing,
    Fact,
    Grid,
    fact,
    interval,
    percent,
    plain,
    words,
)
from ..analysis import (
    METRICS,
    Comparison,
    Confusion,
    Effect,
    Identification,
    MultivariateEffect,
    Power,
    Ratings,
    Rows,
    Threshold,
    people_table,
)
from . import figures

_answers = partial(Contents, origin=ANSWERS_SIMULATED)


def identification_contents(result: Identification, simulated: bool, of: str = "") -> Contents:
    """Confusion matrices with their metrics, and the effects on performance."""
    matrices = {_level(result.by, key): confusion for key, confusion in result.matrices.items()}
    tables = [_confusion(confusion, title) for title, confusion in matrices.items()]
    if len(matrices) != 1:
        tables.append(_confusion(result.pooled, "All together" if matrices else ""))
    for one in result.performance:
        left_out = f"; without {', '.join(one.left_out)}" if one.left_out else ""
        tables.append(_effects(one.effects, f"Effects on {one.metric} ({one.people} participants{left_out})"))
        tables += [
            _comparisons(some, f"{capital(one.metric)}: {factor}", 100, " %")
            for factor, some in one.comparisons.items()
        ]
    values = fact(
        **_confusion_values(result.pooled),
        matrices=[
            dict(zip(result.by, key, strict=True)) | _confusion_values(confusion)
            for key, confusion in result.matrices.items()
        ],
        performance=[
            {
                "metric": one.metric,
                "participants": one.people,
                "left_out": one.left_out,
                "effects": [_effect_values(effect) for effect in one.effects],
                "comparisons": _comparison_values(one.comparisons),
            }
            for one in result.performance
        ],
        notes=result.notes,
    )
    kind = "over participants" if result.pooled.interval_over_people else "of trials taken as independent"
    trials, people = (
        int(result.pooled.counts.sum()),
        max((one.people for one in result.performance), default=0),
    )
    by = f" by {people} participants" if people else ""
    drawing = Drawing.alone(
        "confusion",
        "Which button was answered",
        words.CONFUSION,
        lambda columns: figures.confusion_figure(result, columns),
        f"n = {trials} trials{by}.",
    )
    notes = [f"Intervals of 95 %, {kind}.", *result.notes]
    return _answers(f"Matching{of}", [values], tables, notes, simulated=simulated, figures=[drawing])


def ratings_contents(result: Ratings, simulated: bool, of: str = "") -> Contents:
    """Effects on all adjective pairs together and on each, and the comparisons."""
    first, second = result.factors
    kind = "normalised by geometric means" if result.normalised else "as rated"
    tables = [
        Grid(title, ("Effect", "Pillai", "F", "df", "p", "η²p"), [_multivariate(one) for one in effects])
        for title, effects in (
            ("All pairs together, by person (the form to report)", result.repeated),
            ("All pairs together, rows taken as independent (as the paper)", result.independent),
        )
        if effects
    ]
    for pair in result.pairs:
        rows = [
            (level, *(f"{mean:.2f} ± {sd:.2f}" for mean, sd in zip(means, deviations, strict=True)))
            for level, means, deviations in zip(result.levels[0], pair.mean, pair.deviation, strict=True)
        ]
        title = f"{pair.pair} ({kind}; mean and standard deviation)"
        tables.append(Grid(title, (first, *result.levels[1]), rows))
        tables.append(_effects(pair.effects, f"Effects on {pair.pair}"))
        tables += [
            _comparisons(some, f"{pair.pair}: {second} {label}") for label, some in pair.simple.items()
        ]
    values = fact(
        factors=result.factors,
        levels=result.levels,
        participants=len(result.people),
        left_out=result.left_out,
        normalised=result.normalised,
        manova={
            "by_person": [_multivariate_values(one) for one in result.repeated],
            "independent_rows": [_multivariate_values(one) for one in result.independent],
        },
        pairs=[
            {
                "pair": pair.pair,
                "mean": pair.mean,
                "standard_deviation": pair.deviation,
                "effects": [_effect_values(effect) for effect in pair.effects],
                "comparisons": _comparison_values(pair.comparisons),
                "simple_comparisons": _comparison_values(pair.simple),
            }
            for pair in result.pairs
        ],
        notes=result.notes,
    )
    drawing = Drawing.alone(
        "ratings",
        "Adjective ratings",
        words.RATINGS,
        lambda columns: figures.ratings_figure(result, columns),
        f"Ratings {kind}, n = {len(result.people)} participants.",
    )
    left_out = f"Left out, because a rating is missing: {', '.join(result.left_out)}."
    notes = [*([left_out] if result.left_out else []), *result.notes]
    return _answers(f"Ratings{of}", [values], tables, notes, simulated=simulated, figures=[drawing])


def power_contents(found: Sequence[Power]) -> Contents:
    """The power of each effect by number of participants."""
    rows = [(str(one.people), one.effect, percent(one.power), interval(one.interval)) for one in found]
    values = [
        {"participants": one.people, **_fields(one, "effect", "power", "interval", "runs")} for one in found
    ]
    return Contents(
        "",
        [fact(power=values)],
        [Grid("Power by simulation", ("Participants", "Effect", "Power", "Interval of 95 %"), rows)],
        [f"{found[0].runs} simulated experiments each, with answers as the plan assumes them."],
        simulated=True,
        origin="",
    )


def thresholds_contents(
    found: Sequence[Threshold],
    columns: Sequence[str],
    of: Rows,
    lab: LabThreshold | None = None,
    title: str = "",
) -> Contents:
    """Thresholds; `columns` name what tells them apart in the rows that they were fitted to.

    `lab` is what they say of the lab's people.
    """
    rows = [
        (
            *one.who,
            *(
                ("none", "-", "-", "-", "-")
                if one.why_none
                else (
                    f"{one.threshold:.4g}",
                    "{:.4g} to {:.4g}".format(*one.interval),
                    "-" if one.difference is None else f"{one.difference:.4g}",
                    f"{one.width:.3g}",
                    f"{one.lapse:.3f}",
                )
            ),
            str(one.trials),
        )
        for one in found
    ]
    names = ("threshold", "interval", "width", "lapse", "trials", "standard", "difference", "why_none")
    values = [dict(zip(columns, one.who, strict=True)) | _fields(one, *names) for one in found]
    headings = (*columns, "Threshold", "95 %", "Difference", "Width", "Lapse", "Trials")
    known = any(one.standard is not None for one in found)
    note = "Difference: from the standard to the threshold, the just noticeable difference."
    tables = [Grid("Thresholds (75 % right, but for lapses)", headings, rows)]
    none = [
        f"No threshold of {' '.join(one.who) or of.name}: {one.why_none}." for one in found if one.why_none
    ]
    if none and lab is not None:
        none.append(
            f"The lab's threshold is of the other {lab.people}: of people who do not feel the loudest that "
            "was compared it says nothing."
        )
    remarks = [*none, *of.remarks]
    facts = [fact(thresholds=values, notes=remarks), *_lab_facts(lab)]
    return _answers(title, facts, tables, [*([note] if known else []), *remarks], simulated=of.simulated)


def _lab_facts(lab: LabThreshold | None) -> Iterator[Fact]:
    if lab is None:
        return
    yield fact(
        "People of this lab",
        f"{lab.people} feel the {lab.button} button from {abs(lab.shift):.1f} dB "
        f"{'above' if lab.shift >= 0 else 'below'} the table's threshold on (± {lab.uncertainty:.1f} dB), "
        f"with {lab.spread:.1f} dB between people",
        people=plain(asdict(lab)),
    )
    yield fact("For the rig file", people_table(lab).splitlines(), people_toml=people_table(lab))


def _level(by: Sequence[str], key: Sequence[str]) -> str:
    told = ", ".join(f"{column} {value}" for column, value in zip(by, key, strict=True))
    return capital(told)


def _confusion(confusion: Confusion, title: str) -> Grid:
    rows = []
    for name, counts in zip(confusion.classes, confusion.counts, strict=True):
        shares = [_share(confusion.value(one, name), confusion.interval(one, name)) for one in METRICS]
        rows.append((name, *map(str, counts), *shares))
    edges = confusion.overall_interval
    bounds = f" ({interval(edges)})" if edges else ""
    correct = f"Correct: {percent(confusion.overall, 2)}{bounds} of {confusion.counts.sum()} trials."
    headings = ("Presented", *confusion.classes, *(capital(metric) for metric in METRICS))
    return Grid(title, headings, rows, below=correct)


def _share(value: float | None, edges: tuple[float, float] | None) -> str:
    bounds = f" ({100 * edges[0]:.0f} to {100 * edges[1]:.0f})" if edges else ""
    return "not defined" if value is None else f"{percent(value, 2)}{bounds}"


def _effects(effects: Sequence[Effect], title: str) -> Grid:
    headings = ("Effect", "F", "df", "p", "Mauchly p", "ε (GG)", "p (GG)", "η²p (90 %)", "η²G")
    return Grid(title, headings, [tuple(_effect(one)) for one in effects])


def _effect(one: Effect) -> Iterator[str]:
    s, (low, high) = one.sphericity, one.partial_eta_squared_interval
    yield from (one.name, f"{one.f:.2f}", f"{one.df}, {one.error_df}", _p(one.p))
    if s is None:
        yield from 3 * ["-"]
    else:
        yield from (_p(s.mauchly_p), f"{s.greenhouse_geisser:.3f}", _p(s.p_greenhouse_geisser))
    yield f"{one.partial_eta_squared:.3f} ({low:.2f} to {high:.2f})"
    yield f"{one.generalized_eta_squared:.3f}"


def _multivariate(one: MultivariateEffect | None) -> Sequence[str]:
    if one is None:
        return ("too few people", *5 * ["-"])
    eta = f"{one.partial_eta_squared:.3f}"
    return (one.name, f"{one.pillai:.3f}", f"{one.f:.2f}", f"{one.df}, {one.error_df}", _p(one.p), eta)


def _comparisons(some: Sequence[Comparison], title: str, scale: float = 1, unit: str = "") -> Grid:
    rows = []
    for one in some:
        low, high = (scale * bound for bound in one.interval)
        levels, difference = f"{one.first} - {one.second}", f"{scale * one.difference:.2f}{unit}"
        if math.isnan(one.t):  # all people differ alike: no spread to test against
            rows.append((levels, difference, "not defined", str(one.df), "not defined", "not defined"))
            continue
        difference += f" ({low:.2f} to {high:.2f})"
        d = f"{one.d:.2f} ({one.d_interval[0]:.2f} to {one.d_interval[1]:.2f})"
        rows.append((levels, difference, f"{one.t:.2f}", str(one.df), _p(one.p_bonferroni), d))
    return Grid(title, ("Levels", "Difference (95 %)", "t", "df", "p (Bonferroni)", "d (95 %)"), rows)


def _p(value: float) -> str:
    return "< 0.001" if value < 0.001 else f"{value:.3f}"


def _fields(one: Any, *names: str) -> dict[str, Any]:
    return {name: getattr(one, name) for name in names}


def _confusion_values(confusion: Confusion) -> dict[str, Any]:
    def each(what: Callable[[Any, str], Any]) -> dict[str, Any]:
        return {name: {metric: what(metric, name) for metric in METRICS} for name in confusion.classes}

    return {
        "classes": each(confusion.value),
        "overall": confusion.overall,
        "intervals": {
            "of": "participants" if confusion.interval_over_people else "independent trials",
            "classes": each(confusion.interval),
            "overall": confusion.overall_interval,
        },
        "trials": int(confusion.counts.sum()),
        "matrix": confusion.counts,
    }


def _effect_values(effect: Effect) -> dict[str, Any]:
    return {
        "effect": effect.name,
        **_fields(effect, "sum_of_squares", "error_sum_of_squares", "df", "error_df", "f", "p", "sphericity"),
        **_fields(effect, "reported_p", "partial_eta_squared", "generalized_eta_squared"),
        "partial_eta_squared_interval_90": effect.partial_eta_squared_interval,
    }


def _comparison_values(by: Mapping[str, Sequence[Comparison]]) -> dict[str, Any]:
    names = ("first", "second", "difference", "interval", "t", "df", "p", "p_bonferroni", "d", "d_interval")
    return {name: [_fields(one, *names) for one in some] for name, some in by.items()}


def _multivariate_values(one: MultivariateEffect | None) -> dict[str, Any] | None:
    if one is None:
        return None
    return {"effect": one.name, **_fields(one, "pillai", "f", "df", "error_df", "p", "partial_eta_squared")}
