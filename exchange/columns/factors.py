"""Factors that a file states beside its numbers: a gain, a scale, a multiplier.

What a format defines (CF's `scale_factor`, NWB's `conversion`) its reader applies. Of any other factor
nothing says whether it is in the numbers already: that is a doubt of their unit, and asked. A factor with a
unit of its own (`100 mV/g`, `0.05 V/div`) makes another quantity of a number, so it is no doubt of a column
that states its unit.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from .table import Column
from .units import units_of

_FACTOR = re.compile(
    r"(?<![a-z])((scal(e|es|ing)|calibration|cal|conversion|conv)[ .]{0,2}(factors?|constant|coefficient)|"
    r"(skalierungs|skalen|umrechnungs|kalibrier|verst[aä]rkungs|teiler)?faktor(en)?|factors?|scal(e|es|ing)|"
    r"skalierung|gains?|verst[aä]rkung|amplification|(?<!probe )attenuation|multipliers?|"
    r"(multiplied|multiply|scaled|amplified|divided) (by|with)|divisor|slope|sensitivity|sensitivities|"
    r"empfindlichkeit|kennwert)(?![a-z])"
    r"[^a-z0-9+-]{0,12}( ?(setting|value|of|is|was|set to|used) )?"
    r"((in )?(?P<unit>[a-z%][a-z%/]{0,9}) ?[)\]}]|[x×](?=[ \d]))?[^a-z0-9+-]{0,12}"
    r"(?P<number>[-+]?(\d+([.,]\d+)?|[.,]\d+)(e[-+]?\d+)?)(?![\d:])(?P<rest>( +[-+]?[\d.]+)*)"
    r"[ \"']*(?P<after>[a-z%µ][^\s\"',;)]{0,15}|/\w+)?",
    re.I)  # fmt: skip
_NOT_OURS = re.compile(
    r"(?<![a-z])(horizontal|vertical|time|full|gr[ae]y|colou?r|temperature|trigger|gauge|gage|k|q|crest|"
    r"power|duty|form|safety|quality|over ?sampling|decimation|down ?sampling|damping|interpolation|zoom|"
    r"loop|control|[pid]|pid|feedback|proportional|integral|derivative|ramp)[ :]{0,3}\Z",
    re.I)  # fmt: skip
"""Words before a factor of something else.."""
_PURE = ("db", "%")
"""Units of a number that changes no quantity."""
_WORD = re.compile(r"(?<=[a-z])(?=[A-Z])|[\s_.-]+")
_MOST = 16
"""Values of a column that is a factor: a gain may be switched."""


@dataclass(frozen=True)
class Factor:
    """A factor other than 1."""

    words: str
    """As the file states it."""
    pure: bool
    """False for one with a unit of its own."""

    @property
    def doubt(self) -> str:
        """For a question about the columns beside it; "" for one with a unit."""
        return f"{self.words!r} may be in its numbers already, or not" if self.pure else ""


def factor_in(line: str) -> Factor | None:
    """The first factor other than 1 that a line states."""
    for match in _FACTOR.finditer(line):
        number = float(match["number"].replace(",", "."))
        unit = (match["after"] or match["unit"] or "").strip()
        none = number == (0 if unit.lower() == "db" else 1) and set(match["rest"].split()) <= {"1", "1.0"}
        if none or _NOT_OURS.search(line[: match.start()]):
            continue
        return Factor(
            line.strip(" ,;#%\"'")[:60],
            "/" not in unit and not (units_of(unit) and unit.lower() not in _PURE),
        )
    return None


def is_factor(name: str) -> bool:
    """True for the name of a factor: `scaleFactor`, `Gain (dB)`, `Verstärkung CH1`."""
    return factor_in(f"{_words(name)} : 2") is not None


def doubt_beside(entries: Mapping[str, object]) -> str:
    """The doubt of numbers beside which entries of a file stand: numbers, texts, or arrays of these."""
    for name, value in entries.items():
        if not is_factor(name) or not (each := np.ravel(np.asarray(value)).tolist()):
            continue
        numbers = [one for one in each if isinstance(one, int | float)]
        said = f"{max(numbers, key=lambda one: abs(one - 1)):g}" if numbers else str(each[0])[:20]
        if found := factor_in(f"{_words(name)} = {said}"):
            return replace(found, words=f"{name} = {said}").doubt
    return ""


def doubt_among(columns: Sequence[Column]) -> str:
    """The doubt that a column of a factor, constant or of a few values, leaves of those beside it."""
    for column in columns:
        if not column.unit and is_factor(column.name):
            values = np.unique(column.values[np.isfinite(column.values)])
            if len(values) <= _MOST and (doubt := doubt_beside({column.name: values})):
                return doubt
    return ""


def _words(name: str) -> str:
    return " ".join(filter(None, _WORD.split(name)))
