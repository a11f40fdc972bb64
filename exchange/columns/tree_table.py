"""The columns of a tree of arrays, and its responses: of MATLAB, HDF5, NumPy and TDMS files."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import FloatArray
from ...base.errors import ConfigurationError, DataError
from ...calibration import Response
from ...calibration.response import POWERS, per_unit, plain_response
from ..views import About, read_sidecar
from .contained import Tree, tree_of
from .start_times import since_of, stated_start
from .table import Column, Labels, Stated, Table, together
from .text_cells import is_number, plain_number
from .text_file import table_of
from .text_rates import stated_by
from .text_rows import numeric_rows
from .units import doubt_beside, is_factor, is_time, split_heading, unit_of, units_of

_START = re.compile(r"(wfstartoffset|startingtime|x0|xorg|xorigin|startvalue|tstart)\Z")
"""Keys without their case, blanks and signs."""
_DATA = ("data", "values", "value", "samples", "y", "ydata", "y_values")
"""Names of an array whose neighbours describe it."""
_TITLES = ("name", "label", "title", "signalname", "channelname")
_UNITS = (
    "unit",
    "units",
    "unitstring",
    "niunitdescription",
    "unitstr",
    "yunits",
    "yunit",
    "engineeringunits",
)
_NAMES = ("columns", "names", "channels", "channelnames", "labels", "headings")
_HUMP = re.compile(r"(?<=[a-z])(?=[A-Z])")
_WIDEST = 64
"""Columns of a matrix; a wider one is a picture or a spectrogram."""


def read_table(path: Path, decimal: str | None = None, skip: bool = False) -> Table:
    """Read a file's columns; `decimal` is the decimal sign of numbers that a workbook holds as text.

    Raises DataError, ConfigurationError where a package is missing.
    """
    tree = tree_of(path)
    if tree.rows:
        shape = f"workbook, sheet {tree.texts['sheet']!r}"
        table = table_of(path, numeric_rows(path, _plain_cells(path, tree.rows, decimal), ".", shape, skip))
        others = tree.lists.get("sheets", [])
        left = (f"Of its sheets {', '.join(map(repr, others))} were left out.",) if others else ()
        return replace(table, notes=(*table.notes, *left))
    if responses_of(tree) or any(unit_of(said, "rate") for said in _axes(tree).values()):
        raise DataError(f"{path} ({tree.kind}) is over frequency: a response, and no signals.")
    over_time = [name for name, values in tree.arrays.items() if not np.iscomplexobj(values)]
    found = tree.columns or [column for name in over_time for column in _columns(tree, name)]
    longest = max((len(column.values) for column in found), default=0)
    lasts = max((len(one.values) / one.rate_hz for one in found if one.rate_hz), default=0.0)
    columns = [
        one
        for one in found
        if len(one.values) == longest or (one.rate_hz and 2 * len(one.values) > lasts * one.rate_hz)
    ]
    if not columns:
        raise DataError(f"{path} ({tree.kind}) holds no vector of numbers: save the signals as vectors.")
    short = [one.name for one in found if one not in columns]
    notes = [f"{', '.join(short[:5])} are not as long as the others, and were left out."] if short else []
    wide = [name for name in over_time if _is_wide(tree.arrays[name])] if not tree.columns else []
    if none := [*tree.left, *wide]:
        notes.append(
            f"{', '.join(none[:5])} are neither vectors nor matrices of up to {_WIDEST} columns of numbers, "
            "and were left out."
        )
    if complex_ := [name for name in tree.arrays if name not in over_time]:
        notes.append(f"{', '.join(complex_[:5])} are complex, and were left out.")
    columns, moved = together(path, columns)
    notes += moved
    rows = len(columns[0].values)
    texts = {name.rpartition(".")[2]: tuple(own) for name, own in tree.lists.items() if len(own) == longest}
    if texts and rows < longest:
        notes.append(f"{', '.join(texts)} are text of other rows, and were left out.")
        texts = {}
    start = stated_start([[" ".join(re.split(_HUMP, name.rpartition(".")[2])), said]
                          for name, said in tree.texts.items()])  # fmt: skip
    return Table(
        path, tree.kind, tuple(_shortened(columns)), _rates(tree), _about(tree), tuple(notes),
        labels=tuple(Labels(name, own) for name, own in texts.items()),
        starts=() if start is None else ((0, start),),
    )  # fmt: skip


def _plain_cells(path: Path, rows: list[list[str]], decimal: str | None) -> list[list[str]]:
    """Rows with decimal points. Raises DataError where texts have commas, and nobody said what they are."""

    def has_comma(cell: str) -> bool:
        return "," in cell and is_number(cell, ",")

    found = [cell for row in rows for cell in row if has_comma(cell)]
    if decimal is None and len(found) > len(rows) / 2:
        raise DataError(
            f"{path} holds numbers as text, like {found[0]!r}: say what their comma is (--decimal , or "
            "--decimal .)."
        )
    if decimal != ",":
        return rows
    return [[plain_number(cell, ",") if has_comma(cell) else cell for cell in row] for row in rows]


def _columns(tree: Tree, name: str) -> Iterator[Column]:
    values = tree.arrays[name]
    above, _, leaf = name.rpartition(".")
    said, holder = _said(tree, name), name
    title = name
    if above and leaf.lower() in _DATA and above not in tree.arrays:
        said, holder = {**_said(tree, above), **said}, above
        title = next((str(said[key]) for key in _TITLES if isinstance(said.get(key), str)), above)
    rate, start = _clock(tree, name)
    if holder != name and (rate, start) == (None, None):
        rate, start = _clock(tree, holder)
    stamps = said.get("stamps") == "yes"
    factor = doubt_beside(_factors(tree, name))
    if values.ndim == 1:
        unit, doubt = _unit(tree, said, name)
        name, unit = _named(title, unit)
        doubt = doubt or ("" if is_time(name.rpartition(".")[2], unit) else factor)
        calendar = str(said.get("calendar", ""))
        since = next((since_of(str(said[key]), calendar)[1] for key in _UNITS if key in said), None)
        yield Column(name, unit, values, rate, stamps, start, since, also=(title,), doubt=doubt)
        return
    rows: FloatArray = values if values.shape[0] >= values.shape[1] else values.T
    if _is_wide(rows):
        return
    lists = {
        _plain(key.rpartition(".")[2]): own for key, own in tree.lists.items() if key.startswith(f"{name}.")
    }
    names = next((lists[key] for key in _NAMES if key in lists), [])
    units = next((lists[key] for key in _UNITS if key in lists), [])
    of_all, doubt = _unit(tree, said, name)
    for number, column in enumerate(rows.T):
        heading = names[number] if len(names) == rows.shape[1] else ""
        unit = units[number] if len(units) == rows.shape[1] else of_all
        yield Column(
            *_named(heading, unit), np.ascontiguousarray(column), rate, start_s=start, also=(heading,),
            doubt=doubt or factor,
        )  # fmt: skip


def _is_wide(values: NDArray[Any]) -> bool:
    return values.ndim == 2 and min(values.shape) > _WIDEST


def _said(tree: Tree, holder: str) -> dict[str, str | float]:
    """Texts and numbers right below a name, by their own names without case and signs."""
    found: dict[str, str | float] = {}
    entries: dict[str, str | float] = {**tree.numbers, **tree.texts}
    for key, value in entries.items():
        above, _, leaf = key.rpartition(".")
        if above == holder:
            found[_plain(leaf)] = value
    return found


def _factors(tree: Tree, array: str) -> dict[str, Any]:
    """Entries called as factors, but those of other arrays or of groups with other arrays."""
    entries = {**tree.numbers, **tree.texts, **tree.lists, **tree.arrays}
    signals = [name for name in tree.arrays if not is_factor(name.rpartition(".")[2])]
    holders = {name.rpartition(".")[0] for name in signals} | set(signals)
    found = {}
    for name, value in entries.items():
        holder, _, leaf = name.rpartition(".")
        over = not holder or f"{array}.".startswith(f"{holder}.")
        if is_factor(leaf) and len(np.ravel(value)) <= _WIDEST and (over or holder not in holders):
            found[name.replace(".", "/")] = value
    return found


def _plain(key: str) -> str:
    return re.sub(r"[^a-z0-9]", "", key.lower())


def _clock(tree: Tree, holder: str) -> tuple[float | None, float | None]:
    """Rate (1/s) and start (s) that an array's own entries state."""
    rate = start = None
    for name, value in tree.numbers.items():
        above, _, leaf = name.rpartition(".")
        if above == holder and (stated := stated_by(leaf, value)) is not None and stated.hz:
            rate = stated.hz
        elif above == holder and _START.match(_plain(leaf)):
            start = value
    axis = f"{holder.rpartition('.')[0]}.x_values"
    if (
        unit := unit_of(_axes(tree).get(axis, ""), "time")
    ) is not None and f"{axis}.increment" in tree.numbers:
        rate = float(f"{1 / (tree.numbers[f'{axis}.increment'] * unit.factor):.9g}")
        start = unit.factor * tree.numbers.get(f"{axis}.start_value", 0.0)
    return rate, start


