"""Frequency responses in a tree of arrays: a complex array, or two real ones, over a vector of frequencies.

MATLAB, HDF5, NumPy and netCDF files are such trees; CSV files as haploop exports responses become one.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.errors import ConfigurationError, DataError
from ...calibration import Response
from ...calibration.response import POWERS, per_unit, plain_response
from ..views import read_sidecar
from .contained import Tree, tree_of

_FREQUENCY = re.compile(r"(f|fv|faxis|freqs?|frequency|frequencies)(hz|axis|vector)?\Z")
_PARTS = (("_real", "_imaginary"), ("_real", "_imag"), ("_re", "_im"))
"""Endings of the names of a complex array's two parts."""
_EXAMPLE = "--unit 'response=(m/s)/V'"


def has_responses(path: Path) -> bool:
    """True for a file with a response. Raises DataError, ConfigurationError where a package is missing."""
    return "responses" in read_sidecar(path) or bool(responses_of(tree_of(path)))


def _of_csv(path: Path) -> Tree:
    """The tree of a CSV file that haploop wrote, with its sidecar. Raises DataError for a changed one."""
    said, tree = read_sidecar(path), Tree("CSV file")
    try:
        headings, first, *rows = path.read_text(encoding="utf-8").splitlines()
        table = np.loadtxt([first, *rows], delimiter=",", ndmin=2)
        columns = dict(zip(headings.split(","), table.T, strict=True))
        places = [(str(one["patch"]), str(one["point"])) for one in said["responses"]]
        names = [f"patch {patch} point {point}" for patch, point in places]
        tree.arrays["frequency"] = columns["frequency [Hz]"]
        for part in ("real", "imaginary"):
            tree.arrays[f"velocity_{part}"] = np.stack(
                [columns[f"{name} velocity {part} [(m/s)/V]"] for name in names]
            )
        if all(f"{name} coherence [1]" in columns for name in names):
            tree.arrays["coherence"] = np.stack([columns[f"{name} coherence [1]"] for name in names])
    except (ValueError, LookupError, TypeError, OSError):
        raise DataError(f"{path} is not as haploop exported it, with its sidecar: export it again.") from None
    tree.texts["velocity_real.units"] = "(m/s)/V"
    tree.lists["patches"], tree.lists["points"] = map(list, zip(*places, strict=True))
    tree.numbers["about.simulated"] = float(bool(said.get("about", {}).get("simulated")))
    return tree


def _complex(tree: Tree) -> dict[str, tuple[NDArray[Any], str]]:
    """Complex arrays by name, those of two real ones too, and the name under which their unit stands."""
    found = {name: (values, name) for name, values in tree.arrays.items() if np.iscomplexobj(values)}
    for name, real in tree.arrays.items():
        for first, second in _PARTS:
            whole = name.removesuffix(first)
            other = tree.arrays.get(whole + second) if whole != name else None
            if other is not None and other.shape == real.shape:
                found[whole] = (real + 1j * other, name)
    return found


def responses_of(tree: Tree) -> list[tuple[str, str]]:
    """Names of each complex array and of its frequencies. Raises DataError for several such."""
    found = []
    for name, (values, _) in _complex(tree).items():
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
    tree = _of_csv(path) if "responses" in read_sidecar(path) else tree_of(path)
    arrays, made = _complex(tree), []
    pairs = responses_of(tree)
    for name, over in pairs:
        values, of_unit = arrays[name]
        keys = (f"units.{of_unit}", f"{of_unit}.units", f"{of_unit}.unit")
        factor, power = _velocity_per(path, name, next(filter(None, map(tree.texts.get, keys)), ""), unit)
        f, H = tree.arrays[over], np.atleast_2d(values)
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
            patch, point = (of[row] if row < len(of) else "" for of in places)
            # Of several arrays, each is called as in the file.
            patch = patch or (name.rpartition(".")[2] if len(pairs) > 1 else str(row + 1))
            point = point or str(row + 1)
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
    found = per_unit({"m s-1 V-1": "(m/s)/V"}.get(text, text))  # as UDUNITS writes it
    if found is None or found[0][0] not in POWERS or found[1][0] != "V":
        raise ConfigurationError(
            f"{path}: {text!r} is no unit of a response to a patch: displacement, velocity or acceleration "
            f"per volt is needed, for example {_EXAMPLE}."
        )
    return found[0][1] / found[1][1], POWERS[found[0][0]]
