"""The columns of a tree of arrays: of MATLAB, HDF5, NumPy and TDMS files."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ...instruments import DataError
from ...instruments.arrays import FloatArray
from ..views import About
from .contained import Tree, tree_of
from .table import Column, Table
from .text_file import table_of
from .text_rows import numeric_rows
from .units import split_heading

_RATES = ("rate_hz", "fs", "sample_rate", "samplerate", "sampling_rate", "sampling_frequency", "rate", "sr")
_STEPS = ("dt", "wf_increment", "delta_t", "sample_interval", "sampling_interval", "increment", "ts")
_UNITS = ("unit", "units", "unit_string", "ni_unitdescription", "unit_str")
_NAMES = ("columns", "names", "channels", "channel_names", "labels", "headings")
_WIDEST = 64
"""Columns of a matrix; a wider one is a picture or a spectrogram."""


def read_table(path: Path) -> Table:
    """Read a file's columns. Raises DataError, ConfigurationError where a package is missing."""
    tree = tree_of(path)
    if tree.rows:
        shape = f"workbook, sheet {tree.texts['sheet']!r}"
        return table_of(path, numeric_rows(path, tree.rows, ".", shape))
    found = [column for name in tree.arrays for column in _columns(tree, name)]
    longest = max((len(column.values) for column in found), default=0)
    columns = [one for one in found if len(one.values) == longest or one.rate_hz]
    if not columns:
        raise DataError(f"{path} ({tree.kind}) holds no vector of numbers: save the signals as vectors.")
    short = [one.name for one in found if one not in columns]
    notes = [f"{', '.join(short[:5])} are not as long as the others, and were left out."] if short else []
    rate, rate_from = _rate(tree)
    return Table(path, tree.kind, tuple(_shortened(columns)), rate, rate_from, _about(tree), tuple(notes))


def _columns(tree: Tree, name: str) -> Iterator[Column]:
    values = tree.arrays[name]
    own = {key.lower(): key for key in (*tree.numbers, *tree.texts, *tree.lists)}
    steps = [1 / tree.numbers[own[k]] for s in _STEPS if (k := f"{name}.{s}".lower()) in own
             and own[k] in tree.numbers and tree.numbers[own[k]] > 0]  # fmt: skip
    rate = float(f"{steps[0]:.9g}") if steps else None
    stamps = tree.texts.get(f"{name}.stamps") == "yes"
    if values.ndim == 1:
        yield Column(*_named(name, _unit(tree, own, name)), values, rate, stamps)
        return
    rows: FloatArray = values if values.shape[0] >= values.shape[1] else values.T
    if rows.shape[1] > _WIDEST:
        return
    names = next(
        (tree.lists[own[k]] for n in _NAMES if (k := f"{name}.{n}") in own and own[k] in tree.lists), []
    )
    units = next(
        (tree.lists[own[k]] for n in _UNITS if (k := f"{name}.{n}") in own and own[k] in tree.lists), []
    )
    for number, column in enumerate(rows.T):
        said = names[number] if len(names) == rows.shape[1] else ""
        unit = units[number] if len(units) == rows.shape[1] else ""
        yield Column(*_named(said, unit), np.ascontiguousarray(column), rate)


def _named(heading: str, unit: str) -> tuple[str, str]:
    return (heading, unit) if unit else split_heading(heading)


def _unit(tree: Tree, own: dict[str, str], name: str) -> str:
    above, _, leaf = name.rpartition(".")
    for key in _UNITS:
        for place in (f"{name}.{key}", f"{above}.{key}.{leaf}" if above else f"{key}.{leaf}"):
            if place.lower() in own:
                return tree.texts.get(own[place.lower()], "")
    return ""


def _rate(tree: Tree) -> tuple[float | None, str]:
    found: dict[float, str] = {}
    for name, value in tree.numbers.items():
        leaf, holder = name.rpartition(".")[2].lower(), name.rpartition(".")[0]
        if value > 0 and leaf in _RATES:
            found.setdefault(value, f"{name} = {value:g}")
        elif value > 0 and leaf in _STEPS and holder not in tree.arrays:
            found.setdefault(float(f"{1 / value:.9g}"), f"{name} = {value:g}")
    return next(iter(found.items())) if len(found) == 1 else (None, "")


def _shortened(columns: list[Column]) -> Iterator[Column]:
    """Columns with the last part of their names, where no two share it."""
    leaves = [column.name.rpartition(".")[2] for column in columns]
    for column, leaf in zip(columns, leaves, strict=True):
        name = leaf if leaves.count(leaf) == 1 else column.name
        yield Column(name, column.unit, column.values, column.rate_hz, column.stamps)


def _about(tree: Tree) -> About:
    """What a file of haploop's own says about itself."""
    said: dict[str, str | float] = {**tree.numbers, **tree.texts}
    return {name.removeprefix("about."): value for name, value in said.items() if name.startswith("about.")}