def _axes(tree: Tree) -> dict[str, str]:
    """By name: the units of axes that have entries of their own, as Simcenter Testlab writes them."""
    end = ".quantity.label"
    return {n.removesuffix(end): said for n, said in tree.texts.items() if n.endswith(f"x_values{end}")}


def _named(heading: str, unit: str) -> tuple[str, str]:
    return (heading, unit) if unit else split_heading(heading)


def _unit(tree: Tree, said: Mapping[str, str | float], name: str) -> tuple[str, str]:
    """The unit of an array, and the doubt that two different ones leave."""
    above, _, leaf = name.rpartition(".")
    beside = (
        tree.texts.get(f"{above}.{key}.{leaf}" if above else f"{key}.{leaf}") for key in ("unit", "units")
    )
    own = [str(said[key]) for key in _UNITS if isinstance(said.get(key), str)]
    found = [since_of(one)[0] for one in (*own, *beside) if one is not None] or [""]
    other = next((one for one in found if one and units_of(one) != units_of(found[0])), "")
    return found[0], f"the file says both {found[0]!r} and {other!r}" if other else ""


def _rates(tree: Tree) -> tuple[Stated, ...]:
    """The rates that a file states for all arrays, and those of single ones without a clear unit."""
    found: dict[float | str, Stated] = {}
    for name, value in tree.numbers.items():
        holder, _, leaf = name.rpartition(".")
        stated = None if holder in _axes(tree) else stated_by(leaf, value)
        if stated is not None and (holder not in tree.arrays or stated.hz is None):
            found.setdefault(stated.hz or f"{leaf} {value}", replace(stated, words=f"{name} = {value:g}"))
    return tuple(found.values())


