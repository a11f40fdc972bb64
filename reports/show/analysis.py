"""What an experiment's analysis says: tables, or one JSON object."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rich.box import SIMPLE
from rich.table import Table

from ...experiments import (
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
)
from ...terminal.progress import print_json, print_line, print_table
from .formatting import ANSWERS_SIMULATED, interval, json_number, percent

__all__ = ["show_identification", "show_power", "show_ratings", "show_thresholds"]


def show_identification(result: Identification, simulated: bool, as_json: bool) -> None:
    """Show confusion matrices with their metrics, and the effects on performance."""
    if as_json:
        print_json(_identification_values(result, simulated))
        return
    for key, confusion in result.matrices.items():
        names = ", ".join(f"{column} {value}" for column, value in zip(result.by, key, strict=True))
        _print_confusion(confusion, names[:1].upper() + names[1:])
    if len(result.matrices) != 1:
        _print_confusion(result.pooled, "All together" if result.matrices else "")
    kind = "over participants" if result.pooled.interval_over_people else "of trials taken as independent"
    print_line(f"Intervals of 95 %, {kind}.")
    for one in result.performance:
        left_out = f"; without {', '.join(one.left_out)}" if one.left_out else ""
        _print_effects(one.effects, f"Effects on {one.metric} ({one.people} participants{left_out})")
        for factor, some in one.comparisons.items():
            _print_comparisons(some, f"{one.metric.capitalize()}: {factor}", percents=True)
    for note in result.notes:
        print_line(note)
    if simulated:
        print_line(ANSWERS_SIMULATED)


def show_ratings(result: Ratings, simulated: bool, as_json: bool) -> None:
    """Show effects on all adjective pairs together and on each, and the comparisons."""
    if as_json:
        print_json(_ratings_values(result, simulated))
        return
    first, second = result.factors
    for title, effects in (
        ("All pairs together, by person (the form to report)", result.repeated),
        ("All pairs together, rows taken as independent (as the paper)", result.independent),
    ):
        if effects:
            table = _table(title, "Effect", "Pillai", "F", "df", "p", "η²p")
            for one in effects:
                if one is None:
                    table.add_row("too few people", *5 * ["-"])
                else:
                    df = f"{one.df}, {one.error_df}"
                    eta = f"{one.partial_eta_squared:.3f}"
                    table.add_row(one.name, f"{one.pillai:.3f}", f"{one.f:.2f}", df, _p(one.p), eta)
            print_table(table)
    kind = "normalised by geometric means" if result.normalised else "as rated"
    for pair in result.pairs:
        table = _table(f"{pair.pair} ({kind}; mean and standard deviation)", first, *result.levels[1])
        for row, level in enumerate(result.levels[0]):
            cells = zip(pair.mean[row], pair.deviation[row], strict=True)
            table.add_row(level, *(f"{mean:.2f} ± {deviation:.2f}" for mean, deviation in cells))
        print_table(table)
        _print_effects(pair.effects, f"Effects on {pair.pair}")
        for label, some in pair.simple.items():
            _print_comparisons(some, f"{pair.pair}: {second} {label}")
    if result.left_out:
        print_line(f"Left out, because a rating is missing: {', '.join(result.left_out)}.")
    for note in result.notes:
        print_line(note)
    if simulated:
        print_line(ANSWERS_SIMULATED)


def show_power(found: Sequence[Power], as_json: bool) -> None:
    """Show the power of each effect by number of participants."""
    if as_json:
        print_json(
            {
                "simulated": True,
                "power": [
                    {
                        "participants": one.people,
                        "effect": one.effect,
                        "power": one.power,
                        "interval": list(one.interval),
                        "runs": one.runs,
                    }
                    for one in found
                ],
            }
        )
        return
    table = _table("Power by simulation", "Participants", "Effect", "Power", "Interval of 95 %")
    for one in found:
        table.add_row(str(one.people), one.effect, percent(one.power), interval(one.interval))
    print_table(table)
    print_line(f"{found[0].runs} simulated experiments each, with answers as the plan assumes them.")


def show_thresholds(found: Sequence[Threshold], columns: Sequence[str], rows: Rows, as_json: bool) -> None:
    """Show thresholds; `columns` name what tells them apart in the `rows` that they were fitted to."""
    if as_json:
        values = [
            {
                **dict(zip(columns, one.who, strict=True)),
                "threshold": one.threshold,
                "interval": list(one.interval),
                "width": one.width,
                "lapse": one.lapse,
                "trials": one.trials,
                "standard": one.standard,
                "difference": one.difference,
            }
            for one in found
        ]
        print_json({"simulated": rows.simulated, "thresholds": values, "notes": list(rows.remarks)})
        return
    title = "Thresholds (75 % right, but for lapses)"
    table = _table(title, *columns, "Threshold", "95 %", "Difference", "Width", "Lapse", "Trials")
    for one in found:
        low, high = one.interval
        edges = f"{low:.4g} to {high:.4g}"
        difference = "-" if one.difference is None else f"{one.difference:.4g}"
        numbers = (f"{one.threshold:.4g}", edges, difference, f"{one.width:.3g}", f"{one.lapse:.3f}")
        table.add_row(*one.who, *numbers, str(one.trials))
    print_table(table)
    if any(one.standard is not None for one in found):
        print_line("Difference: from the standard to the threshold, the just noticeable difference.")
    for note in rows.remarks:
        print_line(note)
    if rows.simulated:
        print_line(ANSWERS_SIMULATED)


def _table(title: str, *columns: str) -> Table:
    table = Table(box=SIMPLE, title=title or None, title_justify="left")
    for index, column in enumerate(columns):
        table.add_column(column, justify="left" if index == 0 else "right")
    return table


def _print_confusion(confusion: Confusion, title: str) -> None:
    table = _table(title, "Presented", *confusion.classes, "Accuracy", "Precision", "Sensitivity")
    for name, row in zip(confusion.classes, confusion.counts, strict=True):
        cells = []
        for metric in METRICS:
            value, edges = confusion.value(metric, name), confusion.interval(metric, name)
            bounds = f" ({100 * edges[0]:.0f} to {100 * edges[1]:.0f})" if edges else ""
            cells.append("not defined" if value is None else f"{100 * value:.2f} %{bounds}")
        table.add_row(name, *(str(count) for count in row), *cells)
    print_table(table)
    edges = confusion.overall_interval
    bounds = f" ({interval(edges)})" if edges else ""
    print_line(f"Correct: {100 * confusion.overall:.2f} %{bounds} of {confusion.counts.sum()} trials.")


def _print_effects(effects: Sequence[Effect], title: str) -> None:
    table = _table(title, "Effect", "F", "df", "p", "Mauchly p", "ε (GG)", "p (GG)", "η²p (90 %)", "η²G")
    for one in effects:
        s, (low, high) = one.sphericity, one.partial_eta_squared_interval
        table.add_row(
            one.name,
            f"{one.f:.2f}",
            f"{one.df}, {one.error_df}",
            _p(one.p),
            *(
                (_p(s.mauchly_p), f"{s.greenhouse_geisser:.3f}", _p(s.p_greenhouse_geisser))
                if s
                else 3 * ["-"]
            ),
            f"{one.partial_eta_squared:.3f} ({low:.2f} to {high:.2f})",
            f"{one.generalized_eta_squared:.3f}",
        )
    print_table(table)


def _print_comparisons(some: Sequence[Comparison], title: str, percents: bool = False) -> None:
    table = _table(title, "Levels", "Difference (95 %)", "t", "df", "p (Bonferroni)", "d (95 %)")
    scale, unit = (100, " %") if percents else (1, "")
    for one in some:
        low, high = (scale * bound for bound in one.interval)
        table.add_row(
            f"{one.first} - {one.second}",
            f"{scale * one.difference:.2f}{unit} ({low:.2f} to {high:.2f})",
            f"{one.t:.2f}",
            str(one.df),
            _p(one.p_bonferroni),
            f"{one.d:.2f} ({one.d_interval[0]:.2f} to {one.d_interval[1]:.2f})",
        )
    print_table(table)


def _p(value: float) -> str:
    return "< 0.001" if value < 0.001 else f"{value:.3f}"


def _identification_values(result: Identification, simulated: bool) -> dict[str, Any]:
    return {
        **_confusion_values(result.pooled),
        "simulated": simulated,
        "matrices": [
            {**dict(zip(result.by, key, strict=True)), **_confusion_values(confusion)}
            for key, confusion in result.matrices.items()
        ],
        "performance": [
            {
                "metric": one.metric,
                "participants": one.people,
                "left_out": list(one.left_out),
                "effects": [_effect_values(effect) for effect in one.effects],
                "comparisons": {
                    factor: [_comparison_values(pair) for pair in some]
                    for factor, some in one.comparisons.items()
                },
            }
            for one in result.performance
        ],
        "notes": list(result.notes),
    }


def _confusion_values(confusion: Confusion) -> dict[str, Any]:
    return {
        "classes": {
            name: {metric: confusion.value(metric, name) for metric in METRICS} for name in confusion.classes
        },
        "overall": confusion.overall,
        "intervals": {
            "of": "participants" if confusion.interval_over_people else "independent trials",
            "classes": {
                name: {metric: _edges(confusion.interval(metric, name)) for metric in METRICS}
                for name in confusion.classes
            },
            "overall": _edges(confusion.overall_interval),
        },
        "trials": int(confusion.counts.sum()),
        "matrix": [[int(count) for count in row] for row in confusion.counts],
    }


def _ratings_values(result: Ratings, simulated: bool) -> dict[str, Any]:
    return {
        "simulated": simulated,
        "factors": list(result.factors),
        "levels": [list(some) for some in result.levels],
        "participants": len(result.people),
        "left_out": list(result.left_out),
        "normalised": result.normalised,
        "manova": {
            "by_person": [_multivariate_values(one) for one in result.repeated],
            "independent_rows": [_multivariate_values(one) for one in result.independent],
        },
        "pairs": [
            {
                "pair": pair.pair,
                "mean": [[float(value) for value in row] for row in pair.mean],
                "standard_deviation": [[float(value) for value in row] for row in pair.deviation],
                "effects": [_effect_values(effect) for effect in pair.effects],
                "comparisons": {
                    name: [_comparison_values(one) for one in some] for name, some in pair.comparisons.items()
                },
                "simple_comparisons": {
                    name: [_comparison_values(one) for one in some] for name, some in pair.simple.items()
                },
            }
            for pair in result.pairs
        ],
        "notes": list(result.notes),
    }


def _edges(edges: tuple[float, float] | None) -> list[float | None] | None:
    return None if edges is None else [json_number(edge) for edge in edges]


def _effect_values(effect: Effect) -> dict[str, Any]:
    s = effect.sphericity
    return {
        "effect": effect.name,
        "sum_of_squares": effect.sum_of_squares,
        "error_sum_of_squares": effect.error_sum_of_squares,
        "df": effect.df,
        "error_df": effect.error_df,
        "f": json_number(effect.f),
        "p": json_number(effect.p),
        "sphericity": s
        and {
            "mauchly_w": s.mauchly_w,
            "mauchly_p": json_number(s.mauchly_p),
            "greenhouse_geisser": s.greenhouse_geisser,
            "p_greenhouse_geisser": json_number(s.p_greenhouse_geisser),
            "huynh_feldt": json_number(s.huynh_feldt),
            "p_huynh_feldt": json_number(s.p_huynh_feldt),
        },
        "reported_p": json_number(effect.reported_p),
        "partial_eta_squared": json_number(effect.partial_eta_squared),
        "partial_eta_squared_interval_90": _edges(effect.partial_eta_squared_interval),
        "generalized_eta_squared": json_number(effect.generalized_eta_squared),
    }


def _comparison_values(one: Comparison) -> dict[str, Any]:
    return {
        "first": one.first,
        "second": one.second,
        "difference": one.difference,
        "interval": _edges(one.interval),
        "t": json_number(one.t),
        "df": one.df,
        "p": json_number(one.p),
        "p_bonferroni": json_number(one.p_bonferroni),
        "d": json_number(one.d),
        "d_interval": _edges(one.d_interval),
    }


def _multivariate_values(one: MultivariateEffect | None) -> dict[str, Any] | None:
    if one is None:
        return None
    return {
        "effect": one.name,
        "pillai": one.pillai,
        "f": json_number(one.f),
        "df": one.df,
        "error_df": one.error_df,
        "p": json_number(one.p),
        "partial_eta_squared": one.partial_eta_squared,
    }
