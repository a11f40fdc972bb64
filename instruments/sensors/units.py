"""Numbers with units as data sheets write them: "100 mV/g", "-4.3 pC/N", "2 mV/V", "20 mm/s/V".

A unit is names divided or multiplied, with whole powers and parentheses; `g` is the acceleration of
gravity. Values are returned in SI.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping

G = 9.80665
"""Standard gravity (m/s^2)."""

Dimensions = Counter[str]
"""Powers of the units that are not made of others here: V, A, N, m, s, C, F, ohm, W. Zeros are left out."""

_PREFIXES = {"p": 1e-12, "n": 1e-9, "u": 1e-6, "µ": 1e-6, "μ": 1e-6, "m": 1e-3, "k": 1e3, "M": 1e6}
_BASES = ("V", "A", "N", "m", "s", "C", "F", "ohm", "W", "g")
_OTHERS: dict[str, tuple[float, dict[str, int]]] = {
    "%": (0.01, {}),
    "cm": (0.01, {"m": 1}),
    "in": (0.0254, {"m": 1}),
    "gf": (1e-3 * G, {"N": 1}),
    "kgf": (G, {"N": 1}),
    "kp": (G, {"N": 1}),
    "lbf": (4.4482216152605, {"N": 1}),
    "lb": (4.4482216152605, {"N": 1}),
    "oz": (4.4482216152605 / 16, {"N": 1}),
    "ozf": (4.4482216152605 / 16, {"N": 1}),
    "Hz": (1.0, {"s": -1}),
    "kHz": (1e3, {"s": -1}),
}
_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*)\s*", re.DOTALL)
_TOKEN = re.compile(r"\s*([A-Za-zµμ%]+|\^?-?\d+|[()/*·])")


def value_of(text: str, *units: str) -> float:
    """Value in SI of a number with one of these units, of any prefix. Raises ValueError with a clause."""
    value, found = with_unit(text)
    if found not in [dimensions(unit) for unit in units]:
        raise ValueError(f"{text!r} is not in {' or '.join(units)}")
    return value


def with_unit(text: str) -> tuple[float, Dimensions]:
    """Value in SI of a number with a unit, and its dimensions. Raises ValueError with a clause."""
    match = _NUMBER.fullmatch(text)
    if match is None:
        raise ValueError(f"{text!r} does not begin with a number: write it as '100 mV/g'")
    factor, found = _unit(match[2].replace("²", "^2").replace("³", "^3"), text)
    return float(match[1]) * factor, found


def dimensions(unit: str) -> Dimensions:
    """Dimensions of a unit. Raises ValueError with a clause."""
    return _unit(unit, unit)[1]


def _unit(unit: str, text: str) -> tuple[float, Dimensions]:
    tokens: list[str] = []
    at = 0
    while at < len(unit.rstrip()):
        match = _TOKEN.match(unit, at)
        if match is None or len(tokens) > 30:
            raise ValueError(f"{text!r} has no unit that is known, such as mV/g, pC/N, N/V or mm/V")
        tokens.append(match[1])
        at = match.end()
    factor, found = _product(tokens, text)
    if tokens:
        raise ValueError(f"{text!r} has a parenthesis too many")
    return factor, Counter({name: power for name, power in found.items() if power})


def _product(tokens: list[str], text: str) -> tuple[float, Dimensions]:
    """Product of the factors up to a closing parenthesis, which is left; tokens are taken from the front."""
    factor, found, sign = 1.0, Counter[str](), 1
    powers: Mapping[str, int]
    while tokens and tokens[0] != ")":
        token = tokens.pop(0)
        if token in "/*·":
            sign = -1 if token == "/" else 1
            continue
        if token == "(":
            own, powers = _product(tokens, text)
            if not tokens:
                raise ValueError(f"{text!r} lacks a closing parenthesis")
            tokens.pop(0)
        else:
            own, powers = _named(token, text)
        power = int(tokens.pop(0).lstrip("^")) if tokens and tokens[0].lstrip("^-").isdigit() else 1
        if abs(power) > 4:
            raise ValueError(f"{text!r} has a power of {power}")
        factor *= own ** (sign * power)
        for name, count in powers.items():
            found[name] += sign * power * count
        sign = 1
    return factor, found


def _named(name: str, text: str) -> tuple[float, dict[str, int]]:
    if name in _OTHERS:
        return _OTHERS[name]
    prefix, base = (name[:1], name[1:]) if name not in _BASES and name[:1] in _PREFIXES else ("", name)
    if base not in _BASES:
        raise ValueError(f"{text!r} has the unknown unit {name!r}: use V, N, g, m, s, C and their prefixes")
    factor = _PREFIXES.get(prefix, 1.0)
    return (factor * G, {"m": 1, "s": -2}) if base == "g" else (factor, {base: 1})
