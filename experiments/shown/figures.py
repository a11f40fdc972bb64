"""Figures of an experiment's analysis: the paper's figures 13 and 14."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from ...base.wording import capital
from ...reports.figures import INK, Columns, colour, hatch, legend_under, letter, panels, style
from ..analysis import Confusion, Identification, Ratings

_PAIR_SIZE, _CLASS_SIZE = 6.5, 8.0
"""Sizes of labels (points)."""
_WIDE = 0.6
"""Width of a character over its size, on the safe side."""
_ROOM = {1: 200.0, 2: 450.0}
"""Width of one panel across a figure of so many columns (points)."""
_MATRIX = 160.0
"""Width of a confusion matrix (points), however many columns wide the figure is."""


def confusion_figure(result: Identification, columns: Columns = 2) -> Figure:
    """Draw a confusion matrix for each group and day, in percent of what was presented."""
    matrices: dict[str, Confusion] = {
        ", ".join(f"{column} {value}" for column, value in zip(result.by, key, strict=True)): confusion
        for key, confusion in result.matrices.items()
    } or {"": result.pooled}
    across = min(2, len(matrices))
    with style():
        figure, grid = panels(math.ceil(len(matrices) / across), across, 2.9, columns)
        for index, axes in enumerate(grid.flat):
            if index >= len(matrices):
                axes.set_axis_off()
                continue
            title, confusion = list(matrices.items())[index]
            presented = confusion.counts.sum(axis=1, keepdims=True)
            share = 100 * confusion.counts / np.maximum(presented, 1)
            axes.imshow(share, cmap="Blues", vmin=0, vmax=100)
            for (row, place), value in np.ndenumerate(share):
                text = f"{value:.0f}" if presented[row, 0] else "-"
                axes.text(place, row, text, ha="center", va="center", color="white" if value > 60 else INK)
            places = range(len(confusion.classes))
            turned = _turned(confusion.classes, _CLASS_SIZE, _MATRIX)
            axes.set_xticks(places, confusion.classes, rotation=90 if turned else 0)
            axes.set_yticks(places, confusion.classes)
            axes.set_xlabel("Answered")
            axes.set_ylabel("Presented (%)")
            letter(axes, index, capital(title))
        return figure


def ratings_figure(result: Ratings, columns: Columns = 2) -> Figure:
    """Draw the mean and standard deviation of each adjective pair, a panel for each button."""
    first, second = result.levels
    places = np.arange(len(result.pairs))
    width = 0.8 / len(first)
    names = [pair.pair.replace("-", "-\n", 1) for pair in result.pairs]
    turned = _turned(names, _PAIR_SIZE, _ROOM[columns])
    with style():
        figure, grid = panels(len(second), 1, 2.2, columns)
        for panel, axes in enumerate(grid[:, 0]):
            for row, level in enumerate(first):
                axes.bar(
                    places + (row - (len(first) - 1) / 2) * width,
                    [pair.mean[row, panel] for pair in result.pairs],
                    width,
                    yerr=[pair.deviation[row, panel] for pair in result.pairs],
                    color=colour(row),
                    hatch=hatch(row),
                    edgecolor="white",
                    linewidth=0,
                    label=level,
                    capsize=2,
                    error_kw={"linewidth": 0.8},
                )
            axes.set_xticks(places, names, rotation=90 if turned else 0)
            # Turned labels are high: below the last panel they serve all.
            below = not turned or panel == len(second) - 1
            axes.tick_params(axis="x", labelsize=_PAIR_SIZE, labelbottom=below)
            axes.set_ylabel("Normalised rating" if result.normalised else "Rating")
            letter(axes, panel, capital(second[panel]), 1 if panel == 0 else 0)
        legend_under(grid[0, 0], len(first))
        return figure


def _turned(names: Sequence[str], size: float, room: float) -> bool:
    """Whether labels side by side (`size` points) would not fit into `room` points."""
    longest = max(len(line) for name in names for line in name.split("\n"))
    return _WIDE * size * (longest + 1) * len(names) > room
