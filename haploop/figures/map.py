"""Figures of a vibration map: the paper's figure 3, and an animation of the largest vibration."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.axes import Axes
from matplotlib.colors import Colormap
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

from haploop.calibration.map import ALL, VibrationMap
from haploop.figures.plotting import letter, mark_simulated, new_figure, style
from haploop.instruments.arrays import FloatArray
from haploop.instruments.files import new_file

__all__ = ["animate_map", "map_figure"]

_SHAPES = 5
"""Number of mode shapes drawn."""
_FRAMES = 24
_COLOURS = 63
_SQUARE = 0.7
"""Height over width of the table as drawn (not stated in the paper)."""
_MICRO = 1e6


def map_figure(found: VibrationMap) -> Figure:
    """Draw the paper's figure 3 for each configuration at the best frequency, and the strongest modes."""
    best, names = found.best(), found.configurations
    at = np.array([best.frequency_hz])
    sizes = {name: _MICRO * np.abs(found.displacement(name, at)[:, 0]) for name in names}
    top = max(float(own.max()) for own in sizes.values())
    modes = sorted(hz for hz, _ in found.resonances()[:_SHAPES])
    columns = max(len(names), len(modes))
    with style():
        drawn = new_figure(2.6)
        grid = drawn.add_gridspec(2, columns + 1, width_ratios=[*(1.0,) * columns, 0.08])
        for k, name in enumerate(names):
            axes = drawn.add_subplot(grid[0, k])
            image = _surface(axes, found, sizes[name], "magma", 0.0, top)
            letter(axes, k, "all" if name == ALL else f"patch {name}")
            if name == best.patch:
                row, column = divmod(int(best.point), found.plan.columns)
                axes.plot(column, row, "o", ms=11, mfc="none", mec="white", mew=1)
        drawn.colorbar(image, cax=drawn.add_subplot(grid[0, -1])).set_label(
            f"µm per V\nat {best.frequency_hz:.1f} Hz"
        )
        for k, hz in enumerate(modes):
            axes = drawn.add_subplot(grid[1, k])
            shape = _surface(axes, found, found.shape(hz), "RdBu_r", -1.0, 1.0)
            letter(axes, len(names) + k, f"{hz:.1f} Hz")
        if modes:
            drawn.colorbar(shape, cax=drawn.add_subplot(grid[1, -1]), ticks=[-1, 0, 1]).set_label(
                "mode shape"
            )
    return drawn


def animate_map(found: VibrationMap, path: Path) -> None:
    """Write one period of the vibration at the best frequency, in slow motion, as a new GIF.

    Raises DataError when it exists or cannot be written.
    """
    best = found.best()
    motion = found.displacement(best.patch, np.array([best.frequency_hz]))[:, 0] * _MICRO
    top = float(np.abs(motion).max())
    with style():
        drawn = Figure(figsize=(4.2, 2.6), layout="constrained")
        axes = drawn.add_subplot()

        def frame(number: int) -> FloatArray:
            return found.grid(np.real(motion * np.exp(2j * np.pi * number / _FRAMES)))

        # Few enough colours for a GIF, which has one palette per frame.
        colours = colormaps["RdBu_r"].resampled(_COLOURS)
        image = _surface(axes, found, np.real(motion), colours, -top, top)
        axes.set_title(f"Patch {best.patch}, {best.frequency_hz:.1f} Hz, in slow motion")
        drawn.colorbar(image, ax=axes, label="µm per V", fraction=0.05)
        if found.plan.simulated:
            mark_simulated(drawn)

        def draw(number: int) -> tuple[Any, ...]:
            image.set_data(frame(number))
            return (image,)

        with new_file(path) as part:
            # Pillow derives the file type from the suffix.
            gif = part.with_name(f"{part.name}.gif")
            try:
                FuncAnimation(drawn, draw, frames=_FRAMES).save(gif, writer=PillowWriter(fps=12), dpi=110)
                gif.replace(part)
            finally:
                gif.unlink(missing_ok=True)


def _surface(
    axes: Axes, found: VibrationMap, values: FloatArray, colours: str | Colormap, low: float, high: float
) -> AxesImage:
    """Draw values (points,) on the table's grid, interpolated between the points."""
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(False)
    # The bicubic filter spreads NaN of unmeasured points, so partial maps are not interpolated.
    smooth = "bicubic" if len(found.points) == found.plan.rows * found.plan.columns else "nearest"
    plan = found.plan
    return axes.imshow(
        found.grid(values),
        cmap=colours,
        vmin=low,
        vmax=high,
        interpolation=smooth,
        aspect=_SQUARE * plan.columns / plan.rows,
    )
