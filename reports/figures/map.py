"""Figures of a vibration map, the paper's figure 3, and of a measured response with its model."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import scipy
from matplotlib.axes import Axes
from matplotlib.colors import Colormap
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.ticker import MaxNLocator

from ...base.arrays import ComplexArray, FloatArray
from ...calibration.map import ALL, VibrationMap
from .plotting import (
    GREEN,
    GREY,
    INK,
    SKY,
    VERMILLION,
    Columns,
    continuous_phase,
    legend_under,
    letter,
    log_scale,
    new_figure,
    style,
)

if TYPE_CHECKING:
    from ...calibration import Calibration


_SHAPES = 5
"""Number of mode shapes drawn."""
_SQUARE = 0.7
"""Height over width of the table as drawn (not stated in the paper)."""
_MICRO = 1e6


def map_figure(found: VibrationMap, columns: Columns = 2) -> Figure:
    """Draw the paper's figure 3 for each configuration at the best frequency, and the strongest modes.

    A map of some points only shows these as squares on the table.
    """
    best, names = found.best(), found.configurations
    at = np.array([best.frequency_hz])
    sizes = {name: _MICRO * np.abs(found.displacement(name, at)[:, 0]) for name in names}
    top = max(float(own.max()) for own in sizes.values())
    modes = sorted(hz for hz, _ in found.resonances()[:_SHAPES])
    across = max(len(names), len(modes), 1) if columns == 2 else 2
    with style():
        rows = [-(-len(names) // across), -(-len(modes) // across)]
        drawn = new_figure((1.2 if columns == 2 else 1.4) * sum(rows) + 0.2, columns)
        grid = drawn.add_gridspec(sum(rows), across + 1, width_ratios=[*(1.0,) * across, 0.06])
        for k, name in enumerate(names):
            axes = drawn.add_subplot(grid[k // across, k % across])
            image = _surface(axes, found, sizes[name], "magma", (0.0, top))
            letter(axes, k, "all" if name == ALL else f"patch {name}")
            if name == best.patch:
                row, column = divmod(int(best.point), found.plan.columns)
                axes.plot(column, row, "o", ms=11, mfc="none", mec=INK, mew=2.2)
                axes.plot(column, row, "o", ms=11, mfc="none", mec="white", mew=1)
        bar = drawn.add_subplot(grid[: rows[0], -1])
        drawn.colorbar(image, cax=bar).set_label(f"µm per V, {best.frequency_hz:.1f} Hz")
        for k, hz in enumerate(modes):
            axes = drawn.add_subplot(grid[rows[0] + k // across, k % across])
            # Brightness tells the sign in grey, too; the line between is where the mode does not move.
            image = _surface(axes, found, found.shape(hz), "cividis", (-1.0, 1.0))
            if _whole(found):
                _nodal_lines(axes, found.grid(found.shape(hz)))
            letter(axes, len(names) + k, f"{hz:.1f} Hz")
        if modes:
            bar = drawn.add_subplot(grid[rows[0] :, -1])
            drawn.colorbar(image, cax=bar, ticks=[-1, 0, 1]).set_label("mode shape")
    return drawn


def _surface(
    axes: Axes, found: VibrationMap, values: FloatArray, colours: str | Colormap, span: tuple[float, float]
) -> AxesImage:
    """Draw values (points,) on the table's grid, interpolated between the points."""
    axes.set_xticks([])
    axes.set_yticks([])
    # The table's edge, and grey where nothing was measured.
    axes.set_facecolor("#E4E4E4")
    for spine in axes.spines.values():
        spine.set_visible(True)
        spine.set_color(GREY)
    plan = found.plan
    return axes.imshow(
        found.grid(values),
        cmap=colours,
        vmin=span[0],
        vmax=span[1],
        # The bicubic filter spreads NaN of unmeasured points, so partial maps are not interpolated.
        interpolation="bicubic" if _whole(found) else "nearest",
        aspect=_SQUARE * plan.columns / plan.rows,
    )


