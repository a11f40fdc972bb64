"""The measured response of a table, its coherence and phase, and the fitted model."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ...base.arrays import ComplexArray
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
