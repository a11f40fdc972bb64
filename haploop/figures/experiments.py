"""Figures of an experiment's analysis: the paper's figures 13 and 14."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.figure import Figure

from haploop.experiments import Confusion, Identification, Ratings
from haploop.figures.plotting import INK, Columns, colour, hatch, legend_under, letter, panels, style

__all__ = ["confusion_figure", "ratings_figure"]


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
            axes.set_xticks(places, confusion.classes)
            axes.set_yticks(places, confusion.classes)
            axes.set_xlabel("Answered")
            axes.set_ylabel("Presented (%)")
            letter(axes, index, title[:1].upper() + title[1:])
        return figure


def ratings_figure(result: Ratings, columns: Columns = 2) -> Figure:
    """Draw the mean and standard deviation of each adjective pair, a panel for each button."""
    first, second = result.levels
    places = np.arange(len(result.pairs))
    width = 0.8 / len(first)
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
            axes.set_xticks(places, [pair.pair.replace("-", "-\n", 1) for pair in result.pairs])
            axes.tick_params(axis="x", labelsize=6.5)
            axes.set_ylabel("Normalised rating" if result.normalised else "Rating")
            letter(axes, panel, second[panel].capitalize(), 1 if panel == 0 else 0)
        legend_under(grid[0, 0], len(first))
        return figure
