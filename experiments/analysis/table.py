"""Tidy tables of one CSV line an observation, and tables of one value for each person and levels."""

from __future__ import annotations

import csv
import itertools
import json
import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ...base.arrays import FloatArray
from ...base.errors import DataError


@dataclass(frozen=True)
class Rows:
    """Lines of a CSV file, as text, by the names of the columns."""

    name: str
    """What messages call the file."""
    columns: tuple[str, ...]
    lines: tuple[tuple[int, dict[str, str]], ...]
    """Number of the line in the file, and its cells."""
    orders: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Order of the values of a column, where the file beside the table states it."""
    decimal_commas: bool = False
    """True when numbers may have a decimal comma, because cells are not separated by commas."""
    chosen: tuple[str, ...] = ()
    """What was chosen from the file, as sentences."""

    def require(self, *columns: str) -> None:
        """Raise DataError when a column is missing."""
        for column in columns:
            if column not in self.columns:
                raise DataError(
                    f"{self.name} has no column {column!r}, only {', '.join(self.columns)}: the first line "
                    f"must name the columns {', '.join(columns)}."
                )

    def text(self, column: str) -> list[str]:
        """Cells of a column. Raises DataError for an empty one."""
        for number, line in self.lines:
            if not line[column]:
                raise DataError(f"{self.name}, line {number}: the column {column!r} is empty.")
        return [line[column] for _, line in self.lines]

    def numbers(self, column: str) -> list[float]:
        """Cells of a column as finite numbers, with a point or, where that is certain, a decimal comma.

        Raises DataError, with the line, for another cell.
        """
        found = []
        cells = self.text(column)
        # 1.500 beside 2,5 may be a thousand and a half, or one and a half.
        commas = self.decimal_commas and any("," in cell for cell in cells)
        for (number, _), cell in zip(self.lines, cells, strict=True):
            try:
                point = cell.replace(",", ".") if commas else cell
                value = math.nan if commas and "." in cell else float(point)
            except ValueError:
                value = math.nan
            if not math.isfinite(value):
                why = ": write all numbers with a decimal point" if "," in cell or commas else ""
                raise DataError(
                    f"{self.name}, line {number}: {column} is {cell!r}, which is not a number{why}."
                )
            found.append(value)
        return found

    def truths(self, column: str) -> list[bool]:
        """Cells of a column as true or false, also as a spreadsheet writes them. Raises DataError."""
        found = []
        for (number, _), cell in zip(self.lines, self.text(column), strict=True):
            if cell.casefold() not in _YES | _NO:
                raise DataError(
                    f"{self.name}, line {number}: {column} is {cell!r}, and must be true or false."
                )
            found.append(cell.casefold() in _YES)
        return found

    @property
    def simulated(self) -> bool:
        """True when a column `simulated` says of any line that no person answered."""
        # Whatever does not say no is taken as simulated.
        cells = {line.get("simulated", "").casefold() for _, line in self.lines}
        return not cells <= {"", *_NO}

    def only(self, column: str, value: str) -> Rows:
        """The lines with one value in a column."""
        return replace(self, lines=tuple((n, line) for n, line in self.lines if line[column] == value))

    def choose(self, column: str, value: str) -> Rows:
        """As `only`; `remarks` tell of it. Raises DataError: no such column, no line left."""
        self.require(column)
        found = self.only(column, value)
        if not found.lines:
            values = ", ".join(sorted({line[column] for _, line in self.lines}))
            raise DataError(f"{self.name} has no line with {column} {value!r}, only with {values}.")
        said = f"Of {len(self.lines)} lines, the {len(found.lines)} with {column} {value} were taken."
        return replace(found, chosen=(*self.chosen, said))

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences on what was chosen, and on lines of unfinished sessions and impossible times."""
        found = [*self.chosen]
        for column, good, what in (
            ("complete", "true", "are of sessions that were not completed"),
            ("timing", "possible", "were answered too fast or too slow for a person"),
        ):
            cells = [line.get(column, "") for _, line in self.lines]
            bad = sum(cell.casefold() in {"too fast", "too slow", *_NO} for cell in cells)
            if bad:
                found.append(
                    f"{bad} of {len(cells)} lines {what}, and were analysed as the others: --only {column} "
                    f"{good} leaves them out."
                )
        return tuple(found)

    def levels(self, *columns: str) -> tuple[str, ...]:
        """Different values of columns: those with a stated order in that order, then as the file has them."""
        found = dict.fromkeys(cell for column in columns for cell in self.text(column))
        stated = dict.fromkeys(value for column in columns for value in self.orders.get(column, ()))
        return (*(value for value in stated if value in found), *(v for v in found if v not in stated))


_YES = {"1", "yes", "true", "wahr", "vrai", "vero", "verdadero", "verdadeiro", "waar"}
_NO = {"0", "no", "false", "falsch", "faux", "falso", "onwaar"}
"""What spreadsheets make of true and false when they save a table."""


