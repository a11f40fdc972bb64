"""Contents of a vibration map: a table, the paper's figure 3, and an animation of the best vibration."""

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
from rich.box import SIMPLE
from rich.table import Table

from haploop.calibration.map import ALL, VibrationMap
from haploop.figures.plotting import letter, mark_simulated, new_figure, style
from haploop.instruments.arrays import FloatArray
from haploop.instruments.files import new_file

__all__ = ["animate", "contents", "figure"]

_SHAPES = 5
"""Modes whose shapes are drawn."""
_FRAMES = 24
_COLOURS = 63
_SQUARE = 0.7
"""Height of the table over its width, as drawn (the paper does not say it)."""
_MICRO = 1e6


def contents(found: VibrationMap) -> tuple[dict[str, Any], Table]:
    """As JSON values, and as a table."""
    plan, best = found.plan, found.best()
    each = [found.best(patches=[name]) for name in found.configurations]
    values: dict[str, Any] = {
        "kind": "map",
        "simulated": plan.simulated,
        "rig": plan.rig,
        "points_measured": len(found.points),
        "points_planned": len(plan.points),
        "skipped": dict(found.skipped),
        "patches": list(plan.patches),
        "together": plan.together,
        "level_v": plan.level,
        "table_s": round(found.table_seconds, 3),
        "best": {
            "patch": best.patch,
            "point": best.point,
            "frequency_hz": best.frequency_hz,
            "displacement_m_per_v": best.displacement,
        },
        "best_of": {
            one.patch: {
                "point": one.point,
                "frequency_hz": one.frequency_hz,
                "displacement_m_per_v": one.displacement,
            }
            for one in each
        },
        "modes": [{"frequency_hz": hz, "damping": damping} for hz, damping in found.resonances()],
        "residual": float(np.sqrt(np.mean(found.residual**2))),
        "superposition": dict(found.superposition),
        "drift": [float(shift) for shift in found.drift],
    }
    table = Table(
        box=SIMPLE, title=f"Vibration map of the rig {plan.rig}", title_justify="left", show_header=False
    )
    table.add_column(style="bold", no_wrap=True)
    table.add_column(overflow="fold")
    table.add_row(
        "Points", f"{len(found.points)} of {len(plan.points)} measured, x {', '.join(plan.patches)}"
    )
    table.add_row("Played", "all patches at once" if plan.together else "one patch at a time")
    table.add_row("Measurement time", f"{found.table_seconds / 60:.1f} min at {plan.level:.1f} V peak")
    table.add_row("Best", _sentence(best.patch, best.point, best.frequency_hz, best.displacement))
    for one in each:
        table.add_row(f"  {one.patch}", _sentence("", one.point, one.frequency_hz, one.displacement))
    table.add_row(
        "Modes", ", ".join(f"{hz:.1f}" for hz, _ in found.resonances()[:8]) + " Hz, strongest first"
    )
    table.add_row("Residual of the modal fit", f"{values['residual']:.2%} of the measured velocity")
    if found.superposition:
        told = ", ".join(f"{share:.2%} at point {point}" for point, share in found.superposition)
        table.add_row("Superposition error", told)
    if len(found.drift):
        table.add_row("Drift of frequencies", f"{np.abs(found.drift).max():.3%} at most")
    for point, reason in found.skipped:
        table.add_row(f"Skipped: {point}", reason)
    return values, table


def figure(found: VibrationMap) -> Figure:
    """Figure 3 of the paper for each configuration at the best frequency, and the strongest modes' shapes."""
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


def animate(found: VibrationMap, path: Path) -> None:
    """The table's vibration at the best frequency, one period in slow motion, as a new GIF.

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

        # Few enough colours for a GIF to have them all: it makes up a palette for each frame.
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
            # Pillow tells a picture's type by its name's ending.
            gif = part.with_name(f"{part.name}.gif")
            try:
                FuncAnimation(drawn, draw, frames=_FRAMES).save(gif, writer=PillowWriter(fps=12), dpi=110)
                gif.replace(part)
            finally:
                gif.unlink(missing_ok=True)


def _sentence(patch: str, point: str, hz: float, displacement: float) -> str:
    named = f"patch {patch}, " if patch else ""
    return f"{named}{hz:.1f} Hz, point {point}: {displacement * _MICRO:.4f} µm per V"


def _surface(
    axes: Axes, found: VibrationMap, values: FloatArray, colours: str | Colormap, low: float, high: float
) -> AxesImage:
    """(points,) on the table's grid, smoothly between its points."""
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(False)
    # The bicubic filter spreads what was not measured over everything: partial maps are drawn plainly.
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
