"""What comes next in a session: a pure function of the experiment, the participant and the answers so far.

Nothing is drawn while a session runs, so that a session that was interrupted continues with the very trial,
and its log suffices to repeat every decision. So a design's balance is known before anybody takes part.
"""

from __future__ import annotations

import itertools
import math
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import lcm
from typing import Any, Literal

import numpy as np

from ...acquisition import williams_row
from ...base.errors import DataError
from .experiment_file import Block, Comparison, ExperimentFile
from .rating import Rated, rated

Answer = str | int | Mapping[str, Rated]
"""A name (identification), 1 or 2 (two intervals), what was set for each pair (rating), or "done"."""


@dataclass(frozen=True)
class Assignment:
    """Who takes part, and which order that gives."""

    participant: str
    slot: int
    """Place in the design, from 0: it gives the group and the row of counterbalanced orders."""
    group: str
    session: int
    """From 1."""


@dataclass(frozen=True)
class Step:
    """One thing to do: a trial, presses of a physical button, or a press of the finger calibration."""

    kind: Literal["identification", "rating", "two-interval", "staircase", "presses", "finger"]
    block: str
    number: int
    """In its block, from 1."""
    of: int
    """Steps of the block; the largest possible number for a staircase."""
    practice: bool
    feedback: bool
    text: str
    stimulus: Mapping[str, str] = field(default_factory=dict)
    """Level of each factor that varies by trial, and of those of the session."""
    presented: str = ""
    """Level that is to be identified."""
    choices: tuple[str, ...] = ()
    """Answers to choose from, or the names of the adjective pairs."""
    values: tuple[float, float] = (0.0, 0.0)
    """Of two intervals: the value in each; of a rating: the ends of the scale."""
    repetitions: int = 1
    """Of presses of a physical button."""

    @property
    def by_hand(self) -> bool:
        """True for presses and the finger calibration, which are done and not answered."""
        return self.kind in ("presses", "finger")

    @property
    def compares(self) -> bool:
        """True for two intervals, each with a value of its own."""
        return self.kind in ("two-interval", "staircase")

    @property
    def analysed(self) -> bool:
        """False for practice, and for what is done by hand: no analysis takes their answers."""
        return not (self.practice or self.by_hand)


def digital_button(file: ExperimentFile, step: Step) -> str:
    """Name of the digital button that the rig plays in a step; "" when it plays none."""
    if not file.buttons or step.by_hand:
        return ""
    if any(step.stimulus[factor] != level for factor, level in file.surface.when.items()):
        return ""
    return step.stimulus[file.button_factor] if file.button_factor else next(iter(file.buttons))


def played_by_rig(file: ExperimentFile, step: Step) -> bool:
    """Whether a rig has a part in a step: it measures the finger, or plays a digital button."""
    return bool(file.buttons) and (step.kind == "finger" or bool(digital_button(file, step)))


