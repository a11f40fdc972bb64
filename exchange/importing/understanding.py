"""What was understood of a file: which column is what, by what right, and what only a person can know.

A column is taken for a role because it was told, or because the file says so: a unit that only this role has,
a heading that names it. Where two columns could be it, or a unit is missing, nothing is taken: that is a
question. What was taken by the file's word is shown with the word, and a mapping makes it explicit.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...acquisition import hdf5
from ...instruments import ConfigurationError, DataError
from ...instruments.arrays import FloatArray
from ..columns import SI, Table, per_unit, read_table, unit_of
from .mapping import ROLES, FileMapping, Role
from .rest import rest_of
from .roles import columns_of
from .timebase import Hole, TimeBase, filled, holes_of, on_grid, time_base

_PLAUSIBLE = (200.0, 200_000.0)
"""Samples per second, a factor of 1000, within which a time without a unit can be in one unit only."""
_SLOWEST, _FASTEST = 100.0, 1e8
"""Samples per second of a file: a press of half a second has fifty, and the fastest cards take 10^7."""
_SHORTEST = 0.01
"""s: a fifth of the shortest press."""
_MOST = {"force": 1e5, "acceleration": 1e6, "displacement": 1.0, "activation": np.inf}
"""N, m/s^2 (ten times what the hardest shock sensors take), m."""
_G = 9.80665


@dataclass(frozen=True)
class Question:
    """Something that the file does not say."""

    key: Role | str
    """What is asked for: a role, "rate", or "unit ROLE", "flip ROLE", "rest ROLE"."""
    what: str
    """For a sentence: "the unit of force (column 1, F)"."""
    option: str
    """How it is told: "--unit force=N"."""


@dataclass(frozen=True, eq=False)
class Signal:
    """One column that means something."""

    role: Role
    number: int
    """Of the column, from 0."""
    heading: str
    why: str
    """By what right: "told", "by its unit", "by its heading"."""
    unit: str
    """Words on what one of the file's units is."""
    factor: float
    """SI units per unit of the file, with the sign."""
    values: FloatArray
    """(samples,) in SI on the even grid; empty while there is a question."""


@dataclass(frozen=True, eq=False)
class Understanding:
    """What was understood of a file, and what was not."""

    path: Path
    table: Table
    mapping: FileMapping
    """All that was told or taken, explicitly: with it, the next file needs no word."""
    signals: dict[str, Signal]
    rate_hz: float
    """NaN while it is not known."""
    questions: tuple[Question, ...]
    notes: tuple[str, ...]
    """Sentences with figures: rate, jitter, gaps, missing values, gravity."""
    holes: tuple[Hole, ...] = ()

    @property
    def duration(self) -> float:
        """Seconds."""
        lengths = [len(s.values) for s in self.signals.values() if s.role != "time"]
        return max(lengths, default=0) / self.rate_hz

    def answered(self, question: Question, answer: str) -> FileMapping:
        """The mapping with the answer to a question. Raises ConfigurationError for one that is none."""
        what, _, role = question.key.partition(" ")
        told: dict[str, object]
        if what == "flip":
            told = {"flip": (role,)}
        elif what in ("unit", "rest"):
            told = {"units" if what == "unit" else "rest": {role: answer}}
        elif what == "rate":
            told = {"rate_hz": answer}
        else:
            told = {what: int(answer) if answer.isdecimal() else answer}
        return self.mapping.but(FileMapping.told(told, "the answer"))

    def require(self) -> None:
        """Raise ConfigurationError, one sentence, when a question is open."""
        if self.questions:
            what = _listed([q.what for q in self.questions], "nor")
            raise ConfigurationError(
                f"{self.path} does not say {what}: add, for example, "
                f"{_listed([q.option for q in self.questions], 'and')}."
            )


def understand(path: str | Path, mapping: FileMapping | None = None) -> Understanding:
    """What a file holds, as far as it and `mapping` say.

    Raises ConfigurationError for a mapping that contradicts the file, DataError for one that cannot be read.
    """
    path, told = Path(path), mapping or FileMapping()
    with suppress(DataError):  # of somebody else
        kind = hdf5.kind_of(path)
        raise ConfigurationError(f"{path} is a {kind} of haploop already, and needs no import: haploop show.")
    table = read_table(path, told.format, told.decimal)
    found = _Finder(table, told)
    return found.understanding()


