"""`experiment.toml`: factors, blocks, questions and order of an experiment."""

from __future__ import annotations

import hashlib
import math
import re
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from ...base.bounded import Finite, Positive, Seed
from ...base.files import beside
from ...instruments.config import load_model

Kind = Literal["identification", "rating", "two-interval", "staircase"]
BlockOrder = Literal["random", "random-in-repetition", "counterbalanced", "as-listed"]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9 _.-]{0,39}$")]
_RESERVED = {"participant", "group", "day", "block", "trial", "presented", "answered", "correct", "rating"}
_RESERVED |= {"pair", "standard", "comparison", "interval", "time", "simulated", "count", "onset", "duration"}


_MOST_TRIALS = 10_000
"""Trials of a block: more are a mistyped number, and would fill the memory."""


class _Section(BaseModel):
    # The text below a key is its description, which the console's form shows.
    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)


class Factor(_Section):
    """`[[factor]]`: something that differs between sessions or between trials."""

    name: Name
    levels: Annotated[tuple[Name, ...], Field(min_length=2)]
    """Two or more names."""
    varies: Literal["session", "trial"] = "trial"
    """A factor that varies by session is counterbalanced by a Latin square of groups and sessions."""

    @field_validator("levels")
    @classmethod
    def _different(cls, levels: tuple[str, ...]) -> tuple[str, ...]:
        return _unique(levels)


class Comparison(_Section):
    """`[comparison]`: the quantity that is compared in two intervals or in a staircase."""

    name: Name = "level"
    unit: str = ""
    standard: Finite
    """Value in the standard interval; 0 for a detection threshold."""
    levels: tuple[Finite, ...] = ()
    """Values to compare with the standard (two-interval: method of constant stimuli)."""
    start: Finite | None = None
    """First value of a staircase."""
    step: Positive | None = None
    """Step of a staircase; halved at each of the first `halvings` reversals."""
    halvings: Annotated[int, Field(ge=0, le=20)] = 2
    down: Annotated[int, Field(ge=1, le=4)] = 2
    """Right answers in a row before the value goes nearer to the standard (Levitt, 1971)."""
    reversals: Annotated[int, Field(ge=2, le=100)] = 8
    """Reversals after which a staircase ends."""
    max_trials: Annotated[int, Field(ge=2, le=1000)] = 80
    highest: Finite | None = None
    """Bound of the value: a staircase stays between the standard and it."""


class Question(_Section):
    """`[question]`: what a participant is asked in each trial."""

    text: str = ""
    """The question itself."""
    identify: str = ""
    """Factor whose level is to be named (identification)."""
    answers: tuple[Name, ...] = ()
    """Answers to choose from (identification); by default the levels of that factor."""
    pairs: tuple[tuple[Name, Name], ...] = ()
    """Pairs of opposite adjectives (rating)."""
    scale: tuple[Finite, Finite] = (1.0, 101.0)
    """Values at the left and right end of a slider (rating); it starts in the middle."""


class Block(_Section):
    """`[[block]]`: a part of a session."""

    name: Name
    kind: Literal["trials", "presses", "finger"] = "trials"
    """trials: questions. presses: the participant presses physical buttons. finger: finger calibration."""
    text: str = ""
    """What the participant is told when the block begins."""
    repetitions: Annotated[int, Field(ge=1, le=1000)] = 1
    """Of each combination of levels; of each press."""
    order: BlockOrder = "random"
    """counterbalanced: a row of Williams' square, by the participant's place in the design."""
    practice: bool = False
    """True when the answers are not analysed."""
    feedback: bool | dict[str, str] = False
    """Whether the participant is told if an answer was right; or on which level of a session's factor."""


class Surface(_Section):
    """`[surface]`: how the rig plays the digital buttons of `[buttons]`."""

    when: dict[str, str] = {}
    """Levels of factors with which the stimulus is a digital button; by default each is."""
    releases: dict[str, str] = {}
    """Digital button files that are played at a release, by the same names as in `[buttons]`."""
    target: Annotated[float, Field(ge=20e-6, le=1e-3)] = 100e-6
    """Area (m^2) of the target by which the camera is calibrated."""


