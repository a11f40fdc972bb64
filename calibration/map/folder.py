"""A vibration map on disk: a folder that is consistent at every moment, so that a run can be continued.

`map.json` is the plan, written first. Each step becomes one small file, written atomically and never
changed; a damaged file is moved aside and its step measured again. A point that could not be measured
leaves a note with the reason, and is tried again in the next run.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from ...base import hdf5
from ...base.arrays import ComplexArray
from ...base.errors import ConfigurationError, DataError
from ...base.files import new_file, os_error_text
from ...base.json_files import read_json, write_json
from ...base.publishing import publish
from ..response import LinearSweep, Multisine

_PLAN = "map.json"
_ABOVE_HZ = 15.0
"""Distance (Hz) from the band's upper end to that of a sweep."""
_BESIDES = 100_000
"""Bytes of a step's file that are no spectra, at most."""


@dataclass(frozen=True)
class Step:
    """One aiming of the laser, and the plays at that point.

    `plays` are patches, one after the other; "each" for all at once with different drives; "all" for
    all in parallel with the same drive. `again` marks a repeated measurement of a point.
    """

    name: str
    point: str
    plays: tuple[str, ...]
    again: bool = False


@dataclass(frozen=True)
class MapPlan:
    """Plan of a map: all settings that must be equal for its points to be comparable."""

    rig: str
    rig_file: str
    """The rig file as JSON."""
    simulated: bool
    rows: int
    columns: int
    points: tuple[str, ...]
    patches: tuple[str, ...]
    together: bool
    """True when all patches play at once, on interleaved lines, instead of one after the other."""
    level: float
    """Peak of each drive (V)."""
    rate_hz: float
    low: float
    high: float
    period: float
    tests: tuple[str, ...]
    """Points at which all patches are also played in parallel, to test superposition."""
    every: int
    """Number of points after which the first is measured again, to detect drift of the table."""
    swept: bool = False
    """True when the generator sweeps the patches, as in the paper, and the DAQ plays nothing."""

    @property
    def digest(self) -> str:
        """SHA-256 of the plan, which each of its measurements states."""
        return hashlib.sha256(json.dumps(dataclasses.asdict(self), sort_keys=True).encode()).hexdigest()

    def multisine(self, patch: str) -> Multisine:
        """Multisine that a patch plays, alone or with the others."""
        lines: Any = (self.patches.index(patch), len(self.patches)) if self.together else "odd"
        return Multisine(low=self.low, high=self.high, period=self.period, lines=lines)

    @property
    def parallel(self) -> Multisine:
        """Multisine that all patches play in parallel."""
        return Multisine(low=self.low, high=self.high, period=self.period)

    @property
    def steps(self) -> tuple[Step, ...]:
        """Steps in the order of measurement."""
        plays = ("each",) if self.together else self.patches
        steps = []
        for number, point in enumerate(self.points):
            if number and number % self.every == 0:
                steps.append(Step(f"again-{number:03d}", self.points[0], plays[:1], again=True))
            steps.append(Step(f"point-{point}", point, (*plays, "all") if point in self.tests else plays))
        if len(self.points) > 1:
            steps.append(Step(f"again-{len(self.points):03d}", self.points[0], plays[:1], again=True))
        return tuple(steps)

    @property
    def duration(self) -> float:
        """Playing time of all steps together (s)."""
        return self.seconds * sum(len(step.plays) for step in self.steps)

    @property
    def seconds(self) -> float:
        """Time of one play (s)."""
        return self.sweep.seconds + self.sweep.tail if self.swept else self.period

    @property
    def sweep(self) -> LinearSweep:
        """The generator's sweep: it ends above the band, because it does not fade."""
        return LinearSweep(stop_hz=self.high + _ABOVE_HZ)

    def size(self, step: Step) -> int:
        """Room that the file of a step takes at most (bytes)."""
        patches = sum(len(self.patches) if play in ("each", "all") else 1 for play in step.plays)
        lines = (self.high - self.low) * self.period + 1
        return round(np.dtype(complex).itemsize * lines * (patches + len(step.plays))) + _BESIDES


_PLANS = TypeAdapter(MapPlan)


@dataclass(frozen=True, eq=False)
class PointMeasurement:
    """Measurement of one step: spectra at all lines of the band, excited or not.

    `drives` is (rows, lines) V at the patches at the clock's edges, and `rows` holds the (play, patch) of
    each; `velocity` is (plays, lines) m/s. Both are unnormalised, as from `rfft`.
    """

    plan: str
    """Digest of its plan."""
    step: str
    point: str
    plays: tuple[str, ...]
    rows: tuple[tuple[int, str], ...]
    drives: ComplexArray
    velocity: ComplexArray
    light: float
    """Signal level as a fraction of full light; NaN where the vibrometer does not report it."""
    seconds: float
    """Time that the table was in use (s)."""
    created: str


