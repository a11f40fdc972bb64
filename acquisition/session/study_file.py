"""`study.toml`: participants, buttons, order and acceptance limits of a study."""

from __future__ import annotations

import math
import zlib
from dataclasses import fields, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, PlainValidator, ValidationInfo, field_validator

from ...base.bounded import Positive, Seed
from ...base.errors import ConfigurationError
from ...instruments.config import load_model
from ..presses import AverageMethod, Protocol, Segmentation, segmentation_for
from ..recording import file_name

Count = Annotated[int, Field(ge=1, le=1000)]
Order = Literal["counterbalanced", "random", "as-listed"]


def _column(value: Any) -> str | float | bool:
    if isinstance(value, str) and len(value) > 200:
        raise ValueError("a text has at most 200 characters")
    if isinstance(value, str | bool | int) or (isinstance(value, float) and math.isfinite(value)):
        return value
    raise ValueError("a column of a participant is a text, a finite number, true or false")


Column = Annotated[str | float | bool, PlainValidator(_column)]
"""Value of a column that describes a participant."""


_PRESS = ("participant", "button", "number", "of")
"""Placeholders of the prompt for a press."""


class _Section(BaseModel):
    # The text below a key is its description, which the console's form shows.
    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)


class Prompts(_Section):
    """Prompts that replace the default ones; placeholders such as `{participant}` are filled in."""

    consent: str = ""
    """Placeholder: `{participant}`."""
    ready: str = ""
    """Placeholders: `{participant}`, `{button}`, and `{presses}` still due."""
    press: str = ""
    """Placeholders: `{participant}`, `{button}`, `{number}` and `{of}`."""

    @field_validator("consent", "ready", "press")
    @classmethod
    def _can_be_said(cls, words: str, info: ValidationInfo) -> str:
        known = {"consent": ("participant",), "ready": ("participant", "button", "presses"), "press": _PRESS}
        return _fillable(words, known[info.field_name or ""])


class ButtonSettings(_Section):
    """`[button.NAME]`: settings of one button, instead of the study's."""

    presses: Count | None = None
    """Instead of the study's."""
    force: tuple[Positive, Positive] | None = None
    """N, lowest and highest at activation; see `Protocol.force`."""
    prompt: str = ""
    """Prompt for a press of this button; see `Prompts.press`."""
    segmentation: dict[str, Positive] = {}
    """Fields of `Segmentation` that replace the values in `SEGMENTATIONS`."""

    @field_validator("force")
    @classmethod
    def _rising(cls, force: tuple[float, float] | None) -> tuple[float, float] | None:
        if force is not None and force[0] >= force[1]:
            raise ValueError("the lowest force must be below the highest")
        return force

    @field_validator("prompt")
    @classmethod
    def _as_press(cls, prompt: str) -> str:
        return _fillable(prompt, _PRESS)

    @field_validator("segmentation")
    @classmethod
    def _known(cls, segmentation: dict[str, float]) -> dict[str, float]:
        known = {field.name for field in fields(Segmentation)}
        for name in segmentation:
            if name not in known:
                raise ValueError(f"there is no parameter {name!r}; there are {', '.join(sorted(known))}")
        return segmentation


