"""Simulated people: the operator, who acts on the plant, and participants, whose answers a model draws."""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Protocol

import numpy as np
from pydantic import BaseModel, Field

from ..base.bounded import Fraction, Positive, Proportion, Seed, Strict
from ..instruments.config import load_model
from ..instruments.operator import (
    Aim,
    Cable,
    ConfirmSettings,
    LiftFinger,
    Operator,
    Place,
    Press,
    Remove,
    Request,
    RestFinger,
    TakeTarget,
    Target,
    Touch,
    Uncable,
)
from .plant import Plant


class OperatorTwin(Operator):
    """Simulated operator: follows every request, and confirms the instruments' settings truthfully."""

    def __init__(self, settings: BaseModel, plant: Plant) -> None:
        self._plant = plant

    def tell(self, request: Request) -> None:
        """See `Operator.tell`."""
        self.confirm(request)

    def confirm(self, request: Request) -> bool:
        """See `Operator.confirm`."""
        if isinstance(request, ConfirmSettings):
            return self._plant.set_as_filed
        self._follow(request)
        return True

    def _follow(self, request: Request) -> None:
        match request:
            case Press():
                self._plant.press(request)
            case Touch():
                self._plant.touch(request)
            case RestFinger():
                self._plant.rest(request)
            case LiftFinger():
                self._plant.lift()
            case Aim():
                self._plant.aim(request.point)
            case Place():
                self._plant.put(request.mass)
            case Remove():
                self._plant.put(0.0)
            case Target():
                self._plant.target = request.area
            case TakeTarget():
                self._plant.target = 0.0
            case Cable():
                self._plant.cables[request.channel] = request.output
            case Uncable():
                self._plant.cables.clear()


# A simulated participant: what it feels, and how it answers each step, reproducibly.

Spread = Annotated[float, Field(strict=True, ge=0, le=10)]


class IdentificationModel(Strict):
    """Naming what was presented."""

    answers: Mapping[str, dict[str, Fraction]] = {}
    """Probability of each answer, by what was presented; for the rest, see `correct`. `haploop experiment
    predict` writes it."""
    correct: Mapping[str, Proportion] = {"latch": 0.78, "toggle": 0.66, "push": 0.66}
    """Probability of a right answer, of the mean participant, by what was presented."""
    otherwise: Proportion = 0.7
    """The same for anything else that is presented."""
    shift: Mapping[str, dict[str, float]] = {"confirmation": {"given": 0.8}}
    """Shift of its logit by a level of a factor."""
    confused_with: Mapping[str, str] = {"toggle": "push", "push": "toggle"}
    """Answer that most errors give."""
    confusion: Proportion = 0.7
    """Fraction of errors that give it."""
    spread: Spread = 0.4
    """Standard deviation of the logit between participants."""


class RatingModel(Strict):
    """Moving sliders. Ratings are log-normal around the middle of the scale, and end where it ends."""

    shift: Mapping[str, dict[str, dict[str, float]]] = {
        "category": {"digital": {"Unpleasant-Pleasant": 0.25, "Rough-Smooth": 0.25}}
    }
    """Shift of the logarithm by factor, level and adjective pair."""
    spread: Spread = 0.2
    """Standard deviation of the logarithm between participants: how each uses the scale."""
    noise: Spread = 0.2
    """Standard deviation of the logarithm from rating to rating."""


class ComparisonModel(Strict):
    """Telling which of two intervals has more: a Weibull function of the difference."""

    threshold: Positive = 0.2
    """Difference at which 1 - 1/e of the way from chance to certainty is reached."""
    slope: Annotated[float, Field(strict=True, gt=0, le=50)] = 2.0
    lapse: Annotated[float, Field(strict=True, ge=0, le=0.5)] = 0.02
    """Probability of an answer that has nothing to do with the stimulus, times two."""
    spread: Spread = 0.1
    """Standard deviation of the logarithm of the threshold between participants."""


class ParticipantModel(Strict):
    """Parameters of simulated participants. The defaults are near the results of the paper."""

    seed: Seed = 0
    identification: IdentificationModel = IdentificationModel()
    rating: RatingModel = RatingModel()
    comparison: ComparisonModel = ComparisonModel()


