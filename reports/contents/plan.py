"""What a button's plan says: which errors buy which level, and who would feel it."""

from __future__ import annotations

from collections.abc import Iterator

from ...calibration import ButtonPlan, Drift
from .. import figures
from . import words
from .parts import Contents, Drawing, Grid, fact, plain
from .words import fixed, percent, sentence


def plan_contents(plan: ButtonPlan) -> Contents:
    """What a plan says."""
    rows, values = [], []
    for curve in plan.curves:
        for one in curve.offers:
            sensation = plan.sensation(one)
            rows.append(
                (
                    curve.method,
                    curve.patch,
                    percent(one.error),
                    percent(one.drifted),
                    fixed(one.level, 1, "dB"),
                    sensation.answer,
                    fixed(one.scale, 3),
                    fixed(one.peak, 1, "V"),
                )
            )
            values.append(
                {
                    "method": curve.method,
                    "patch": curve.patch,
                    "in_band": curve.in_band,
                    "error": one.error,
                    "drifted_error": one.drifted,
                    "above_threshold_db": one.level,
                    "people": sensation.people,
                    "felt": sensation.answer,
                    "scale": one.scale,
                    "drive_peak_v": one.peak,
                }
            )
    first = plan.sensation(plan.curves[0].offers[0])
    return Contents(
        f"Plan of the {plan.button} button",
        [fact(button=plan.button, offers=plain(values), elsewhere=dict(plan.elsewhere))],
        kind="plan",
        tables=[Grid("", _HEADINGS, rows, below=_EXPLAINED + _chosen(plan))],
        notes=[*_at_other_points(plan), first.reservation],
        simulated=plan.simulated,
        rig=plan.rig,
        figures=[plan_drawing(plan)],
    )


def _chosen(plan: ButtonPlan) -> str:
    """What else a row needs to be chosen, where that is not the default; "" without such rows."""
    methods = {curve.method for curve in plan.curves}
    return " Rows that are broadband need `--method broadband` with it." if "broadband" in methods else ""


def _at_other_points(plan: ButtonPlan) -> Iterator[str]:
    """What other points do in a plan, and how it counts; nothing without them."""
    buttons = [f"the {button} button at point {point}" for point, button in plan.elsewhere if button]
    silent = [point for point, button in plan.elsewhere if not button]
    if buttons:
        yield (
            f"At the same time play {', '.join(buttons)}: errors are those of the worst button, and levels "
            "those of the weakest."
        )
    if silent:
        yield f"Points that are to be silent: {', '.join(silent)}. What moves there counts as error."


def plan_drawing(plan: ButtonPlan) -> Drawing:
    """The figure of a plan."""
    return Drawing(
        "plan",
        "Loudness against likeness",
        words.PLAN,
        [plan],
        lambda some, columns: figures.plan_figure(some, columns),  # noqa: PLW0108 - loads matplotlib
        lambda some: sentence([f"{one.button}, {len(one.curves)} curves" for one in some]),
        identity=(plan.button, plan.rig, plan.curves),
    )


_HEADINGS = ("Method", "Patch", "Error", "Drifted", "Level", "Felt", "Size", "Drive")
_EXPLAINED = (
    "Error: expected as calibrated, before corrections by playing. Drifted: the same if "
    f"the table has drifted by {Drift().common:.0%}, which drives of several patches are planned against. "
    "Level: above the threshold of a finger that presses. Felt: by most people who press. Choose with "
    "`haploop button make --error 5` (of one patch as calibrated, of several drifted) or `--level 10dB`."
)
