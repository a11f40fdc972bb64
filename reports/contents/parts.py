"""What a result says, taken apart once: facts, tables, sentences, verdicts and figures.

Each kind of result has one function that returns `Contents`. The terminal's table, `--json`, a notebook's
cell and the report of files are made of it, so that none of them can say what another does not.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, is_dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np

from ...base.errors import DataError
from ...terminal.progress import SIMULATED

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..figures import Columns
    from .glance import Glance

Tone = Literal["", "good", "bad", "doubtful", "aside"]
"""How a cell is set off: in colour where there is colour."""


@dataclass(frozen=True)
class Cell:
    """The text of a cell of a table that is set off from the others."""

    text: str
    tone: Tone


_VERDICTS: dict[str, Tone] = {"pass": "good", "fail": "bad", "not shown": "doubtful"}
"""The verdicts of a check."""


def verdict_cell(said: str) -> Cell:
    """The cell of a check's verdict."""
    return Cell("FAIL" if said == "fail" else said, _VERDICTS[said])


def text_of(cell: str | Cell) -> str:
    """The text of a cell."""
    return cell if isinstance(cell, str) else cell.text


@dataclass(frozen=True)
class Fact:
    """One thing that is known of a result: lines of text for people, and the values in them for programs."""

    label: str
    lines: tuple[str | Cell, ...]
    values: Mapping[str, Any]
    """By name, with the unit, as in JSON: `scale`, `carrier_hz`."""
    detail: bool = False
    """True for what a command that has made the result leaves to `haploop show`."""


def fact(label: str = "", said: str | Cell | Sequence[str | Cell] | None = (), /, **values: Any) -> Fact:
    """A fact: the label and the text beside it, in one line or several, and the values that it is made of.

    Values alone are for programs only; without text there is no line.
    """
    lines = (said,) if isinstance(said, str | Cell) else tuple(said or ())
    return Fact(label, tuple(filter(None, lines)), values)


def detailed(facts: Iterable[Fact]) -> list[Fact]:
    """The same facts as details."""
    return [replace(one, detail=True) for one in facts]


@dataclass(frozen=True)
class Grid:
    """A table with a heading for each column; the first `words` columns hold words, the others numbers."""

    title: str
    headings: Sequence[str]
    rows: Sequence[Sequence[str | Cell]]
    words: int = 1
    below: str = ""
    """A sentence below the table."""


@dataclass(frozen=True)
class Verdict:
    """One row of the table of verdicts."""

    subject: str
    said: str
    """For example "pass", "fail", "not shown", "accepted"."""
    good: bool
    measured: str
    why: str = ""
    answers: tuple[str, ...] = ()
    """Further short lines: can it be felt, how loud it is, how much of the press it is."""

    @property
    def tone(self) -> Tone:
        """How it is set off."""
        return _VERDICTS.get(self.said, "good" if self.good else "bad")


@dataclass(frozen=True, eq=False)
class Drawing:
    """A figure that is still to be drawn: of one thing, or of up to `several` things of the same kind.

    In a report, drawings of one name and title become one figure; things of one `identity` are drawn once.
    """

    name: str
    """Part of its file's name."""
    title: str
    caption: str
    """What is drawn, and in which units."""
    things: Sequence[Any]
    """What `draw` and `count` take."""
    draw: Callable[[Sequence[Any], Columns], Figure]
    count: Callable[[Sequence[Any]], str]
    """Says of how many things (n) and of which the figure is."""
    identity: Hashable = None
    several: int = 3

    @classmethod
    def alone(
        cls, name: str, title: str, caption: str, draw: Callable[[Columns], Figure], said: str = ""
    ) -> Self:
        """A figure of one thing only; `said` stands in place of `count`."""
        return cls(name, title, caption, [None], lambda _, columns: draw(columns), lambda _: said, several=1)


@dataclass(frozen=True, eq=False)
class Contents:
    """What one result says. See the module."""

    title: str
    facts: Sequence[Fact] = ()
    tables: Sequence[Grid] = ()
    notes: Sequence[str] = ()
    """Sentences below the facts and tables."""
    kind: str = ""
    simulated: bool | None = None
    """None for a result that cannot say."""
    origin: str = SIMULATED
    """The sentence below a simulated result."""
    rig: str = ""
    verdicts: Sequence[Verdict] = ()
    figures: Sequence[Drawing] = ()
    """Figures for a report."""
    picture: Drawing | None = None
    """The figure for a screen; None for the first of `figures`."""
    glances: Sequence[Callable[[], Glance]] = ()
    """What the first screen of a report shows of it, computed when it is asked for."""
    undrawn: str = "There is no plot of this."
    """Why there is no picture."""

    @property
    def values(self) -> dict[str, Any]:
        """The object for `--json`: finite numbers, strings, lists and objects."""
        head: dict[str, Any] = {"kind": self.kind} if self.kind else {}
        if self.simulated is not None:
            head["simulated"] = self.simulated
        return head | {key: plain(value) for one in self.facts for key, value in one.values.items()}

    @property
    def said(self) -> list[str]:
        """The sentences below the facts and tables: the notes, and what is simulated."""
        return [*self.notes, *([self.origin] if self.simulated and self.origin else [])]

    @property
    def rows(self) -> list[tuple[str, str | Cell]]:
        """Label and text of each line of the facts; the second line of a fact has no label."""
        return [
            ("" if number else one.label, line) for one in self.facts for number, line in enumerate(one.lines)
        ]

    def brief(self) -> Contents:
        """The same without the details, for a command that has made the result."""
        return replace(self, facts=[one if not one.detail else replace(one, lines=()) for one in self.facts])

    def draw(self, columns: Columns = 2) -> Figure:
        """Draw the picture, one or two columns of a journal wide. Raises DataError when there is none."""
        picture = self.picture or next(iter(self.figures), None)
        if picture is None:
            raise DataError(self.undrawn)
        return picture.draw(picture.things, columns)


def plain(value: Any) -> Any:  # noqa: PLR0911 - one for each kind of value
    """A value as JSON has it: NaN and infinity become null, paths strings, arrays and tuples lists."""
    match value:
        case None | bool() | str() | int():
            return value
        case float() | np.floating():
            return float(value) if math.isfinite(value) else None
        case np.generic() | np.ndarray():
            return plain(value.tolist())
        case Path():
            return str(value)
        case Mapping():
            return {str(key): plain(one) for key, one in value.items()}
        case Iterable():
            return [plain(one) for one in value]
    if is_dataclass(value) and not isinstance(value, type):
        return plain(asdict(value))
    raise TypeError(f"{type(value).__name__} has no form in JSON.")
