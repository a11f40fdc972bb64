"""Figure of the nights of a history: how far each mode has drifted, as small multiples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ...base.errors import DataError
from .plotting import BLUE, INK, SOFT, VERMILLION, Columns, new_figure, style

_ACROSS = {1: 2, 2: 5}
"""Panels of a row."""
_SAME = 0.01
"""Relative difference of frequencies within which a mode is one that was known before a renewal."""


@dataclass
class _Mode:
    """A mode of a place, through all calibrations of it."""

    place: tuple[str, str]
    first_hz: float
    when: list[datetime] = field(default_factory=list)
    hz: list[float] = field(default_factory=list)
    """Found at each of these times."""

    @property
    def drift(self) -> list[float]:
        """In %, since its first night's calibration."""
        return [100 * (hz / self.first_hz - 1) for hz in self.hz]


def nights_figure(looks: Sequence[Mapping[str, Any]], columns: Columns = 2) -> Figure:
    """Draw the drift of each mode over the nights of a history: one small panel a mode, all on one scale.

    `looks` are the history's entries. Raises DataError when none of them measured a mode.
    """
    modes = _modes(looks)
    if not modes:
        raise DataError("No night has measured a mode yet, so there is no drift to draw.")
    across = min(_ACROSS[columns], len(modes))
    rows = -(-len(modes) // across)
    with style():
        figure = new_figure(1.05 * rows + 0.75, columns)
        grid = figure.subplots(rows, across, sharex=True, sharey=True, squeeze=False)
        several = len({mode.place for mode in modes}) > 1
        for axes, mode in zip(grid.flat, modes, strict=False):
            _dates(axes, looks)
            axes.axhline(0, color=SOFT, linewidth=0.5)
            axes.plot(mode.when, mode.drift, "-o", color=BLUE, markersize=2.4, linewidth=0.9, label="drift")
            place = f"{mode.place[0]} {mode.place[1]}, " if several else ""
            axes.set_title(f"{place}{mode.first_hz:.0f} Hz", fontsize=7.5, parse_math=False)
        for axes in grid.flat[len(modes) :]:
            axes.set_visible(False)
        largest = max(0.1, *(abs(value) for mode in modes for value in mode.drift))
        grid[0, 0].set_ylim(-1.2 * largest, 1.2 * largest)
        _label(figure, grid, len(modes), looks)
        return figure


def _dates(axes: Any, looks: Sequence[Mapping[str, Any]]) -> None:
    """Lines at the nights that were broken, and at those that renewed the calibration."""
    for look in looks:
        if look["outcome"] in _LINES:
            paint, dashes = _LINES[look["outcome"]]
            axes.axvline(_time(look), color=paint, linewidth=0.7, linestyle=dashes, zorder=0)


_LINES = {"broken": (VERMILLION, (0, (1, 1))), "restored": (INK, (0, (4, 2)))}


def _label(figure: Figure, grid: Any, count: int, looks: Sequence[Mapping[str, Any]]) -> None:
    """Label the lowest panel of each column with the first and the last night, and write the legend."""
    rows, across = grid.shape
    ends = sorted({_time(looks[0]), _time(looks[-1])})
    form = "%H:%M" if ends[0].date() == ends[-1].date() else "%d %b"
    for number, axes in enumerate(grid.flat[:count]):
        if number + across >= count:
            axes.set_xticks(ends, [f"{end:{form}}" for end in ends])
            axes.tick_params(axis="x", labelbottom=True)
    for row in range(rows):
        grid[row, 0].set_ylabel("Drift (%)")
    handles = [Line2D([], [], color=BLUE, marker="o", markersize=2.4, label="drift since the first night")]
    handles += [
        Line2D([], [], color=paint, linestyle=dashes, linewidth=0.7, label=label)
        for (paint, dashes), label in zip(_LINES.values(), ("broken", "calibration renewed"), strict=True)
    ]
    figure.legend(handles=handles, loc="outside upper left", ncols=3)


def _modes(looks: Sequence[Mapping[str, Any]]) -> list[_Mode]:
    """The modes of all places, by place and frequency; each is followed through renewals."""
    found: list[_Mode] = []
    known: dict[tuple[str, str, str, float], _Mode] = {}
    for look in looks:
        for place in look["places"]:
            where = (place["patch"], place["point"])
            for one in place.get("modes", []):
                key = (look["compared_with"], *where, one["hz"])
                if key not in known:
                    known[key] = _known(found, where, one["hz"])
                known[key].when.append(_time(look))
                known[key].hz.append(one["hz"] * (1 + one["shift"]))
    return sorted(found, key=lambda mode: (mode.place, mode.first_hz))


def _known(found: list[_Mode], where: tuple[str, str], hz: float) -> _Mode:
    """The mode of a calibrated frequency: one whose last frequency is near, or a new one."""
    here = [mode for mode in found if mode.place == where]
    apart = [abs(mode.hz[-1] / hz - 1) for mode in here]
    if apart and min(apart) < _SAME:
        return here[int(np.argmin(apart))]
    found.append(_Mode(where, hz))
    return found[-1]


def _time(look: Mapping[str, Any]) -> datetime:
    return datetime.fromisoformat(look["when"])
