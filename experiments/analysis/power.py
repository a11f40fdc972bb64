"""Power of a planned identification experiment, by simulating and analysing it many times."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, field_validator

from ...base.arrays import FloatArray
from ...base.bounded import Proportion, Strict
from ...base.errors import DataError
from ...base.progress import Progress, silent
from ...instruments.config import load_model
from .anova import anova
from .identification import Interval, wilson_interval


class PowerPlan(Strict):
    """A planned experiment: expected fractions of right answers, and how much people differ.

    People answer independently from trial to trial, with fractions whose logits differ between people by
    `spread` (standard deviation) in general, and by `interaction` in each cell.
    """

    people: Annotated[tuple[Annotated[int, Field(ge=2, le=10_000)], ...], Field(min_length=1)]
    """Numbers of participants to try, in all; the groups are as equal as possible."""
    trials: Annotated[int, Field(ge=1, le=100_000)]
    """Trials of each class in each session."""
    spread: Annotated[float, Field(ge=0, le=10)] = 0.5
    interaction: Annotated[float, Field(ge=0, le=10)] = 0.3
    alpha: Proportion = 0.05
    within: str = "confirmation"
    between: str = "group"
    correct: Annotated[dict[str, dict[str, dict[str, Proportion]]], Field(min_length=1)]
    """Expected fractions of right answers: [correct.GROUP.SESSION] with one key for each class."""

    @field_validator("correct")
    @classmethod
    def _crossed(
        cls, correct: dict[str, dict[str, dict[str, float]]]
    ) -> dict[str, dict[str, dict[str, float]]]:
        tables = [
            (group, level, classes) for group, some in correct.items() for level, classes in some.items()
        ]
        levels = {tuple(some) for some in correct.values()}
        classes = {tuple(some) for _, _, some in tables}
        if len(levels) != 1 or len(classes) != 1:
            raise ValueError(
                "each group needs the same sessions, and each session the same classes, in the same order"
            )
        if len(next(iter(levels))) < 2 or len(next(iter(classes))) < 2:
            raise ValueError("there must be two sessions and two classes, or more")
        return correct


@dataclass(frozen=True)
class Power:
    """Power of one effect with a number of participants."""

    people: int
    effect: str
    power: float
    """Fraction of the simulated experiments in which the effect is significant."""
    interval: Interval
    """95 %, of the simulation."""
    runs: int


def load_power_plan(path: str | Path) -> PowerPlan:
    """Read and validate a plan. Raises ConfigurationError: file, line, key, and what is wrong."""
    return load_model(
        Path(path), PowerPlan, f"There is no file {path}: docs/how-to/experiments.md shows a plan."
    )


def power_of(
    plan: PowerPlan, runs: int = 500, seed: int = 0, progress: Progress = silent
) -> tuple[Power, ...]:
    """Simulate a plan `runs` times for each number of participants; analyse fractions of right answers.

    The analysis is that of `haploop analyse confusion`: p by Greenhouse and Geisser where Mauchly's test
    rejects sphericity. An experiment in which nothing varies counts as not significant. Raises DataError for
    too few participants.
    """
    found: list[Power] = []
    logits = _logits(plan)
    groups = len(plan.correct)
    for number in plan.people:
        if number < groups + 2:
            raise DataError(
                f"{number} participants in {groups} groups are too few: plan {groups + 2} at least."
            )
        rng = np.random.default_rng([seed, number])
        of_person = np.arange(number) % groups
        hits: dict[str, int] = {}
        for run in range(runs):
            for effect, p in _run(plan, logits[of_person], of_person, rng).items():
                hits[effect] = hits.get(effect, 0) + (p < plan.alpha)
            progress(f"{number} participants", run + 1, runs, "runs")
        for effect, count in hits.items():
            interval = wilson_interval(count, runs)
            assert interval is not None
            found.append(Power(number, effect, count / runs, interval, runs))
    return tuple(found)


def _logits(plan: PowerPlan) -> FloatArray:
    p = np.array(
        [[list(classes.values()) for classes in sessions.values()] for sessions in plan.correct.values()]
    )
    return np.asarray(np.log(p / (1 - p)))


def _run(
    plan: PowerPlan, logits: FloatArray, of_person: Any, rng: np.random.Generator
) -> Mapping[str, float]:
    people = len(logits)
    logits = logits + plan.spread * rng.normal(size=(people, 1, 1))
    logits = logits + plan.interaction * rng.normal(size=logits.shape)
    right = rng.binomial(plan.trials, 1 / (1 + np.exp(-logits))) / plan.trials
    between = plan.between if len(plan.correct) > 1 else ""
    try:
        effects = anova(right, (plan.within, "class"), of_person if between else (), between)
    except DataError:
        return {}
    return {effect.name: effect.reported_p for effect in effects}