@dataclass(frozen=True)
class MapFolder:
    """A folder with the plan in it."""

    path: Path
    plan: MapPlan

    @classmethod
    def create(cls, path: Path, plan: MapPlan) -> MapFolder:
        """Begin a map, or continue an existing one.

        A plan of which nothing was measured or skipped gives way to another. Raises ConfigurationError when
        the folder holds something else, or a map of another plan.
        """
        if (path / _PLAN).is_file():
            there = cls.open(path)
            if there.plan != plan and [one.name for one in path.iterdir()] == [_PLAN]:
                (path / _PLAN).unlink()
                return cls.create(path, plan)
            for field in dataclasses.fields(MapPlan):
                old, new = getattr(there.plan, field.name), getattr(plan, field.name)
                if old != new:
                    difference = (
                        "the rig file is not what it was"
                        if field.name == "rig_file"
                        else (f"its {field.name} is {_short(old)} and not {_short(new)}")
                    )
                    raise ConfigurationError(
                        f"{path} holds a map that cannot be continued: {difference}. Name another folder."
                    )
            return there
        if path.exists() and (not path.is_dir() or any(path.iterdir())):
            raise ConfigurationError(f"{path} is there and holds no map: name a new folder.")
        path.mkdir(parents=True, exist_ok=True)
        write_json(path / _PLAN, "map", dataclasses.asdict(plan))
        return cls(path, plan)

    @classmethod
    def open(cls, path: Path) -> MapFolder:
        """Open an existing map. Raises DataError when there is none, or its plan is damaged."""
        if not (path / _PLAN).is_file():
            raise DataError(f"{path} holds no map: there is no {_PLAN} in it.")
        fields = read_json(path / _PLAN, "map", dict)
        try:
            return cls(path, _PLANS.validate_python(fields))
        except ValidationError:
            raise DataError(
                f"{path / _PLAN} holds no plan of a map: it was not written by haploop."
            ) from None

    def file(self, step: Step) -> Path:
        """The file of a step's measurement, written or not."""
        return self.path / f"{step.name}.h5"

    def read(self, step: Step) -> PointMeasurement | None:
        """Measurement of a step; None before it was measured. Raises DataError for a damaged file."""
        path = self.file(step)
        if not path.exists():
            return None
        measurement = hdf5.restore(PointMeasurement, hdf5.read(path, "map point"), path)
        if measurement.plan != self.plan.digest or measurement.step != step.name:
            raise DataError(f"{path} belongs to another map.")
        return measurement

    def write(self, step: Step, measurement: PointMeasurement) -> None:
        """Save the measurement of a step. Raises DataError."""
        hdf5.write(self.file(step), "map point", hdf5.flatten(measurement))

    def left(self) -> Iterator[Step]:
        """Yield the steps without a complete measurement, in order; damaged files are moved aside."""
        for step in self.plan.steps:
            try:
                done = self.read(step) is not None
            except DataError:
                self._put_aside(step)
                done = False
            if not done:
                yield step

    def skip(self, step: Step, reason: str) -> None:
        """Note the reason why a step was not measured."""
        note = _free(self.path / f"{step.name}.skipped-{number:03d}.txt" for number in count())
        with new_file(note) as part:
            part.write_text(reason + "\n", encoding="utf-8")

    def skipped(self) -> dict[str, str]:
        """Points without a complete measurement, and the reason of the last failed attempt."""
        found = {}
        for step in self.plan.steps:
            notes = sorted(self.path.glob(f"{step.name}.skipped-*.txt"))
            if notes and not self.file(step).exists() and not step.again:
                found[step.point] = notes[-1].read_text(encoding="utf-8").strip()
        return found

    def _put_aside(self, step: Step) -> None:
        """Move a damaged file into the folder `damaged`, without replacing another one."""
        aside = self.path / "damaged"
        try:
            aside.mkdir(exist_ok=True)
            publish(self.file(step), _free(aside / f"{step.name}.{number}.h5" for number in count()))
        except OSError as error:
            raise DataError(
                f"{self.file(step)} is damaged and cannot be moved to {aside}: {os_error_text(error)}."
            ) from None


def _free(paths: Iterator[Path]) -> Path:
    """The first of these paths that does not exist."""
    return next(path for path in paths if not os.path.lexists(path))


def _short(value: object) -> str:
    text = str(value)
    return text if len(text) <= 60 else text[:57] + "..."