def group_of_slot(file: ExperimentFile, slot: int) -> str:
    """Group of a place in the design: random, and balanced in each block of as many places as groups."""
    count = len(file.groups)
    order = np.random.default_rng([file.seed, 7, slot // count]).permutation(count)
    return file.groups[int(order[slot % count])]


def session_levels(file: ExperimentFile, assignment: Assignment) -> dict[str, str]:
    """Level of each factor that varies by session: a cyclic Latin square of groups and sessions."""
    row = file.groups.index(assignment.group)
    return {
        factor.name: factor.levels[(row + assignment.session - 1) % len(factor.levels)]
        for factor in file.session_factors
    }


class Course:
    """The steps of one session. See the module."""

    def __init__(self, file: ExperimentFile, assignment: Assignment) -> None:
        self._file, self._assignment = file, assignment
        self._fixed = [
            () if self._adaptive(block) else _steps(_Part(file, block, index, assignment))
            for index, block in enumerate(file.block)
        ]

    def due(self, answers: Sequence[tuple[Step, Answer]]) -> Step | None:
        """The step that is due after these answers, in order; None when the session is complete."""
        rest = list(answers)
        for index, block in enumerate(self._file.block):
            if self._adaptive(block):
                own = [one for one in rest if one[0].block == block.name]
                if step := _staircase_step(_Part(self._file, block, index, self._assignment), own):
                    return step
                rest = rest[len(own) :]
            else:
                if len(rest) < len(self._fixed[index]):
                    return self._fixed[index][len(rest)]
                rest = rest[len(self._fixed[index]) :]
        return None

    def firsts(self) -> list[Step]:
        """The first step of each block, which says how many follow."""
        found = [
            _staircase_step(_Part(self._file, block, index, self._assignment), [])
            if self._adaptive(block)
            else next(iter(self._fixed[index]), None)
            for index, block in enumerate(self._file.block)
        ]
        return [step for step in found if step is not None]

    def _adaptive(self, block: Block) -> bool:
        return block.kind == "trials" and self._file.kind == "staircase"


def right_answer(step: Step) -> Answer | None:
    """The right answer of a step that has one."""
    match step.kind:
        case "identification":
            return step.presented
        case "two-interval" | "staircase":
            return 1 if step.values[0] > step.values[1] else 2
        case _:
            return None


def valid(step: Step, answer: Any) -> Answer:
    """An answer as it is stored. Raises DataError, with what is expected."""
    match step.kind:
        case "identification":
            if isinstance(answer, str) and answer in step.choices:
                return answer
            expected = f"one of {', '.join(step.choices)}"
        case "two-interval" | "staircase":
            if answer in (1, 2) and not isinstance(answer, bool):
                return int(answer)
            expected = "1 or 2"
        case "rating":
            found = rated(step.choices, step.values, answer)
            if not isinstance(found, str):
                return found
            expected = found
        case _:
            if answer == "done":
                return "done"
            expected = "done"
    raise DataError(f"{answer!r} is no answer in the block {step.block!r}: give {expected}.")


@dataclass(frozen=True)
class _Part:
    """A block of an experiment, the `index`-th, as one participant has it in one session."""

    file: ExperimentFile
    block: Block
    index: int
    assignment: Assignment

    def rng(self, purpose: int) -> np.random.Generator:
        """Random numbers that depend on the seed, the pseudonym and the session only."""
        who = zlib.crc32(self.assignment.participant.encode())
        return np.random.default_rng([self.file.seed, who, self.assignment.session, self.index, purpose])

    def order(self, count: int, repetitions: int = 1) -> list[int]:
        """Order in which `count` things are presented."""
        rng = self.rng(0)
        match self.block.order:
            case "as-listed":
                return list(range(count)) * repetitions
            case "counterbalanced":
                return williams_row(count, self.assignment.slot) * repetitions
            case "random-in-repetition":
                return [int(place) for _ in range(repetitions) for place in rng.permutation(count)]
            case "random":
                return [int(place) % count for place in rng.permutation(count * repetitions)]

    def cells(self) -> list[dict[str, str]]:
        """Every combination of the levels of the factors that vary by trial."""
        factors = self.file.trial_factors
        return [
            dict(zip((factor.name for factor in factors), levels, strict=True))
            for levels in itertools.product(*(factor.levels for factor in factors))
        ]


def _steps(part: _Part) -> tuple[Step, ...]:
    file, block = part.file, part.block
    match block.kind:
        case "presses":
            names = _pressed(file)
            order = part.order(len(names))
            factor = file.question.identify or (file.trial_factors[-1].name if names else "")
            stimuli = [{factor: names[place]} for place in order]
            return tuple(
                Step(
                    "presses", block.name, n, len(names), True, False, block.text, stimulus,
                    repetitions=block.repetitions,
                )
                for n, stimulus in enumerate(stimuli, 1)
            )  # fmt: skip
        case "finger":
            kinds = ["light"] * block.repetitions + ["firm"] * block.repetitions
            return tuple(
                Step("finger", block.name, n, len(kinds), True, False, block.text, {"press": kind})
                for n, kind in enumerate(kinds, 1)
            )
        case "trials":
            return tuple(_trials(part))


def counterbalanced_count(file: ExperimentFile, block: Block) -> int:
    """Number of things that a block presents in a counterbalanced order; 0 without such an order."""
    if block.order != "counterbalanced" or block.kind == "finger":
        return 0
    if block.kind == "presses":
        return len(_pressed(file))
    count = math.prod(len(factor.levels) for factor in file.trial_factors)
    levels = file.comparison.levels if file.kind == "two-interval" and file.comparison else ()
    return count * max(1, len(levels))


def _pressed(file: ExperimentFile) -> tuple[str, ...]:
    """Names of the physical buttons of a block of presses."""
    if file.kind == "identification":
        return file.levels_of(file.question.identify, "trial")
    return file.trial_factors[-1].levels if file.trial_factors else ()


def _trials(part: _Part) -> list[Step]:
    file, cells = part.file, part.cells()
    levels: Sequence[float | None] = [None]
    if file.kind == "two-interval" and file.comparison:
        levels = file.comparison.levels
    conditions = list(itertools.product(cells, levels))
    places = part.order(len(conditions), part.block.repetitions)
    rng = part.rng(1)
    steps = []
    for number, place in enumerate(places, 1):
        cell, level = conditions[place]
        values = (0.0, 0.0)
        if level is not None and file.comparison:
            values = _intervals(file.comparison, level, first=bool(rng.integers(2)))
        steps.append(_trial(part, (number, len(places)), cell, values))
    return steps


def _trial(
    part: _Part, number: tuple[int, int], cell: Mapping[str, str], values: tuple[float, float]
) -> Step:
    """The trial of this number, of so many."""
    file, block = part.file, part.block
    of_session = session_levels(file, part.assignment)
    stimulus = {**of_session, **cell}
    presented = ""
    choices: tuple[str, ...] = ("1", "2")
    if file.kind == "identification":
        presented, choices = cell[file.question.identify], file.answers
    elif file.kind == "rating":
        choices, values = file.pair_names, file.question.scale
    feedback = block.feedback
    if isinstance(feedback, dict):
        feedback = all(of_session.get(name) == level for name, level in feedback.items())
    return Step(
        kind=file.kind,
        block=block.name,
        number=number[0],
        of=number[1],
        practice=block.practice,
        feedback=feedback,
        text=file.question.text,
        stimulus=stimulus,
        presented=presented,
        choices=choices,
        values=values,
    )


def _intervals(comparison: Comparison, level: float, first: bool) -> tuple[float, float]:
    return (level, comparison.standard) if first else (comparison.standard, level)


def _staircase_step(part: _Part, answers: Sequence[tuple[Step, Answer]]) -> Step | None:
    """One staircase for each combination of levels, one after the other in the block's order."""
    comparison = part.file.comparison
    assert comparison is not None
    cells = part.cells()
    places = part.order(len(cells), part.block.repetitions)
    sides = part.rng(2).integers(2, size=len(places) * comparison.max_trials)
    used = 0
    for place in places:
        right: list[bool] = []
        while True:
            value = staircase_value(comparison, right)
            if value is None:
                break
            if used == len(answers):
                values = _intervals(comparison, value, first=bool(sides[used]))
                return _trial(part, (used + 1, len(places) * comparison.max_trials), cells[place], values)
            step, answer = answers[used]
            right.append(answer == right_answer(step))
            used += 1
    return None


def staircase_value(comparison: Comparison, right: Sequence[bool]) -> float | None:
    """Value of the next trial of a staircase after these answers; None when it is complete.

    Transformed up-down method (Levitt, 1971): after `down` right answers in a row the value goes a step
    nearer to the standard, after each wrong one a step away from it.
    """
    assert comparison.start is not None and comparison.step is not None and comparison.highest is not None
    value, step = comparison.start, comparison.step
    floor = comparison.standard + step / 2 ** (comparison.halvings + 1)
    in_a_row = reversals = direction = 0
    for was_right in right:
        in_a_row = in_a_row + 1 if was_right else 0
        move = -1 if in_a_row == comparison.down else (0 if was_right else 1)
        if not move:
            continue
        in_a_row = 0
        if direction and move != direction:
            reversals += 1
            if reversals <= comparison.halvings:
                step /= 2
        direction = move
        value = min(max(value + move * step, floor), comparison.highest)
    complete = reversals >= comparison.reversals or len(right) >= comparison.max_trials
    return None if complete else value


@dataclass(frozen=True)
class Balance:
    """How the participants so far fill the design."""

    groups: Mapping[str, int]
    """Participants in each group."""
    balanced: bool
    """True when groups are equally large and each counterbalanced order is used equally often."""
    multiple_of: int
    """A number of participants that is balanced is a multiple of this."""


def balance_of(file: ExperimentFile, slots: Sequence[int]) -> Balance:
    """Balance of the participants that have these places in the design."""
    groups = Counter(group_of_slot(file, slot) for slot in slots)
    counts = [counterbalanced_count(file, block) for block in file.block]
    orders = [Counter(tuple(williams_row(count, slot)) for slot in slots) for count in counts if count]
    numbers = [_orders(count) for count in counts if count]
    used = [[groups[name] for name in file.groups]]
    used += [[*some.values(), *[0] * (n - len(some))] for some, n in zip(orders, numbers, strict=True)]
    return Balance(
        {name: groups[name] for name in file.groups},
        all(len(set(some)) == 1 for some in used),
        lcm(len(file.groups), *numbers),
    )


def _orders(count: int) -> int:
    """Number of different rows of the square: Williams' design needs twice as many for an odd count."""
    return len({tuple(williams_row(count, row)) for row in range(2 * count)})
