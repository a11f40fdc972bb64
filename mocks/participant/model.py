"""What a simulated participant feels: parameters, which a report may know and an analysis does not."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from ...base.bounded import Fraction, Positive, Proportion, Seed
from ...instruments.config import load_model

Spread = Annotated[float, Field(strict=True, ge=0, le=10)]


class _Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class IdentificationModel(_Section):
    """Naming what was presented."""

    answers: dict[str, dict[str, Fraction]] = {}
    """Probability of each answer, by what was presented; for the rest, see `correct`. `haploop experiment
    predict` writes it."""
    correct: dict[str, Proportion] = {"latch": 0.78, "toggle": 0.66, "push": 0.66}
    """Probability of a right answer, of the mean participant, by what was presented."""
    otherwise: Proportion = 0.7
    """The same for anything else that is presented."""
    shift: dict[str, dict[str, float]] = {"confirmation": {"given": 0.8}}
    """Shift of its logit by a level of a factor."""
    confused_with: dict[str, str] = {"toggle": "push", "push": "toggle"}
    """Answer that most errors give."""
    confusion: Proportion = 0.7
    """Fraction of errors that give it."""
    spread: Spread = 0.4
    """Standard deviation of the logit between participants."""


class RatingModel(_Section):
    """Moving sliders. Ratings are log-normal around the middle of the scale, and end where it ends."""

    shift: dict[str, dict[str, dict[str, float]]] = {
        "category": {"digital": {"Unpleasant-Pleasant": 0.25, "Rough-Smooth": 0.25}}
    }
    """Shift of the logarithm by factor, level and adjective pair."""
    spread: Spread = 0.2
    """Standard deviation of the logarithm between participants: how each uses the scale."""
    noise: Spread = 0.2
    """Standard deviation of the logarithm from rating to rating."""


class ComparisonModel(_Section):
    """Telling which of two intervals has more: a Weibull function of the difference."""

    threshold: Positive = 0.2
    """Difference at which 1 - 1/e of the way from chance to certainty is reached."""
    slope: Annotated[float, Field(strict=True, gt=0, le=50)] = 2.0
    lapse: Annotated[float, Field(strict=True, ge=0, le=0.5)] = 0.02
    """Probability of an answer that has nothing to do with the stimulus, times two."""
    spread: Spread = 0.1
    """Standard deviation of the logarithm of the threshold between participants."""


class ParticipantModel(_Section):
    """Parameters of simulated participants. The defaults are near the results of the paper."""

    seed: Seed = 0
    identification: IdentificationModel = IdentificationModel()
    rating: RatingModel = RatingModel()
    comparison: ComparisonModel = ComparisonModel()


def load_participant_model(path: str | Path) -> ParticipantModel:
    """Read and validate a model. Raises ConfigurationError: file, line, key, and what is wrong."""
    absent = f"There is no file {path}: docs/how-to/experiments.md shows a model."
    return load_model(Path(path), ParticipantModel, absent)