def load_participant_model(path: str | Path) -> ParticipantModel:
    """Read and validate a model. Raises ConfigurationError: file, line, key, and what is wrong."""
    absent = f"There is no file {path}: docs/how-to/experiments.md shows a model."
    return load_model(Path(path), ParticipantModel, absent)


_LEAST = 1e-4
"""Least probability of an answer: a logit is finite."""
_PER_SCALE = 2.0
"""s from one scale to the next: an estimate."""


class _Step(Protocol):
    """What is read of a step (`haploop.experiments.Step`), which stands above this room."""

    @property
    def kind(self) -> str: ...
    @property
    def block(self) -> str: ...
    @property
    def number(self) -> int: ...
    @property
    def stimulus(self) -> Mapping[str, str]: ...
    @property
    def presented(self) -> str: ...
    @property
    def choices(self) -> tuple[str, ...]: ...
    @property
    def values(self) -> tuple[float, float]: ...


class SimulatedParticipant:
    """Answers as a person with a psychometric model would.

    What is drawn depends on the model's seed, the participant, the session and the step only: a session that
    is interrupted and resumed has the same answers as one that is not.
    """

    def __init__(self, model: ParticipantModel, participant: str, session: int) -> None:
        self._model, self._session = model, session
        self._who = zlib.crc32(participant.encode())
        person = np.random.default_rng([model.seed, self._who])
        self._ability, self._scale, self._threshold = (float(one) for one in person.normal(size=3))

    def answer(self, step: _Step) -> Any:
        """Answer a step."""
        rng = np.random.default_rng(
            [self._model.seed, self._who, self._session, zlib.crc32(step.block.encode()), step.number]
        )
        match step.kind:
            case "identification":
                return self._identify(step, rng)
            case "rating":
                return self._rate(step, rng)
            case "two-interval" | "staircase":
                return self._compare(step, rng)
            case _:
                return "done"

    def told(self, step: _Step, right: bool) -> None:
        """Do nothing: what confirmation changes is a shift of the model."""

    def _identify(self, step: _Step, rng: np.random.Generator) -> str:
        model = self._model.identification
        predicted = model.answers.get(step.presented, {})
        p = predicted.get(step.presented, model.correct.get(step.presented, model.otherwise))
        p = min(max(p, _LEAST), 1 - _LEAST)
        logit = math.log(p / (1 - p)) + model.spread * self._ability
        logit += sum(model.shift.get(name, {}).get(level, 0.0) for name, level in step.stimulus.items())
        if rng.random() < 1 / (1 + math.exp(-logit)):
            return step.presented
        wrong = [name for name in step.choices if name != step.presented]
        shares = [predicted.get(name, 0.0) for name in wrong]
        if sum(shares) > 0:
            return wrong[int(np.searchsorted(np.cumsum(shares), rng.random() * sum(shares)))]
        near = model.confused_with.get(step.presented)
        if near in wrong and rng.random() < model.confusion:
            return near
        rest = [name for name in wrong if name != near] or wrong
        return rest[int(rng.integers(len(rest)))]

    def _rate(self, step: _Step, rng: np.random.Generator) -> dict[str, Any]:
        """Touch each scale once, one after the other."""
        model, (low, high) = self._model.rating, step.values
        ratings = {}
        for number, pair in enumerate(step.choices, 1):
            shift = sum(
                model.shift.get(name, {}).get(level, {}).get(pair, 0.0)
                for name, level in step.stimulus.items()
            )
            factor = math.exp(shift + model.spread * self._scale + model.noise * float(rng.normal()))
            value = float(np.clip(round((low + high) / 2 * factor), low, high))
            ratings[pair] = {"value": value, "touched": [_PER_SCALE * number]}
        return ratings

    def _compare(self, step: _Step, rng: np.random.Generator) -> int:
        model, (first, second) = self._model.comparison, step.values
        threshold = model.threshold * math.exp(model.spread * self._threshold)
        seen = 1 - math.exp(-((abs(first - second) / threshold) ** model.slope))
        right = rng.random() < 0.5 + (0.5 - model.lapse) * seen
        return (1 if first > second else 2) if right else (2 if first > second else 1)
