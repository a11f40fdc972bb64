"""What was understood of a file: which column is what, by what right, and what only a person can know.

A column is taken for a role because it was told, or because the file says so: a unit that only this role has,
a heading that names it. Where two columns could be it, or a unit is missing, nothing is taken: that is a
question. What was taken by the file's word is shown with the word, and a mapping makes it explicit.
"""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...base import hdf5
from ...base.arrays import FloatArray
from ...base.errors import ConfigurationError, DataError
from ...base.wording import capital
from ..columns import SI, WEIGHTS, Column, Table, per_unit, read_table, unit_of
from .clock import base_of, began, rates_of, time_of, unit_of_time, words_of
from .roles import Claim, claim_of, is_switching
from .splits import split
from .timebase import Hole, TimeBase, filled, holes_of, lost, on_grid, spikes
from .understood import MEASURED, NONE, ROLES, FileMapping, Question, Role, Signal, Understanding, rest_of

_SLOWEST, _FASTEST = 100.0, 1e8
"""Samples per second of a file: a press of half a second has fifty, and the fastest cards take 10^7."""
_MARGIN = 0.05
"""Part by which a clock of 100 Hz may be slow."""
_LISTED = 30
"""Columns that a sentence names."""
_SHORTEST = 0.01
"""s: a fifth of the shortest press."""
_MOST = {"force": 1e5, "acceleration": 1e6, "displacement": 1.0, "activation": np.inf}
"""N, m/s^2 (ten times what the hardest shock sensors take), m."""
_G = 9.80665
_SLOW = "A slow curve of force over travel is read with --as curve."


def understand(path: str | Path, mapping: FileMapping | None = None) -> Understanding:
    """What a file holds, as far as it and `mapping` say.

    Raises ConfigurationError for a mapping that contradicts the file, DataError for one that cannot be read.
    """
    path, told = Path(path), mapping or FileMapping()
    with suppress(DataError):  # of somebody else
        kind = hdf5.kind_of(path)
        raise ConfigurationError(f"{path} is a {kind} of haploop already, and needs no import: haploop show.")
    table = read_table(path, told.format, told.decimal, told.skip_damaged)
    found = _Finder(table, told)
    return found.understanding()


