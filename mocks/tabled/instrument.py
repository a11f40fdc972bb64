"""An instrument that a table describes: which command it answers how, and what it keeps.

    [answers]
    "*IDN?" = "ACME,PSU,1,1.0"
    "VOLT {volt}" = ""              # sets the state, and is not answered
    "VOLT?" = "{volt:.3f}"
    [state]
    volt = { value = 0.0, min = 0, max = 30 }

`{name}` in a command is a value of the state's kind; in an answer it is the state, in Python's format. Other
braces are text. A list of answers is given in turn, its last one again and again.
"""

from __future__ import annotations

import re
import threading
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, StrictBool, StrictFloat, StrictInt, StrictStr

from ...base.errors import ConfigurationError
from ...base.near_words import did_you_mean
from ...base.toml_lines import key_lines, parse_toml, place, read_text
from ...base.validation import validate
from ..transport import ReplyFault

Value = bool | int | float | str

_PLACE = re.compile(r"\{([A-Za-z_]\w*)(?::([^{}]*))?\}")
_SWITCH = {"1": True, "ON": True, "TRUE": True, "0": False, "OFF": False, "FALSE": False}


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Kept(_Model):
    """A value that the instrument keeps, and its limits."""

    value: StrictBool | StrictInt | StrictFloat | StrictStr
    min: StrictInt | StrictFloat | None = None
    max: StrictInt | StrictFloat | None = None


class Table(_Model):
    """What an instrument answers. See the module."""

    answers: dict[str, str | list[str]]
    state: dict[str, StrictBool | StrictInt | StrictFloat | StrictStr | Kept] = {}
    error: str | None = None
    """Answer to a command that the table does not have, and to a value that does not fit; without it, none,
    and the command is one of `Instrument.unknown`."""
    end: str = "\n"
    """End of a command and of an answer, on serial lines and sockets."""


class Instrument:
    """An instrument of a table. Any thread may call it."""

    def __init__(self, table: Table, place: str = "the table") -> None:
        """Raises ConfigurationError for a table that contradicts itself."""
        self.table = table
        self.received: list[str] = []
        """Every command, in the order of its coming, without its end."""
        self.unknown: list[str] = []
        """Commands that were not understood."""
        self.state: dict[str, Value] = {}
        """What it keeps now; a test may change it."""
        self.faults: list[ReplyFault] = []
        """Faults of its line."""
        self._limits: dict[str, Kept] = {}
        self._turns: dict[str, int] = {}
        self._lock = threading.Lock()
        for name, kept in table.state.items():
            one = kept if isinstance(kept, Kept) else Kept(value=kept)
            self.state[name], self._limits[name] = one.value, one
        self._commands = {_pattern(command, self.state, place): command for command in table.answers}
        for command, answers in table.answers.items():
            for answer in [answers] if isinstance(answers, str) else answers:
                self._said(answer, f"{place}: the answer to {command!r}")
            if not answers and not isinstance(answers, str):
                raise ConfigurationError(f'{place}: {command!r} has no answer: write "" for none.')

    def answer(self, command: str) -> str | None:
        """Return the answer to a command: empty for none, None for one that is not understood."""
        with self._lock:
            self.received.append(command)
            for pattern, known in self._commands.items():
                found = pattern.fullmatch(command.strip())
                if found is not None:
                    new = {name: _value(text, self._limits[name]) for name, text in found.groupdict().items()}
                    if None in new.values():
                        break
                    self.state.update({name: value for name, value in new.items() if value is not None})
                    return self._said(self._next(known), known)
            self.unknown.append(command)
            return None

    def _next(self, command: str) -> str:
        answers = self.table.answers[command]
        if isinstance(answers, str):
            return answers
        turn = self._turns.get(command, 0)
        self._turns[command] = turn + 1
        return answers[min(turn, len(answers) - 1)]

    def _said(self, answer: str, place: str) -> str:
        def value(found: re.Match[str]) -> str:
            if found[1] not in self.state:
                hint = did_you_mean(found[1], self.state, "the state has")
                raise ConfigurationError(f"{place} names {found[1]!r}, which is no state; {hint}")
            try:
                return format(self.state[found[1]], found[2] or "")
            except ValueError as error:
                raise ConfigurationError(f"{place}: {found[0]} does not fit the state ({error}).") from None

        return _PLACE.sub(value, answer)


def _pattern(command: str, state: Mapping[str, Value], place: str) -> re.Pattern[str]:
    """What matches a command, with a group for each value in it."""
    parts, at, names = [], 0, []
    for found in _PLACE.finditer(command):
        if found[1] not in state or found[1] in names:
            hint = did_you_mean(found[1], state, "the state has")
            why = "twice" if found[1] in names else f"which is no state; {hint}"
            raise ConfigurationError(f"{place}: the command {command!r} names {found[1]!r}, {why}")
        names.append(found[1])
        parts += [re.escape(command[at : found.start()]), f"(?P<{found[1]}>.+?)"]
        at = found.end()
    return re.compile("".join([*parts, re.escape(command[at:])]), re.DOTALL)


def _value(text: str, kept: Kept) -> Value | None:
    """The value that a text says, of the kind that is kept; None for one that does not fit."""
    value: Value | None
    try:
        match kept.value:
            case bool():
                return _SWITCH.get(text.strip().upper())
            case int():
                value = int(text)
            case float():
                value = float(text)
            case _:
                return text
    except ValueError:
        return None
    fits = (kept.min is None or value >= kept.min) and (kept.max is None or value <= kept.max)
    return value if fits else None


def read_table(path: Path) -> Table:
    """Read a table. Raises ConfigurationError, which names the file, the line and the key."""
    text = read_text(path, f"There is no table {path}.")
    raw = parse_toml(text, path)
    table = validate(Table, raw, partial(place, ((str(path), key_lines(text)),)))
    Instrument(table, str(path))
    return table


def table_of(
    answers: Mapping[str, str | Sequence[str]] | str | Path, folder: Path, **more: Any
) -> tuple[Table, str]:
    """The table that a test writes, or that a file in `folder` holds, and where it stands."""
    if isinstance(answers, str | Path):
        path = folder / answers
        if more:
            raise ConfigurationError(f"{path} has all of the table: leave out {', '.join(more)}.")
        return read_table(path), str(path)
    told = {one: said if isinstance(said, str) else list(said) for one, said in answers.items()}
    return validate(Table, {"answers": told, **more}, "the table"), "the table"