class StudyFile(_Section):
    """A validated study file."""

    name: Annotated[str, Field(min_length=1, max_length=80)]
    rig: str | None = None
    """Rig file beside the study file, or the name of a shipped rig."""
    buttons: Annotated[tuple[str, ...], Field(min_length=1)]
    participants: Annotated[tuple[str, ...], Field(min_length=1)]
    """Pseudonyms. Add new ones at the end; see `order_for`."""
    presses: Count = 10
    """Presses of each button by each participant (ten in the paper)."""
    order: Order = "counterbalanced"
    """Order of the buttons for each participant."""
    seed: Annotated[Seed | None, Field(validate_default=True)] = None
    """Seed of a random order."""
    consent: bool = True
    """True when the operator must confirm each participant's consent."""
    prompts: Prompts = Prompts()
    wait: Annotated[float, Field(ge=0, le=86_400)] = 600.0
    """s: total wait of a session for a participant who is away; see `Protocol.wait`."""
    patience: Annotated[float, Field(gt=0, le=600)] = 15.0
    """s: wait for a press before the prompt is repeated; see `Protocol.patience`."""
    attempts: Annotated[int, Field(ge=1, le=100)] = 5
    """Attempts at one press before a session ends; see `Protocol.attempts`."""
    method: AverageMethod = "automatic"
    """Method of the representative presses; see `representative`."""
    button: dict[str, ButtonSettings] = {}
    participant: dict[str, dict[str, Column]] = {}
    """`[participant.P01]`: columns such as age, sex, handedness; stored in the participant's recordings, and
    never shown to a participant."""

    @field_validator("buttons")
    @classmethod
    def _are_buttons(cls, buttons: tuple[str, ...]) -> tuple[str, ...]:
        for button in buttons:
            _refusal_as_value_error("P1", button)
        return _different(buttons)

    @field_validator("participants")
    @classmethod
    def _are_pseudonyms(cls, participants: tuple[str, ...]) -> tuple[str, ...]:
        for participant in participants:
            _refusal_as_value_error(participant, "button")
        return _different(participants)

    @field_validator("seed")
    @classmethod
    def _of_random_order(cls, seed: int | None, info: ValidationInfo) -> int | None:
        if "order" in info.data and (info.data["order"] == "random") != (seed is not None):
            raise ValueError('a seed is required with order = "random" and not allowed with any other order')
        return seed

    @field_validator("button")
    @classmethod
    def _one_of_them(
        cls, button: dict[str, ButtonSettings], info: ValidationInfo
    ) -> dict[str, ButtonSettings]:
        buttons = info.data.get("buttons", tuple(button))
        for name in button:
            if name not in buttons:
                raise ValueError(f"there is no {name!r} in buttons ({', '.join(buttons)})")
        return button

    @field_validator("participant")
    @classmethod
    def _same_columns(
        cls, participant: dict[str, dict[str, Column]], info: ValidationInfo
    ) -> dict[str, dict[str, Column]]:
        """Every participant who is described has the same columns: a misspelt one would be lost."""
        known = info.data.get("participants", tuple(participant))
        columns = list(next(iter(participant.values()), {}))
        for name, mine in participant.items():
            if name not in known:
                raise ValueError(f"there is no {name!r} in participants ({', '.join(known)})")
            if missing := [column for column in columns if column not in mine]:
                raise ValueError(f"{name} has no {missing[0]!r}, which others have")
            if extra := [column for column in mine if column not in columns]:
                raise ValueError(f"{name} has {extra[0]!r}, which others do not have")
        return participant

    def order_for(self, participant: str) -> tuple[str, ...]:
        """Order of the buttons for a participant.

        Counterbalanced: a row of a Latin square in which each button follows each other one equally often
        (Williams, 1949; two squares for an odd number of buttons), by the participant's place in the list.
        Random: by the seed and the pseudonym. Adding participants at the end changes neither.
        """
        count = len(self.buttons)
        if self.order == "as-listed":
            places = list(range(count))
        elif self.order == "random":
            rng = np.random.default_rng([self.seed or 0, zlib.crc32(participant.encode())])
            places = [int(place) for place in rng.permutation(count)]
        else:
            places = williams_row(count, self.participants.index(participant))
        return tuple(self.buttons[place] for place in places)

    def presses_of(self, button: str) -> int:
        """Number of presses of a button by each participant."""
        return self._settings_of(button).presses or self.presses

    def prompt_for(self, button: str) -> str:
        """Prompt for each press; "" for the default one."""
        return self._settings_of(button).prompt or self.prompts.press

    def protocol_for(self, button: str) -> Protocol:
        """Protocol for a button: timing of the prompts, acceptance limits, segmentation."""
        settings = self._settings_of(button)
        segmentation = replace(segmentation_for(button), **settings.segmentation)
        return Protocol(
            wait=self.wait,
            patience=self.patience,
            attempts=self.attempts,
            force=settings.force,
            segmentation=segmentation,
        )

    def _settings_of(self, button: str) -> ButtonSettings:
        return self.button.get(button, ButtonSettings())


def load_study_file(path: str | Path) -> StudyFile:
    """Read and validate a study file. Raises ConfigurationError: file, line, key, and what is wrong."""
    absent = f"There is no study file {path}: create a study with `haploop study new FOLDER`."
    return load_model(Path(path), StudyFile, absent)


def _refusal_as_value_error(participant: str, button: str) -> None:
    # Names in a study become file names, so the rule of `file_name` applies.
    try:
        file_name(participant, button)
    except ConfigurationError as error:
        raise ValueError(str(error).rstrip(".")) from None


def _fillable(words: str, names: tuple[str, ...]) -> str:
    """Return the prompt; raises ValueError for a placeholder that is not among `names`."""
    try:
        words.format(**dict.fromkeys(names, 1))
    except (LookupError, AttributeError, ValueError):
        allowed = ", ".join(f"{{{name}}}" for name in names)
        raise ValueError(f"{words!r} may contain only these placeholders: {allowed}") from None
    return words


def _different(names: tuple[str, ...]) -> tuple[str, ...]:
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise ValueError(f"{twice[0]} is listed twice")
    # P01-latch.h5 and p01-latch.h5 are the same file on a case-insensitive disk.
    folded = [name.casefold() for name in names]
    alike = [name for name in names if folded.count(name.casefold()) > 1]
    if alike:
        raise ValueError(f"{' and '.join(alike)} differ only in upper and lower case")
    return names


def williams_row(count: int, index: int) -> list[int]:
    """Row of Williams' design: 0, 1, n-1, 2, n-2, ... shifted by one a row; then reversed rows for odd n."""
    first = [(place + 1) // 2 if place % 2 else (count - place // 2) % count for place in range(count)]
    rows = count if count % 2 == 0 else 2 * count
    index %= rows
    row = [(place + index) % count for place in first]
    return row if index < count else row[::-1]