class _Finder:
    """Goes through the roles of one file."""

    def __init__(self, table: Table, told: FileMapping) -> None:
        self.told = told
        told_of = {role: place for role in ROLES if (place := getattr(told, role)) is not None}
        self.table, splits = split(table, told.where, tuple(told_of.values()))
        self.questions: list[Question] = list(splits)
        self.notes: list[str] = list(self.table.notes)
        self.holes: list[Hole] = []
        self.taken: dict[Role, tuple[int, str]] = {}
        self.doubts: dict[Role, str] = {}
        self.time_unit: tuple[float, str] | None = None
        self.kept = np.ones(len(self.table.columns[0].values), dtype=np.bool_)
        self.closed = {role for role, place in told_of.items() if place == NONE}
        for role, place in told_of.items():
            if role not in self.closed:
                self.taken[role] = (self._number(role, place), "told")
        numbers = [number for number, _ in self.taken.values()]
        if len(set(numbers)) < len(numbers):
            raise ConfigurationError(f"{table.path}: two of the roles are the same column.")

    def understanding(self) -> Understanding:
        table, told = self.table, self.told
        self._look()
        units = {role: self._unit(role) for role in self.taken if role in MEASURED}
        base = None if self.questions and self.questions[0].key.startswith("where") else self._base()
        asked = {q.key for q in self.questions}
        if not any(role in self.taken or role in asked for role in MEASURED):
            all_ = self._listed(range(len(table.columns)))
            self.questions.append(Question(
                "force", f"which of its columns ({all_}) is force, acceleration or displacement",
                "--force COLUMN, --acceleration COLUMN or --displacement COLUMN"))  # fmt: skip
        if self.time_unit is not None:
            units["time"] = self.time_unit
        signals: dict[str, Signal] = {}
        for role, (number, why) in self.taken.items():
            factor, words = units.get(role) or (1.0, "")
            factor *= -1.0 if role in told.flip else 1.0
            open_ = base is None or any(q.key in (f"unit {role}", role) for q in self.questions)
            values = np.zeros(0) if open_ or role == "time" else self._values(role, number, factor, base)
            signals[role] = Signal(role, number, self._heading(number), why, words, factor, values)
        rate = base.rate_hz if base else float("nan")
        for role in MEASURED:
            if role in signals and len(signals[role].values):
                self._sign(role, signals[role].values, rate)
        self._contact(signals)
        time = (self.taken["time"][0], self.time_unit[0]) if self.time_unit is not None else None
        start = began(table, time, [n for role, (n, _) in self.taken.items() if role != "time"], told)
        self.notes += [words_of(start)] if start is not None else []
        return Understanding(
            table.path, table, self._explicit(signals), signals, rate, tuple(self.questions),
            tuple(self.notes), tuple(self.holes), start)  # fmt: skip

    def _number(self, role: str, place: int | str) -> int:
        """The number of a column that was told."""
        columns, names = self.table.columns, self.table.by_name
        if isinstance(place, str) and place in names:
            return names[place]
        if isinstance(place, str) and place.isdecimal():
            place = int(place)
        if isinstance(place, int) and place < len(columns):
            return place
        all_ = self._listed(range(len(columns)))
        raise ConfigurationError(
            f"{self.table.path} has no column {place!r} for {role}: it has {all_} (numbers count from 0)."
        )

    def _heading(self, number: int) -> str:
        """What a column is called, with its number where another has the same heading."""
        columns = self.table.columns
        called = columns[number].called(number)
        same = sum(column.heading == columns[number].heading for column in columns) > 1
        return f"{called} (column {number})" if same and columns[number].name else called

    def _listed(self, numbers: Sequence[int]) -> str:
        """Headings of columns, for a sentence."""
        more = f" and {len(numbers) - _LISTED} more" if len(numbers) > _LISTED else ""
        return ", ".join(map(self._heading, numbers[:_LISTED])) + more

    def _look(self) -> None:
        """Take the columns that the file says are a role; a question where it says so of several."""
        used = {number for number, _ in self.taken.values()}
        claims: dict[Role, dict[int, Claim]] = {role: {} for role in ROLES}
        own = "content_hash" in self.table.about
        for number, column in enumerate(self.table.columns):
            found = None if number in used else claim_of(column, own)
            if found is not None and found[0] not in self.taken and found[0] not in self.closed:
                claims[found[0]][number] = found[1]
        if self.told.rate_hz is not None or self.told.make == "curve":
            claims["time"] = {}
        for role, claimed in claims.items():
            for number in [n for n in claimed if role != "time" and _constant(self.table.columns[n].values)]:
                del claimed[number]
                self.notes.append(f"{self._heading(number)} is constant, and was left out.")
            if role == "activation":
                self._switches(claimed)
            best = max((claim.score for claim in claimed.values()), default=0)
            self._decide(role, {n: claim for n, claim in claimed.items() if claim.score == best})
        measured = [n for n in range(len(self.table.columns)) if n != self.taken.get("time", (-1, ""))[0]]
        named = [role for role in MEASURED if role in self.told.units]
        if len(measured) == 1 and len(named) == 1 and measured[0] not in {n for n, _ in self.taken.values()}:
            self.taken[named[0]] = (measured[0], "told by its unit")  # of a file of one signal
            self.questions = [q for q in self.questions if q.key != named[0]]

    def _switches(self, claimed: dict[int, Claim]) -> None:
        for number in [n for n in claimed if not is_switching(self.table.columns[n].values)]:
            del claimed[number]
            self.notes.append(f"{self._heading(number)} has not two levels, and was left out.")

    def _decide(self, role: Role, claimed: Mapping[int, Claim]) -> None:
        if role == "time":
            found = time_of(self.table, list(claimed), self.told)
            if isinstance(found, Question):
                self.questions.append(found)
            elif found is not None:
                self.taken[role] = (found[0], claimed[found[0]].why + found[1])
            return
        which = "the vertical acceleration" if role == "acceleration" else role
        names = self._listed(list(claimed))
        if len(claimed) > 1:
            self.questions.append(Question(role, f"which of {names} is {which}", f"--{role} COLUMN"))
        for number, claim in claimed.items() if len(claimed) == 1 else ():
            column = self.table.columns[number]
            of_role = role == "acceleration" or "vertical" in claim.doubt
            if claim.doubt and of_role and not _contradicted(column, claim):
                option = f"--{role} {json.dumps(column.name or str(number), ensure_ascii=False)}"
                self.questions.append(Question(role, f"whether {names} is {which} ({claim.doubt})", option))
                continue
            self.taken[role] = (number, claim.why)
            self.doubts[role] = claim.doubt

    def _unit(self, role: Role) -> tuple[float, str] | None:
        """SI units per unit of a role's column, and the words of it; None and a question without one."""
        number, _ = self.taken[role]
        column = self.table.columns[number]
        if (said := self.told.units.get(role)) is not None:
            return per_unit(role, role, said, column.unit)
        doubt = column.doubt or self.doubts.get(role, "")
        unit = unit_of(column.unit, role)
        if unit is not None and not doubt:
            return unit.factor, column.unit
        example = f"--unit {shlex.quote(f'{role}={column.unit}') if unit else f'{role}={SI[role]}'}"
        if "in its numbers" in doubt:
            example += (
                f" where it is in them, or what one of its units is (--unit '{role}=0.01 {column.unit}')"
            )
        what = f"the unit of {role} ({self._heading(number)})"
        if role == "force" and (mass := unit_of(column.unit, "mass")) is not None:
            example = f"--unit {shlex.quote(f'force={WEIGHTS[mass.factor]}')}"
        if unit_of(column.unit, "voltage") is not None:
            example = {
                "force": "--unit 'force=0.25 V/N'",
                "acceleration": "--unit 'acceleration=100 mV/g'",
            }.get(role, f"--unit '{role}=2 V/mm'")
            what = f"what a volt of {role} is ({self._heading(number)})"
        self.questions.append(Question(f"unit {role}", f"{what}{f': {doubt}' if doubt else ''}", example))
        return None

    def _base(self) -> TimeBase | None:
        """The time base; None and a question without one. The rows of a curve have no time."""
        if self.told.make == "curve":
            return TimeBase(1.0, ())
        path, number = self.table.path, self.taken["time"][0] if "time" in self.taken else None
        taken = [n for role, (n, _) in self.taken.items() if role != "time"]
        if number is not None and self.told.rate_hz is None:
            unit = unit_of_time(self.table, number, rates_of(self.table, taken), self.told)
            if isinstance(unit, Question):
                self.questions.append(unit)
                return None
            self.time_unit = unit
        elif any(q.key == "time" for q in self.questions):
            return None
        try:
            base = base_of(self.table, number, self.time_unit, taken, self.told)
        except DataError as error:
            if {"force", "displacement"} <= set(self.taken):
                raise DataError(f"{error} {_SLOW}") from None
            raise
        if isinstance(base, Question):
            slow = ", or --as curve for slow force over travel"
            both = {"force", "displacement"} <= set(self.taken)
            self.questions.append(replace(base, option=base.option + slow * both))
            return None
        if not _SLOWEST * (1 - _MARGIN) <= base.rate_hz <= _FASTEST:
            raise ConfigurationError(
                f"{path} would have {base.rate_hz:g} samples/s: from {_SLOWEST:g} to {_FASTEST:g} are "
                f"possible, so look at its time or at --rate. {_SLOW}"
            )
        self.notes += [f"Time: {one}." for one in base.said]
        self.holes += holes_of(base)
        if number is not None and self.told.rate_hz is None:
            self.kept[list(self.table.damaged)] = False
            self.holes += lost(base, self.table.damaged)
        return base

    def _contact(self, signals: Mapping[str, Signal]) -> None:
        """Ask about a contact that is closed where the file begins: many read high when open."""
        contact = signals.get("activation")
        if contact is None or not len(contact.values) or "activation" in self.told.flip:
            return
        if contact.values[0] > (contact.values.min() + contact.values.max()) / 2 and contact.why != "told":
            self.questions.append(Question(
                "flip activation", f"why {contact.heading} is high at the start, closed or open with a "
                "pull-up", "--flip activation, or --activation COLUMN where it is closed"))  # fmt: skip

    def _values(self, role: Role, number: int, factor: float, base: TimeBase | None) -> FloatArray:
        assert base is not None
        path, values = self.table.path, self.table.columns[number].values[self.kept]
        rate = None if self.told.make == "curve" else base.rate_hz  # rows of a curve have no time
        finite = np.isfinite(values)
        name = self._heading(number)
        if _constant(values):
            raise DataError(f"The column {name!r} of {path} is empty, constant, or not finite.")
        if base.stamps is not None and len(base.stamps) != len(values):
            raise DataError(f"The column {name!r} of {path} is not as long as its time.")
        if (duration := len(values) / base.rate_hz) < _SHORTEST:
            raise ConfigurationError(
                f"{path} lasts {1e3 * duration:.3g} ms, which is no press: look at the unit of its time, or "
                "at --rate."
            )
        whole, missing = filled(values, name)
        if missing:
            count = int(np.count_nonzero(~finite))
            longest = max(hole.end - hole.first for hole in missing)
            long = f"{longest}" if rate is None else f"{1e3 * longest / rate:.3g} ms"
            if count > 0.1 * len(values):
                raise DataError(f"The column {name!r} of {path} lacks {count} of {len(values)} values.")
            self.notes.append(
                f"{name}: {count} value{'s are' if count > 1 else ' is'} missing, at most {long} in a row; "
                "filled by a straight line."
            )
            self.holes += missing
        found = factor * on_grid(base, whole)
        if (most := float(np.abs(found).max())) > _MOST[role]:
            raise ConfigurationError(
                f"The column {name!r} of {path} would reach {most:g} {SI[role]}: look at its unit (--unit)."
            )
        if role in ("force", "displacement") and (said := spikes(found, rate, SI[role])):
            self.notes.append(f"{name}: {said}")
        return np.asarray(found)

    def _sign(self, role: Role, values: FloatArray, rate_hz: float) -> None:
        """Ask for the direction of a signal that no press has, and say where its rest was taken from."""
        if role == "acceleration":
            middle = float(np.median(values))
            if abs(abs(middle) - _G) > 0.35 * _G:
                self.notes.append(
                    f"Acceleration: {middle:.2f} m/s² for most of the file: no gravity, which would show its "
                    "sign."
                )
            elif middle > 0:
                self.notes.append(
                    f"Acceleration: {middle:.2f} m/s² for most of the file, so with gravity, upwards."
                )
            elif "acceleration" not in self.told.flip:
                self.questions.append(Question(
                    "flip acceleration", f"why acceleration is {middle:.1f} m/s² at rest, upside down",
                    "--flip acceleration"))  # fmt: skip
            return
        told, curve = self.told.rest.get(role), self.told.make == "curve"
        rest = rest_of(values, rate_hz)
        # A curve begins at rest, and may end at the largest travel; its rows are no seconds.
        falls = rest.falls("start" if curve else told)
        said = f"{rest.start:.3g} {SI[role]}" if curve else rest.words(told, SI[role])
        self.notes.append(f"{capital(role)} at rest: {said}.")
        if falls is None:
            self.questions.append(Question(
                f"rest {role}", f"where {role} rests ({said}; it reaches {rest.low:.3g} to {rest.high:.3g})",
                f"--rest {role}=start or --rest {role}=end"))  # fmt: skip
        elif falls and role not in self.told.flip:
            self.questions.append(Question(
                f"flip {role}",
                f"why {role} falls from its rest ({said}) to {rest.low:.3g} and rises to {rest.high:.3g}",
                f"--flip {role}"))  # fmt: skip

    def _explicit(self, signals: dict[str, Signal]) -> FileMapping:
        """The mapping with what the file said."""
        columns: dict[str, object] = {}
        units = dict(self.told.units)
        names = self.table.by_name
        for role, signal in signals.items():
            heading = self.table.columns[signal.number].heading
            columns[role] = heading if names.get(heading) == signal.number else signal.number
            column = self.table.columns[signal.number]
            if role not in ("activation",) and not column.stamps and signal.unit and role not in units:
                units[role] = signal.unit
        return self.told.model_copy(update={**columns, "units": units})


def _contradicted(column: Column, claim: Claim) -> bool:
    """True where what is doubtful is the unit alone, and not the role."""
    return "its unit" in claim.doubt or "is said to be" in claim.doubt or bool(column.doubt)


def _constant(values: FloatArray) -> bool:
    finite = values[np.isfinite(values)]
    return not len(finite) or not np.ptp(finite)