class _Finder:
    """Goes through the roles of one file."""

    def __init__(self, table: Table, told: FileMapping) -> None:
        self.table, self.told = table, told
        self.questions: list[Question] = []
        self.notes: list[str] = list(table.notes)
        self.holes: list[Hole] = []
        self.taken: dict[Role, tuple[int, str]] = {}
        for role in ROLES:
            place = getattr(told, role)
            if place is not None:
                self.taken[role] = (self._number(role, place), "told")
        numbers = [number for number, _ in self.taken.values()]
        if len(set(numbers)) < len(numbers):
            raise ConfigurationError(f"{table.path}: two of the roles are the same column.")

    def understanding(self) -> Understanding:
        table, told = self.table, self.told
        for role in ROLES:
            if role not in self.taken:
                self._look(role)
        units: dict[str, tuple[float, str] | None] = {
            role: self._unit(role) for role in self.taken if role != "activation"
        }
        base = self._base(units.get("time"))
        if not any(role in self.taken for role in ("force", "acceleration", "displacement")) and not any(
            q.key in ("force", "acceleration", "displacement") for q in self.questions
        ):
            headings = ", ".join(c.heading or str(n) for n, c in enumerate(table.columns))
            self.questions.append(Question(
                "force", f"which of its columns ({headings}) is force, acceleration or displacement",
                "--force COLUMN, --acceleration COLUMN or --displacement COLUMN"))  # fmt: skip
        signals: dict[str, Signal] = {}
        for role, (number, why) in self.taken.items():
            factor, words = units.get(role) or (1.0, "")
            factor *= -1.0 if role in told.flip else 1.0
            open_ = base is None or any(q.key == f"unit {role}" for q in self.questions)
            values = np.zeros(0) if open_ or role == "time" else self._values(role, number, factor, base)
            signals[role] = Signal(role, number, self._heading(number), why, words, factor, values)
        rate = base.rate_hz if base else float("nan")
        for role in ("force", "acceleration", "displacement"):
            if role in signals and len(signals[role].values):
                self._sign(role, signals[role].values, rate)
        return Understanding(
            table.path, table, self._explicit(signals), signals, rate, tuple(self.questions),
            tuple(self.notes), tuple(self.holes))  # fmt: skip

    def _number(self, role: str, place: int | str) -> int:
        """The number of a column that was told."""
        columns, names = self.table.columns, self.table.by_name
        if isinstance(place, str) and place in names:
            return names[place]
        if isinstance(place, str) and place.isdecimal():
            place = int(place)
        if isinstance(place, int) and place < len(columns):
            return place
        all_ = ", ".join(c.heading or str(n) for n, c in enumerate(columns))
        raise ConfigurationError(
            f"{self.table.path} has no column {place!r} for {role}: it has {all_} (numbers count from 0)."
        )

    def _heading(self, number: int) -> str:
        return self.table.columns[number].heading or f"column {number}"

    def _look(self, role: Role) -> None:
        """Take the column that the file says is this role; a question where it says so of several."""
        if role == "time" and self.told.rate_hz is not None:
            return
        used = {number for number, _ in self.taken.values()}
        found, why = columns_of(self.table, role, used)
        for number in [n for n in found if role != "time" and _constant(self.table.columns[n].values)]:
            found.remove(number)
            self.notes.append(f"{self._heading(number)} is constant, and was left out.")
        free = set(range(len(self.table.columns))) - used
        if not found and len(free) == 1 and role in self.told.units:
            found, why = list(free), "the only column"
        if len(found) == 1:
            self.taken[role] = (found[0], why)
        elif found and role != "activation":
            names = ", ".join(self._heading(n) for n in found)
            which = "the vertical acceleration" if role == "acceleration" else role
            self.questions.append(Question(role, f"which of {names} is {which}", f"--{role} COLUMN"))

    def _unit(self, role: Role) -> tuple[float, str] | None:
        """SI units per unit of a role's column, and the words of it; None and a question without one."""
        number, _ = self.taken[role]
        column = self.table.columns[number]
        if role == "time" and column.stamps:
            return 1.0, "s"
        if (said := self.told.units.get(role)) is not None:
            return per_unit(role, role, said, column.unit)
        unit = unit_of(column.unit)
        if unit is not None and unit.quantity == role:
            return unit.factor, column.unit
        if role == "time" and not column.unit:
            return self._unit_of_time(column.values)
        example = f"--unit {role}={SI[role]}"
        what = f"the unit of {role} ({self._heading(number)}{column.doubt and ': ' + column.doubt})"
        if unit is not None and unit.quantity == "voltage":
            example = {
                "force": "--unit 'force=0.25 V/N'",
                "acceleration": "--unit 'acceleration=100 mV/g'",
            }.get(role, f"--unit '{role}=2 V/mm'")
            what = f"what a volt of {role} is ({self._heading(number)})"
        self.questions.append(Question(f"unit {role}", what, example))
        return None

    def _unit_of_time(self, values: FloatArray) -> tuple[float, str] | None:
        """A unit in which the step of a time without one can be a sample rate, if there is one only."""
        span = float(values[-1] - values[0]) if len(values) > 1 else 0.0
        fits = [
            (factor, unit)
            for unit, factor in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9))
            if span > 0 and _PLAUSIBLE[0] <= (len(values) - 1) / (span * factor) < _PLAUSIBLE[1]
        ]
        if len(fits) == 1:
            step = span / (len(values) - 1)
            self.notes.append(
                f"Its time has no unit; steps of {step:.3g} are samples of a press in {fits[0][1]} only, so "
                "it is taken so."
            )
            return fits[0]
        self.questions.append(Question("unit time", "the unit of its time", "--unit time=s"))
        return None

    def _base(self, time: tuple[float, str] | None) -> TimeBase | None:
        """The time base; None and a question without one."""
        table, told = self.table, self.told
        base: TimeBase | None = None
        if told.rate_hz is not None:
            base = TimeBase(told.rate_hz, (f"{told.rate_hz:g} samples/s, as told",))
        elif "time" in self.taken:
            if time is None:
                return None
            column = table.columns[self.taken["time"][0]]
            base = time_base(table.path, column.values, time[0], table.rate_hz)
            if table.rate_hz is not None and abs(base.rate_hz / table.rate_hz - 1) > 0.01:
                raise DataError(
                    f"{table.path} has stamps of {base.rate_hz:g} samples/s, but states {table.rate_hz:g} "
                    f"({table.rate_from}): say which is right (--rate)."
                )
        elif table.rate_hz is not None:
            base = TimeBase(
                table.rate_hz, (f"{table.rate_hz:g} samples/s, as the file says ({table.rate_from})",)
            )
        else:
            own = {c.rate_hz for r, (n, _) in self.taken.items() if (c := table.columns[n]).rate_hz}
            if len(own) == 1:
                rate = own.pop()
                assert rate is not None
                base = TimeBase(rate, (f"{rate:g} samples/s, as the file says",))
            elif own:
                rates = ", ".join(f"{rate:g}" for rate in sorted(filter(None, own)))
                raise DataError(
                    f"{table.path} has columns of several rates ({rates} samples/s): export those that "
                    "belong together at one rate."
                )
        if base is None:
            self.questions.append(Question(
                "rate", "its sample rate, or which column is the time", "--rate HZ or --time COLUMN")
            )  # fmt: skip
            return None
        if not _SLOWEST <= base.rate_hz <= _FASTEST:
            raise ConfigurationError(
                f"{table.path} would have {base.rate_hz:g} samples/s: from {_SLOWEST:g} to {_FASTEST:g} are "
                "possible, so look at its time or at --rate."
            )
        self.notes += [f"Time: {one}." for one in base.said]
        self.holes += holes_of(base)
        return base

    def _values(self, role: Role, number: int, factor: float, base: TimeBase | None) -> FloatArray:
        assert base is not None
        path, values = self.table.path, self.table.columns[number].values
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
            longest = max(hole.end - hole.first for hole in missing) / base.rate_hz
            if count > 0.1 * len(values):
                raise DataError(f"The column {name!r} of {path} lacks {count} of {len(values)} values.")
            self.notes.append(
                f"{name}: {count} value{'s are' if count > 1 else ' is'} missing, at most "
                f"{1e3 * longest:.3g} ms in a row; filled by a straight line."
            )
            self.holes += missing
        found = factor * on_grid(base, whole)
        if (most := float(np.abs(found).max())) > _MOST[role]:
            raise ConfigurationError(
                f"The column {name!r} of {path} would reach {most:g} {SI[role]}: look at its unit (--unit)."
            )
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
        told = self.told.rest.get(role)
        rest = rest_of(values, rate_hz)
        falls, said = rest.falls(told), rest.words(told, SI[role])
        self.notes.append(f"{role.capitalize()} at rest: {said}.")
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


def _constant(values: FloatArray) -> bool:
    finite = values[np.isfinite(values)]
    return not len(finite) or not np.ptp(finite)


def _listed(parts: list[str], last: str) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} {last} {parts[-1]}"