def _nodal_lines(axes: Axes, shape: FloatArray) -> None:
    """Draw where a mode shape (rows, columns) is zero, interpolated as the picture is."""
    finer = scipy.ndimage.zoom(shape, 8, order=3)
    rows = np.linspace(0, shape.shape[0] - 1, finer.shape[0])
    columns = np.linspace(0, shape.shape[1] - 1, finer.shape[1])
    if finer.min() < 0 < finer.max():
        axes.contour(columns, rows, finer, [0.0], colors="white", linewidths=0.8)


def _whole(found: VibrationMap) -> bool:
    return len(found.points) == found.plan.rows * found.plan.columns


# The measured response of a table, its coherence and phase, and the fitted model.


def response(calibration: Calibration, truth: ComplexArray | None = None, columns: Columns = 2) -> Figure:
    """Draw the measured response, its coherence and phase, the fitted model, and the resonance.

    `truth` is the plant's velocity response at the measured frequencies, on a simulated rig.
    """
    measured, model = calibration.response, calibration.model
    frequencies, peak = measured.frequencies, model.resonance_hz
    known = measured.coherence if measured.coherence.size else np.full(frequencies.shape, np.nan)
    with style():
        figure = new_figure(4.9, columns)
        grid = figure.subplots(
            3,
            2,
            sharex="col",
            gridspec_kw={"width_ratios": (2.1 if columns == 2 else 1.5, 1), "height_ratios": (2.2, 1.2, 1)},
        )
        fitted = model.velocity(frequencies)
        curves: list[tuple[str, ComplexArray, dict[str, Any]]] = [
            ("Measured", measured.velocity, {"color": SKY, "linewidth": 1.9}),
            ("Model", fitted, {"color": INK, "linewidth": 0.8}),
        ]
        if truth is not None:
            curves.append(("Truth", truth, {"color": VERMILLION, "linewidth": 0.8, "dashes": (3, 2)}))
        reference = int(np.argmin(np.abs(frequencies - peak)))
        near = np.flatnonzero(np.abs(frequencies - peak) <= 12)
        for column, part in enumerate((slice(None), slice(near[0], near[-1] + 1))):
            f = frequencies[part]
            size, phase, coherence = grid[:, column]
            for label, values, look in curves:
                size.plot(f, 1e6 * np.abs(values[part]), label=label, **look)
                degrees = continuous_phase(values, fitted, reference)
                if values is measured.velocity:
                    # Without coherence the phase is noise.
                    degrees = np.where(known < 0.5, np.nan, degrees)
                phase.plot(f, degrees[part], **look)
            coherence.plot(f, known[part], color=GREEN, linewidth=0.6)
            for axes in (size, phase, coherence):
                axes.axvline(peak, color=GREY, linewidth=0.6, linestyle=(0, (1, 2)), zorder=0)
            coherence.set(xlabel="Frequency (Hz)", xlim=(f[0], f[-1]), ylim=(0, 1.05))
            coherence.xaxis.set_major_locator(MaxNLocator(5 if columns == 2 and not column else 3))
            phase.yaxis.set_major_locator(MaxNLocator(4, steps=[1.8, 3.6, 4.5, 9]))
        log_scale(grid[0, 0])
        grid[0, 1].set_ylim(bottom=0)
        grid[0, 0].set_ylabel("Velocity per volt (µm/s/V)")
        grid[1, 0].set_ylabel("Phase (°)")
        grid[2, 0].set_ylabel("Coherence")
        titles = {
            0: f"Patch {measured.patch}" + (f" to {_point(measured.point)}" if columns == 2 else ""),
            1: f"Resonance at {peak:.2f} Hz" if columns == 2 else f"{peak:.2f} Hz",
            2: "Phase", 3: "Phase", 4: "Coherence", 5: "Coherence",
        }  # fmt: skip
        rows = 1 if columns == 2 else len(curves)
        for index, axes in enumerate(grid.flat):
            letter(axes, index, titles.get(index, ""), legend_rows=rows if index < 2 else 0)
        legend_under(grid[0, 0], len(curves) if columns == 2 else 1)
        return figure


def _point(point: str) -> str:
    return "the button point" if point == "button" else f"point {point}"