class ExperimentFile(_Section):
    """A validated experiment file."""

    name: Name
    """Stands in exported tables."""
    title: str = ""
    """Stands in reports."""
    kind: Kind
    """identification: which was it? rating: adjectives. two-interval, staircase: which is stronger?"""
    seed: Seed
    """Seed of random orders and of the assignment to groups."""
    groups: Annotated[tuple[Name, ...], Field(min_length=1)] = ("all",)
    """Participants are assigned to them at random, equally many to each."""
    sessions: Annotated[int, Field(ge=1, le=50)] = 1
    """Sessions of each participant: days, as a rule."""
    consent: bool = True
    """True when the operator must confirm each participant's consent."""
    buttons: dict[str, str] = {}
    """Digital button files, beside this one, by the level of a factor that presents it: the rig plays them.
    Without such a factor it is the one button whose amplitude is compared."""
    surface: Surface = Surface()
    factor: tuple[Factor, ...] = ()
    question: Question = Question()
    comparison: Comparison | None = None
    block: Annotated[tuple[Block, ...], Field(min_length=1)]

    @field_validator("groups")
    @classmethod
    def _groups_differ(cls, groups: tuple[str, ...]) -> tuple[str, ...]:
        return _unique(groups)

    @model_validator(mode="after")
    def _whole(self) -> Self:
        names = _unique(tuple(factor.name for factor in self.factor), "the factor ")
        _unique(tuple(block.name for block in self.block), "the block ")
        for name in names:
            if name in _RESERVED:
                raise ValueError(f"a factor cannot be called {name!r}, because a column of the results is")
        self._square_is_even()
        self._question_fits()
        self._buttons_fit()
        for block in self.block:
            if isinstance(block.feedback, dict):
                for name, level in block.feedback.items():
                    if level not in self.levels_of(name, "session"):
                        raise ValueError(
                            f"feedback of the block {block.name!r} needs a session's factor and its level"
                        )
            self._few_enough(block)
        if not any(block.kind == "trials" for block in self.block):
            raise ValueError("there is no block with trials")
        return self

    def _few_enough(self, block: Block) -> None:
        conditions = math.prod(len(factor.levels) for factor in self.trial_factors)
        if self.comparison and self.kind == "two-interval":
            conditions *= len(self.comparison.levels)
        if block.kind == "trials" and conditions * block.repetitions > _MOST_TRIALS:
            raise ValueError(
                f"the block {block.name!r} has {conditions} conditions in {block.repetitions} repetitions: "
                f"{_MOST_TRIALS} trials are the most"
            )

    def _square_is_even(self) -> None:
        """Each level as often in each session and, over several sessions, for each participant."""
        for factor in self.session_factors:
            count = len(factor.levels)
            if len(self.groups) % count or (self.sessions > 1 and self.sessions % count):
                raise ValueError(
                    f"the factor {factor.name!r} varies by session and has {count} levels, which "
                    f"groups = {len(self.groups)} and sessions = {self.sessions} cannot balance: the "
                    f"number of groups must be a multiple of {count}, and that of several sessions too"
                )
        cells = [
            tuple(factor.levels[(row + session) % len(factor.levels)] for factor in self.session_factors)
            for row in range(len(self.groups))
            for session in range(self.sessions)
        ]
        if len(set(cells)) < math.prod(len(factor.levels) for factor in self.session_factors):
            names = ", ".join(repr(factor.name) for factor in self.session_factors)
            raise ValueError(
                f"the factors {names} vary by session, and change together, so that their effects cannot be "
                "told apart: let one vary by trial, or make an experiment for each"
            )

    def _question_fits(self) -> None:
        match self.kind:
            case "identification":
                levels = self.levels_of(self.question.identify, "trial")
                if not levels:
                    raise ValueError(
                        "an identification needs [question] identify = a factor that varies by trial"
                    )
                if not set(levels) <= set(self.answers):
                    raise ValueError("[question] answers must contain each level that is to be identified")
            case "rating":
                if not self.question.pairs or not self.trial_factors:
                    raise ValueError("a rating needs [question] pairs, and a factor that varies by trial")
                _unique(self.pair_names, "the pair ")
                if self.question.scale[0] >= self.question.scale[1]:
                    raise ValueError("[question] scale must rise")
            case "two-interval" | "staircase":
                if self.comparison is None:
                    raise ValueError(f"the kind {self.kind} needs a table [comparison]")
                if self.kind == "two-interval" and not self.comparison.levels:
                    raise ValueError("[comparison] needs levels, the values to compare with the standard")
                if self.comparison.standard in self.comparison.levels:
                    raise ValueError(
                        "[comparison] levels must differ from the standard: no answer would be right"
                    )
                if self.kind == "staircase":
                    _staircase_fits(self.comparison)

    def _buttons_fit(self) -> None:
        if not self.buttons:
            if self.surface != Surface():
                raise ValueError("[surface] is for digital buttons: list their files in [buttons]")
            return
        for name, level in self.surface.when.items():
            if level not in self.levels_of(name, "trial"):
                raise ValueError("[surface] when needs factors that vary by trial, and a level of each")
        if (
            self.kind in ("two-interval", "staircase")
            and self.comparison
            and (self.comparison.name != "amplitude" or self.comparison.standard < 0)
        ):
            raise ValueError(
                "a rig that plays [buttons] compares their amplitude: [comparison] needs name = 'amplitude', "
                "and values from 0 up, of the verified drive"
            )
        if not self.button_factor and not (len(self.buttons) == 1 and not self.trial_factors):
            raise ValueError("[buttons] needs a file for each level of one factor that varies by trial")
        if not set(self.surface.releases) <= set(self.buttons):
            raise ValueError("[surface] releases must have names of [buttons]")
        if any(block.kind == "finger" and block.repetitions < 2 for block in self.block):
            raise ValueError(
                "a finger calibration needs repetitions = 2 or more: it shows how presses repeat"
            )
        kinds = [block.kind for block in self.block]
        if "finger" not in kinds[: kinds.index("trials") if "trials" in kinds else None]:
            raise ValueError(
                "[buttons] are activated by the contact area of a finger: put a block of the kind 'finger' "
                "before the trials"
            )

    @property
    def button_factor(self) -> str:
        """Factor whose levels are the digital buttons; "" without one."""
        return next((f.name for f in self.trial_factors if set(f.levels) == set(self.buttons)), "")

    def levels_of(self, name: str, varies: str) -> tuple[str, ...]:
        """Levels of a factor; () if there is none of this name that varies so."""
        return next((f.levels for f in self.factor if f.name == name and f.varies == varies), ())

    @property
    def trial_factors(self) -> tuple[Factor, ...]:
        """Factors that vary by trial."""
        return tuple(factor for factor in self.factor if factor.varies == "trial")

    @property
    def session_factors(self) -> tuple[Factor, ...]:
        """Factors that vary by session."""
        return tuple(factor for factor in self.factor if factor.varies == "session")

    @property
    def answers(self) -> tuple[str, ...]:
        """Answers to choose from in an identification."""
        return self.question.answers or self.levels_of(self.question.identify, "trial")

    @property
    def pair_names(self) -> tuple[str, ...]:
        """Names of the adjective pairs, such as Unclear-Clear."""
        return tuple(f"{left}-{right}" for left, right in self.question.pairs)


