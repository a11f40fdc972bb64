"""Frequency responses in MATLAB, HDF5 and NumPy files: a complex array over a vector of frequencies."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ...calibration import Response
from ...calibration.response import POWERS, per_unit, plain_response
from ...instruments import ConfigurationError, DataError
from .contained import Tree, tree_of

_FREQUENCY = re.compile(r"(f|fv|faxis|freqs?|frequency|frequencies)(hz|axis|vector)?\Z")
_EXAMPLE = "--unit 'response=(m/s)/V'"


def has_responses(path: Path) -> bool:
    """True for a file with a response. Raises DataError, ConfigurationError where a package is missing."""
    return bool(responses_of(tree_of(path)))


def responses_of(tree: Tree) -> list[tuple[str, str]]:
    """Names of each complex array and of its frequencies. Raises DataError for several such."""
    found = []
    for name, values in tree.arrays.items():
        if not np.iscomplexobj(values):
            continue
        fits = [
            other
            for other, f in tree.arrays.items()
            if f.ndim == 1
            and not np.iscomplexobj(f)
            and len(f) in values.shape
            and _FREQUENCY.match(re.sub(r"[^a-z]", "", other.rpartition(".")[2].lower()))
        ]
        if len(fits) > 1:
            raise DataError(f"{', '.join(fits)} could each be the frequencies of {name!r}: save one of them.")
        if fits:
            found.append((name, fits[0]))
    return found


def read_responses(path: Path, unit: str | None) -> tuple[Response, ...]:
    """The responses of a file; `unit` is what they are in where the file does not say.

    Raises ConfigurationError for a unit that is not stated or is another than m, m/s or m/s^2 per V,
    DataError for a file that cannot be read.
    """
    tree = tree_of(path)
    made = []
    for name, over in responses_of(tree):
        stated = next(
            (t for k in (f"units.{name}", f"{name}.units", f"{name}.unit") if (t := tree.texts.get(k))), ""
        )
        factor, power = _velocity_per(path, name, stated, unit)
        f, H = tree.arrays[over], np.atleast_2d(tree.arrays[name])
        H = H if H.shape[1] == len(f) else H.T
        if not (np.all(np.isfinite(f)) and np.all(np.diff(f) > 0) and np.all(np.isfinite(H))):
            raise DataError(
                f"{path}: {over!r} does not rise, or {name!r} holds no finite numbers everywhere."
            )
        kept = f > 0
        share = tree.arrays.get("coherence")
        share = np.zeros((len(H), 0)) if share is None else np.atleast_2d(share)
        places = [tree.lists.get(key) or [tree.texts.get(key, "")] for key in ("patches", "points")]
        for row, values in enumerate(H):
            patch, point = (of[row] if row < len(of) and of[row] else str(row + 1) for of in places)
            own = share[row][kept] if row < len(share) and share.shape[1] == len(f) else np.zeros(0)
            velocity = factor * values[kept] * (2j * np.pi * f[kept]) ** power
            simulated = bool(tree.numbers.get("about.simulated", 0.0))
            made.append(plain_response(patch, point, f[kept], velocity, own, simulated=simulated))
    return tuple(made)


def _velocity_per(path: Path, name: str, stated: str, told: str | None) -> tuple[float, int]:
    """Factor, and power of 2 pi i f, from a response to m/s per V."""
    text = told or stated
    if not text:
        raise ConfigurationError(
            f"{path} does not say what its frequency response {name!r} is in: add, for example, {_EXAMPLE}."
        )
    found = per_unit(text)
    if found is None or found[0][0] not in POWERS or found[1][0] != "V":
        raise ConfigurationError(
            f"{path}: {text!r} is no unit of a response to a patch: displacement, velocity or acceleration "
            f"per volt is needed, for example {_EXAMPLE}."
        )
    return found[0][1] / found[1][1], POWERS[found[0][0]]
