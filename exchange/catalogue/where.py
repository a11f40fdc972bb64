"""Conditions on files, as `NAME=VALUE`, and their SQL."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import fields

from ...base.errors import ConfigurationError
from .entry import KINDS, Entry

_NAMES = [field.name for field in fields(Entry)]
_SHAPE = re.compile(r"\s*(\w+)\s*(!=|>=|<=|=)\s*(.*?)\s*")
_SQL = {"=": "GLOB", "!=": "NOT GLOB", ">=": ">=", "<=": "<="}


def condition(where: Sequence[str]) -> tuple[str, list[str]]:
    """SQL of conditions that must all hold, and its parameters.

    A condition is NAME=VALUE or NAME!=VALUE, where `*` in VALUE stands for anything, or NAME>=VALUE or
    NAME<=VALUE, which compare as text: dates, say, of which the beginning is enough. Raises
    ConfigurationError.
    """
    terms, values = ["1"], []
    for one in where:
        match = _SHAPE.fullmatch(one)
        if match is None or match[1] not in _NAMES:
            raise ConfigurationError(
                f"{one!r} is no condition: write NAME=VALUE, NAME!=VALUE, NAME>=VALUE or NAME<=VALUE with a "
                f"name of {', '.join(_NAMES)}."
            )
        name, operator, value = match.groups()
        if name == "kind" and "*" not in value and value not in KINDS and operator in ("=", "!="):
            raise ConfigurationError(f"There is no kind {value!r}: the kinds are {', '.join(KINDS)}.")
        # `date<=2026-11` includes that month, as `date=2026-11*` does.
        column = f"substr({name}, 1, {len(value)})" if operator == "<=" else name
        terms.append(f"{column} {_SQL[operator]} ?")
        # A bracket is a bracket: GLOB would take it for a set of characters.
        values.append(value.replace("[", "[[]") if operator in ("=", "!=") else value)
    return " AND ".join(terms), values