def read_rows(path: str | Path) -> Rows:
    """Read a CSV file with a header line; a line that starts with # is a comment.

    Cells may be separated by commas, semicolons or tabs (also stated by a first line `sep=;`); unless by
    commas, numbers may have a decimal comma.
    `NAME.json` beside it, as `export_answers` writes it, gives the order of a column's values (`Levels`).
    Raises DataError: no file, no text in UTF-8, no line of data, a line with too many or too few cells.

    For example:

        >>> from haploop import experiments
        >>> rows = experiments.read_rows("matching.csv")
        >>> rows.simulated, "answered" in rows.columns
        (True, True)
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise DataError(f"There is no file {path}: name a CSV file.") from None
    except UnicodeDecodeError:
        raise DataError(f"{path} is not a text file in UTF-8: save the table as CSV (UTF-8).") from None
    except OSError as error:
        raise DataError(f"{path} cannot be read: {error.strerror}.") from None
    return replace(_rows(str(path), text.splitlines()), orders=_orders(path.with_suffix(".json")))


def _orders(sidecar: Path) -> dict[str, tuple[str, ...]]:
    """`Levels` of each column: a list, or as BIDS has it an object with a description of each."""
    try:
        described = json.loads(sidecar.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError):
        return {}  # A table needs no sidecar, and another program's file of that name may hold anything.
    if not isinstance(described, dict):
        return {}
    levels = {name: one.get("Levels") for name, one in described.items() if isinstance(one, dict)}
    return {name: tuple(map(str, some)) for name, some in levels.items() if isinstance(some, list | dict)}


def _rows(name: str, lines: Iterable[str]) -> Rows:
    kept = [(n, line) for n, line in enumerate(lines, 1) if line.strip() and not line.startswith("#")]
    if not kept:
        raise DataError(f"{name} is empty: the first line names the columns, each further line is one row.")
    stated = re.fullmatch(r'"?sep=([,;\t])"?', kept[0][1].rstrip(" \r"), re.IGNORECASE)
    if stated and len(kept) > 1:
        del kept[0]
    header = kept[0][1]
    # A spreadsheet in a country with a decimal comma separates the cells of a CSV by semicolons.
    separator = stated[1] if stated else max(",;\t", key=header.count)
    columns = tuple(cell.strip() for cell in next(csv.reader([header], delimiter=separator)))
    if len(set(columns)) < len(columns) or "" in columns:
        raise DataError(f"{name}: the first line must name each column once, and is {header.strip()!r}.")
    rows = []
    for number, line in kept[1:]:
        cells = next(csv.reader([line], delimiter=separator))
        if len(cells) != len(columns):
            raise DataError(
                f"{name}, line {number} has {len(cells)} cells, and the first line names "
                f"{len(columns)} columns."
            )
        rows.append((number, {column: cell.strip() for column, cell in zip(columns, cells, strict=True)}))
    if not rows:
        raise DataError(f"{name} has no line below its header.")
    return Rows(name, columns, tuple(rows), decimal_commas=separator != ",")


# Tables of cells: one value for each person and combination of levels.


@dataclass(frozen=True, eq=False)
class Cells:
    """Values of people in crossed within factors."""

    values: FloatArray
    """(people, levels of each factor ..., variables)"""
    people: tuple[str, ...]
    factors: tuple[str, ...]
    levels: tuple[tuple[str, ...], ...]
    groups: tuple[int, ...]
    """Number of each person's group; empty without a between factor."""
    group_names: tuple[str, ...]
    incomplete: tuple[str, ...]
    """People who are left out, because a cell of theirs has no value."""


def cells_of(rows: Rows, factors: Sequence[str], variables: Sequence[str], between: str = "") -> Cells:
    """Collect the values of columns `variables` by the columns `participant`, `factors` and `between`.

    Several lines of one cell are averaged. Raises DataError: a missing column, a person in two groups, nobody
    with a value in each cell.
    """
    rows.require("participant", *factors, *variables, *([between] if between else []))
    who = rows.text("participant")
    levels = tuple(rows.levels(factor) for factor in factors)
    place = [tuple(cell) for cell in zip(*(rows.text(factor) for factor in factors), strict=True)]
    numbers = np.array([rows.numbers(variable) for variable in variables]).T
    found: dict[tuple[str, ...], list[FloatArray]] = {}
    for person, cell, line in zip(who, place, numbers, strict=True):
        found.setdefault((person, *cell), []).append(line)
    cells = list(itertools.product(*levels))
    people = tuple(dict.fromkeys(who))
    whole = tuple(person for person in people if all((person, *cell) in found for cell in cells))
    if not whole:
        raise DataError(
            f"{rows.name}: no participant has a value in each of the {len(cells)} cells of "
            f"{' x '.join(factors)}."
        )
    values = np.array([[np.mean(found[person, *cell], axis=0) for cell in cells] for person in whole])
    group_names, groups = _groups(rows, between, whole)
    return Cells(
        values.reshape(len(whole), *(len(some) for some in levels), len(variables)),
        whole,
        tuple(factors),
        levels,
        groups,
        group_names,
        tuple(person for person in people if person not in whole),
    )


def uneven_groups(between: str, of_people: Sequence[str], names: Sequence[str]) -> list[str]:
    """A note when groups differ in size: what they counterbalance is not balanced over people then."""
    counts = Counter(of_people)
    if len(set(counts.values())) < 2:
        return []
    said = ", ".join(f"{name} {counts[name]}" for name in names)
    return [
        f"The {between}s differ in size ({said} participants): what they counterbalance, such as the order "
        "of conditions, is not balanced over people."
    ]


def _groups(rows: Rows, between: str, people: Sequence[str]) -> tuple[tuple[str, ...], tuple[int, ...]]:
    if not between:
        return (), ()
    of: dict[str, str] = {}
    for person, group in zip(rows.text("participant"), rows.text(between), strict=True):
        if of.setdefault(person, group) != group:
            raise DataError(
                f"{rows.name}: {person} is in the {between}s {of[person]} and {group}: {between} must "
                "differ between participants only."
            )
    names = tuple(dict.fromkeys(of[person] for person in people))
    return names, tuple(names.index(of[person]) for person in people)