def _shortened(columns: list[Column]) -> Iterator[Column]:
    """Columns with the last part of their names, where no two share it."""
    leaves = [column.name.rpartition(".")[2] for column in columns]
    for column, leaf in zip(columns, leaves, strict=True):
        name = leaf if leaves.count(leaf) == 1 else column.name
        yield replace(column, name=name)


def _about(tree: Tree) -> About:
    """What a file of haploop's own says about itself, or its recording that xarray wrote as netCDF 4."""
    said: dict[str, str | float] = {**tree.numbers, **tree.texts}
    if "content_hash" in said:
        return {name: value for name, value in said.items() if "." not in name}
    return {name.removeprefix("about."): value for name, value in said.items() if name.startswith("about.")}


# Frequency responses in a tree of arrays: a complex array, or two real ones, over a vector of frequencies.
#
# MATLAB, HDF5, NumPy and netCDF files are such trees; CSV files as haploop exports responses become one.

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
        factor, power = _velocity_per(path, name, _stated_unit(tree, of_unit), unit)
        hertz = unit_of(_stated_unit(tree, over) or "Hz", "rate")
        if hertz is None:
            raise DataError(f"{path} has {over!r} in {_stated_unit(tree, over)!r}: save frequencies in Hz.")
        f, H = hertz.factor * tree.arrays[over], np.atleast_2d(values)
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


def _stated_unit(tree: Tree, name: str) -> str:
    """The unit that a file states of an array; empty where it states none."""
    keys = (f"units.{name}", f"{name}.units", f"{name}.unit")
    return next(filter(None, map(tree.texts.get, keys)), "")


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