@dataclass(frozen=True)
class Experiment:
    """An experiment file, where it is, and a hash of what it says."""

    path: Path
    file: ExperimentFile
    content_hash: str
    """SHA-256 of the validated content: comments and layout do not count."""


def load_experiment(path: str | Path) -> Experiment:
    """Load an experiment from a file, a folder with an `experiment.toml`, or the name of a shipped example.

    Raises ConfigurationError: file, line, key, and what is wrong.

    For example:

        >>> from haploop import experiments
        >>> path = experiments.new_experiment("matching", "matching")
        >>> experiments.load_experiment("matching").path.name
        'experiment.toml'
    """
    shipped = str(path) in example_names() and not Path(path).exists()
    path = (
        Path(str(resources.files("haploop.experiments.examples") / f"{path}.toml")) if shipped else Path(path)
    )
    if path.is_dir():
        path = path / "experiment.toml"
    absent = (
        f"There is no experiment {path}: make one with `haploop experiment new FOLDER`, or "
        f"name an example ({', '.join(example_names())})."
    )
    file = load_model(path, ExperimentFile, absent)
    for place in (*file.buttons.values(), *file.surface.releases.values()):
        beside(path.parent, place, str(path))
    return Experiment(path, file, hashlib.sha256(file.model_dump_json().encode()).hexdigest())


def example_names() -> tuple[str, ...]:
    """Names of the experiments that are shipped."""
    folder = resources.files("haploop.experiments.examples")
    return tuple(sorted(re.sub(r"\.toml$", "", f.name) for f in folder.iterdir() if f.name.endswith(".toml")))


def _staircase_fits(comparison: Comparison) -> None:
    if comparison.start is None or comparison.step is None or comparison.highest is None:
        raise ValueError("a staircase needs start, step and highest in [comparison]")
    if not comparison.standard < comparison.start <= comparison.highest:
        raise ValueError("[comparison] needs standard < start <= highest")


def _unique(names: tuple[str, ...], what: str = "") -> tuple[str, ...]:
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"{what}{name!r} is listed twice")
    return names
