"""A vibration map on disk: a folder that is whole at every moment, so that it can be gone on with.

`map.json` is the plan, written first. Each step of it becomes one small file that is written whole or
not at all and never changed; a file that is damaged is put aside and its step measured again. A
point that could not be measured leaves a note with the reason, and is asked for again next time.
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

from haploop.acquisition import hdf5
from haploop.calibration.response import Multisine
from haploop.instruments import ConfigurationError, DataError
from haploop.instruments.arrays import ComplexArray
from haploop.instruments.files import new_file, os_error_text, publish

__all__ = ["MapFolder", "MapPlan", "PointMeasurement", "Step"]

_PLAN = "map.json"
FORMAT = 1


@dataclass(frozen=True)
class Step:
    """One aiming of the laser, and what is played there.

    `plays` are patches, one after the other; "each" for all at once, each its own drive; "all" for
    all in parallel with the same drive. `again` marks a point that was measured before.
    """

    name: str
    point: str
    plays: tuple[str, ...]
    again: bool = False


@dataclass(frozen=True)
class MapPlan:
    """What a map measures: everything that makes its points comparable with each other."""

    rig: str
    rig_file: str
    """The rig as it is: its file as JSON."""
    simulated: bool
    rows: int
    columns: int
    points: tuple[str, ...]
    patches: tuple[str, ...]
    together: bool
    """All patches at once, on interleaved lines, instead of one after the other."""
    level: float
    """Peak of each drive (V)."""
    rate_hz: float
    low: float
    high: float
    period: float
    tests: tuple[str, ...]
    """Points at which all patches are also played in parallel, to test superposition."""
    every: int
    """Points after which the first is measured again, to see the table drift."""

    @property
    def digest(self) -> str:
        """SHA-256 of the plan."""
        return hashlib.sha256(json.dumps(dataclasses.asdict(self), sort_keys=True).encode()).hexdigest()

    def multisine(self, patch: str) -> Multisine:
        """What a patch plays, alone or with the others."""
        lines: Any = (self.patches.index(patch), len(self.patches)) if self.together else "odd"
        return Multisine(low=self.low, high=self.high, period=self.period, lines=lines)

    @property
    def parallel(self) -> Multisine:
        """What all patches play in parallel."""
        return Multisine(low=self.low, high=self.high, period=self.period)

    @property
    def steps(self) -> tuple[Step, ...]:
        """In the order that they are measured in."""
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
        """Seconds of playing, all steps together."""
        return self.period * sum(len(step.plays) for step in self.steps)


@dataclass(frozen=True, eq=False)
class PointMeasurement:
    """Measurement of one step: spectra at `lines` over the period, so at all lines of the band.

    `drives` is (rows, lines) V at the patches at the clock's edges, `rows` says which play and which
    patch; `velocity` is (plays, lines) m/s. Both are sums over samples, as `rfft` gives them.
    """

    plan: str
    """Digest of the plan that it belongs to."""
    step: str
    point: str
    plays: tuple[str, ...]
    rows: tuple[tuple[int, str], ...]
    drives: ComplexArray
    velocity: ComplexArray
    light: float
    """Share of the light that came back; NaN where the vibrometer does not report it."""
    seconds: float
    """Of the table's time."""
    created: str


@dataclass(frozen=True)
class MapFolder:
    """A folder with the plan in it."""

    path: Path
    plan: MapPlan

    @classmethod
    def create(cls, path: Path, plan: MapPlan) -> MapFolder:
        """Begin a map, or go on with the one that is there.

        Raises ConfigurationError when the folder holds something else, or a map of another plan.
        """
        if (path / _PLAN).is_file():
            there = cls.open(path)
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
        text = json.dumps(
            {"format": FORMAT, "plan": dataclasses.asdict(plan), "sha256": plan.digest}, indent=1
        )
        with new_file(path / _PLAN) as part:
            part.write_text(text, encoding="utf-8")
        return cls(path, plan)

    @classmethod
    def open(cls, path: Path) -> MapFolder:
        """A map that is there. Raises DataError when there is none, or its plan is damaged."""
        try:
            raw = json.loads((path / _PLAN).read_text(encoding="utf-8"))
        except OSError:
            raise DataError(f"{path} holds no map: there is no {_PLAN} in it.") from None
        except ValueError:
            raise DataError(f"{path / _PLAN} is damaged: it cannot be read.") from None
        try:
            if raw["format"] != FORMAT:
                raise DataError(
                    f"{path / _PLAN} has format {raw['format']}, and this version reads {FORMAT}."
                )
            fields: dict[str, Any] = raw["plan"]
            for key, value in fields.items():
                fields[key] = tuple(value) if isinstance(value, list) else value
            plan = MapPlan(**fields)
            whole = plan.digest == raw["sha256"]
        except (KeyError, TypeError):
            whole = False
        if not whole:
            raise DataError(f"{path / _PLAN} is damaged: its content does not match its hash.")
        return cls(path, plan)

    def file(self, step: Step) -> Path:
        """The file of a step's measurement, written or not."""
        return self.path / f"{step.name}.h5"

    def read(self, step: Step) -> PointMeasurement | None:
        """What a step measured; None when it has not been. Raises DataError for a damaged file."""
        path = self.file(step)
        if not path.exists():
            return None
        measurement = hdf5.restore(PointMeasurement, hdf5.read(path, "map point"), path)
        if measurement.plan != self.plan.digest or measurement.step != step.name:
            raise DataError(f"{path} belongs to another map.")
        return measurement

    def write(self, step: Step, measurement: PointMeasurement) -> None:
        """Keep what a step measured. Raises DataError."""
        hdf5.write(self.file(step), "map point", hdf5.flatten(measurement))

    def left(self) -> Iterator[Step]:
        """Steps without a complete measurement, in order; damaged files are moved aside on the way."""
        for step in self.plan.steps:
            try:
                done = self.read(step) is not None
            except DataError:
                self._put_aside(step)
                done = False
            if not done:
                yield step

    def skip(self, step: Step, reason: str) -> None:
        """Note why a step was not measured."""
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
        """Move a damaged file into a folder of its own, not in place of another one."""
        aside = self.path / "damaged"
        try:
            aside.mkdir(exist_ok=True)
            publish(self.file(step), _free(aside / f"{step.name}.{number}.h5" for number in count()))
        except OSError as error:
            raise DataError(
                f"{self.file(step)} is damaged and cannot be moved to {aside}: {os_error_text(error)}."
            ) from None


def _free(paths: Iterator[Path]) -> Path:
    """The first of these names that is not taken."""
    return next(path for path in paths if not os.path.lexists(path))


def _short(value: object) -> str:
    text = str(value)
    return text if len(text) <= 60 else text[:57] + "..."
