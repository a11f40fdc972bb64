"""What a person says of a lab's files: which column is what, in which unit. A small TOML file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, field_validator

from ...base.files import new_file
from ...base.toml_lines import parse_toml, read_text
from ...base.validation import validate
from ..columns import SI, zone_of
from .rest import End

Role = Literal["time", "force", "acceleration", "displacement", "activation"]
ROLES: tuple[Role, ...] = ("time", "force", "acceleration", "displacement", "activation")
"""What a column can be; acceleration is the vertical one."""
MEASURED: tuple[Role, ...] = ("force", "acceleration", "displacement")
"""Roles with a unit."""
_TABLES = ("units", "rest", "where")
"""Entries with entries of their own."""
NONE = "none"
"""Told as a column: no column is that role."""
Place = Annotated[int, Field(ge=0, le=9999)] | Annotated[str, Field(min_length=1, max_length=200)] | None
_QUANTITIES = {role: SI[role] for role in ROLES if role in SI}


class FileMapping(BaseModel):
    """What is not told is taken from the file where it states it, and asked for where it does not."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    time: Place = None
    """Column of the time: a heading, or a number from 0."""
    force: Place = None
    acceleration: Place = None
    displacement: Place = None
    activation: Place = None
    rate_hz: float | None = None
    """Samples per second; a column of time is then not looked at."""
    units: dict[str, str] = Field(default_factory=dict)
    """By role: a unit (mN), what one of the file's units is (40 N), or a sensitivity (100 mV/g)."""
    flip: tuple[Role, ...] = ()
    """Roles whose sign is changed: force and displacement rise when pressed, acceleration is positive up."""
    rest: dict[str, End] = Field(default_factory=dict)
    """By role: whether its start or its end shows it without a finger, where the two disagree."""
    where: dict[str, str] = Field(default_factory=dict)
    """Of a table of several measurements, by column: the value of the rows to take, or * for all."""
    skip_damaged: bool = False
    """Leave damaged rows of a text out, as gaps."""
    format: str | None = None
    """How the file is read; by default as its name ends."""
    zone: str | None = None
    """Time zone of dates that state none: an offset (+02:00) or a place (Europe/Berlin)."""
    decimal: Literal[",", "."] | None = None
    """Decimal sign of a text, where the file leaves a doubt."""
    make: Literal["recording", "press", "curve"] | None = None
    """A recording of all presses, or the representative press that one press is."""
    button: str | None = None
    participant: str | None = None
    names: str | None = None
    """Pattern of files' names without their ending, * for anything: "{participant}_{button}_*"."""

    @field_validator("units")
    @classmethod
    def _of_roles(cls, units: dict[str, str]) -> dict[str, str]:
        for role in units:
            if role not in (*_QUANTITIES, "response"):
                raise ValueError(f"{role!r} has no unit: use {', '.join(_QUANTITIES)}")
        return units

    @field_validator("zone")
    @classmethod
    def _that_is(cls, zone: str | None) -> str | None:
        if zone is not None and zone_of(zone) is None:
            raise ValueError(f"{zone!r} is no time zone: write +02:00, UTC or Europe/Berlin")
        return zone

    @field_validator("rest")
    @classmethod
    def _that_rest(cls, rest: dict[str, End]) -> dict[str, End]:
        for role in rest:
            if role not in ("force", "displacement"):
                raise ValueError(f"{role!r} has no rest: use force, displacement")
        return rest

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a mapping's file. Raises ConfigurationError."""
        path = Path(path)
        text = read_text(path, f"There is no mapping {path}: make one with --save-mapping.")
        return validate(cls, parse_toml(text, path), str(path))

    @classmethod
    def told(cls, said: dict[str, Any], source: str) -> Self:
        """A mapping of these values. Raises ConfigurationError that begins with `source`."""
        return validate(cls, said, source)

    def but(self, told: FileMapping) -> FileMapping:
        """The mapping, changed by what another one says."""
        said = told.model_dump(exclude_unset=True)
        tables = {name: {**getattr(self, name), **getattr(told, name)} for name in _TABLES}
        return self.model_copy(update={**said, **tables, "flip": tuple({*self.flip, *told.flip})})

    def save(self, path: str | Path) -> None:
        """Write a new file, without who pressed what: the next file may be another's.

        Raises ConfigurationError when it exists or cannot be written.
        """
        lines = ["# How haploop reads this lab's files: haploop import FILE --mapping THIS"]
        for key, value in self.model_dump(exclude={*_TABLES, "participant", "button"}).items():
            if value is not False and value not in (None, ()):
                lines.append(f"{key} = {json.dumps(value, ensure_ascii=False)}")
        for name in _TABLES:
            if table := getattr(self, name):
                said = (f"{json.dumps(key, ensure_ascii=False)} = {json.dumps(value, ensure_ascii=False)}"
                        for key, value in table.items())  # fmt: skip
                lines += ["", f"[{name}]", *said]
        with new_file(path) as part:
            part.write_text("\n".join(lines) + "\n", encoding="utf-8")
