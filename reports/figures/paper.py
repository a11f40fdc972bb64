"""Figures 7 to 9 of the paper for one run, in the layout of a journal.

Every function takes results of the other packages and returns a matplotlib Figure; only spectra and
means are computed here. No pyplot state is used, so figures can be made in any process.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...base.arrays import FloatArray
from ...base.wording import capital
from ...calibration.drive import activation_time
from .plotting import (
    BLUE,
    GREY,
    INK,
    ORANGE,
    SKY,
    Columns,
    active,
    colour,
    density_axis,
    label_below,
    legend_under,
    letter,
    panels,
    share_x,
    smoothed,
    spectrum,
    style,
    unit_peak,
)

if TYPE_CHECKING:
    from ...acquisition import Representative
    from ...calibration import Check, Drive

_TITLE = 42
"""Characters of a title that fit above a panel one column wide."""
_NAMES = 40
"""Most characters of names side by side below a panel."""


def activation_forces(
    forces: Mapping[str, Mapping[str, FloatArray]],
    true_means: Mapping[str, float] | None = None,
    columns: Columns = 2,
) -> Figure:
    """Draw figure 7: force at activation (N) of each button and participant, and of all together.

    `forces` is button -> participant -> (presses,); `true_means` is button -> N, known on a
    simulated rig.
    """
    truth = true_means or {}
    participants = list(dict.fromkeys(p for by in forces.values() for p in by))
    everyone = {button: np.concatenate(list(by.values())) for button, by in forces.items()}
    with style():
        # The paper puts all buttons together in the upper right.
        order: list[str | None] = [*forces]
        order.insert(1, None)
        # Below each other, an odd number of panels leaves no place empty.
        figure, grid = panels(-(-len(order) // columns), columns, 1.8, columns)
        for place, (axes, button) in enumerate(zip(grid.flat, order, strict=False)):
            if button is None:
                letter(axes, place, "All together", legend_rows=1 if truth else 0)
                _together(axes, everyone, truth)
                continue
            index = list(forces).index(button)
            beside = place == 0 and columns == 2 and bool(truth)
            letter(axes, place, capital(button), legend_rows=1 if beside else 0)
            by = forces[button]
            _forces(axes, [by.get(p, np.empty(0)) for p in participants], participants, [colour(index)])
            mean = float(np.mean(everyone[button]))
            axes.axhline(mean, color=colour(index), linewidth=0.6, linestyle=(0, (4, 3)), zorder=0)
            # The axis need not start at zero: it compares participants; panel b compares buttons.
            axes.margins(y=0.35)
        for axes in list(grid.flat)[len(order) :]:
            figure.delaxes(axes)
        for axes in grid[:, 0] if columns == 2 else figure.axes:
            axes.set_ylabel("Force at activation (N)")
        return figure


def drives(
    waveforms: Sequence[Drive], limits: tuple[float, float] | None = None, columns: Columns = 2
) -> Figure:
    """Draw figure 8: the voltage at each patch for each button; `limits` are the lowest and highest (V)."""
    with style():
        each = [(drive, *own) for drive in waveforms for own in zip(drive.patches, drive.volts, strict=True)]
        figure, grid = panels(len(each), 1, 1.3, columns)
        end = max(active(volts, drive.rate_hz)[1] for drive, _, volts in each)
        for row, ((drive, patch, volts), axes) in enumerate(zip(each, grid[:, 0], strict=True)):
            time = 1e3 * np.arange(len(volts)) / drive.rate_hz
            if limits:
                label = "limit of the rig"
                for level in limits:
                    axes.axhline(level, color=GREY, linewidth=0.6, linestyle=(0, (4, 3)), label=label)
                    label = ""
            axes.plot(time, volts, color=colour(row), linewidth=0.6)
            axes.set_xlim(0, 1e3 * end)
            axes.set_ylabel("Voltage (V)")
            peak_to_peak = float(np.ptp(volts))
            told = f", patch {patch}: {peak_to_peak:.1f} V peak to peak"
            name = capital(drive.button)
            room = _TITLE * columns - len(told)
            title = (name if len(name) <= room else f"{name[: room - 1]}…") + told
            letter(axes, row, title, legend_rows=1 if limits and row == 0 else 0)
            if row:
                axes.sharey(grid[0, 0])
        if limits:
            grid[0, 0].set_ylim(1.16 * limits[0], 1.16 * limits[1])
            legend_under(grid[0, 0], 1)
        share_x(grid)
        label_below(grid, ("Time (ms)",), columns)
        return figure


def comparison(results: Sequence[tuple[Representative, Check]], columns: Columns = 2) -> Figure:
    """Draw figure 9: the recorded press, the target and the measured acceleration.

    Per button: the recorded press above the measured acceleration, each scaled to unit peak as in
    the paper; a stretch around the largest acceleration, target over measured; and the spectra.
    """
    with style():
        figure, grid = panels(len(results), 3, 1.75, columns, ratios=(1.3, 1, 1.05))
        for row, ((press, check), (whole, stretch, spectra)) in enumerate(zip(results, grid, strict=True)):
            room = 1 if row == 0 else 0
            letter(whole, 3 * row, f"{capital(press.button)}: {check.verdict}", 2 * room * (columns == 2))
            low, high = (f"{100 * edge:.{int(edge < 1)}f}" for edge in check.whole.interval)
            error = f"{low} to {high} %" if check.whole.interval[0] else f"at most {high} %"
            title = f"Error {error}, r = {check.correlation:.3f}"
            letter(stretch, 3 * row + 1, title, (columns if columns == 2 else 1) * room)
            letter(spectra, 3 * row + 2, "Spectrum", 2 * room)
            _whole(whole, press, check)
            _stretch(stretch, press, check, with_legend=row == 0)
            _spectra(spectra, press, check, with_legend=row == 0)
        share_x(grid, hide=False)
        label_below(
            grid, ("Time after activation (ms)", "Time after activation (ms)", "Frequency (Hz)"), columns
        )
        return figure


def _together(axes: Axes, everyone: Mapping[str, FloatArray], truth: Mapping[str, float]) -> None:
    names = [capital(button) for button in everyone]
    _forces(axes, list(everyone.values()), names, [colour(i) for i in range(len(everyone))])
    label = "truth of the plant"
    for index, button in enumerate(everyone):
        if button in truth:
            axes.plot([index - 0.3, index + 0.3], [truth[button]] * 2, color=INK, linewidth=0.8, label=label)
            label = ""
    # From zero, and with room above: presses that agree would lie on the frame.
    highest = max((float(np.max(values)) for values in everyone.values() if len(values)), default=1.0)
    axes.set_ylim(0, 1.1 * max(highest, *truth.values(), 1e-3))
    if truth:
        legend_under(axes, 1)


def _forces(axes: Axes, groups: Sequence[FloatArray], names: Sequence[str], colours: Sequence[str]) -> None:
    for index, values in enumerate(groups):
        if not len(values):
            continue
        # Presses are spread evenly beside their mean, because random jitter would differ between runs.
        offsets = np.linspace(-0.22, 0.22, len(values)) if len(values) > 1 else np.zeros(1)
        colour = colours[index % len(colours)]
        axes.plot(index + offsets, values, "o", markersize=2.2, color=colour, alpha=0.35, markeredgewidth=0)
        deviation = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
        axes.errorbar(
            index, float(np.mean(values)), yerr=deviation, fmt="s", markersize=3.6, color=colour,
            elinewidth=0.9, capsize=2.5, capthick=0.9,
        )  # fmt: skip
    # Long or many names are turned, so that they stay apart.
    turned = sum(len(name) + 1 for name in names) > _NAMES
    axes.set_xticks(
        range(len(names)), [name.replace("$", r"\$") for name in names], rotation=90 if turned else 0
    )
    margin = max(0.6, (4 - len(names)) / 2)
    axes.set_xlim(-margin, len(names) - 1 + margin)


def _whole(axes: Axes, press: Representative, check: Check) -> None:
    """Draw the recorded press above the measured motion: one over the other, each would hide the other."""
    drive = check.drive
    zero = activation_time(press, drive)
    measured = np.arange(len(check.measured)) / check.rate_hz - zero
    recorded = (np.arange(len(press.acceleration)) - press.activation_index) / press.rate_hz
    curves = ((1.1, recorded, press.acceleration, BLUE), (-1.1, measured, check.measured, INK))
    for level, time, values, paint in curves:
        axes.axhline(level, color=GREY, linewidth=0.4, zorder=0)
        axes.plot(1e3 * time, level + unit_peak(values), color=paint, linewidth=0.6)
    axes.set_xlim(*(1e3 * (edge - zero) for edge in active(drive.target, drive.rate_hz)))
    axes.set_ylim(-2.3, 2.3)
    axes.set_yticks([1.1, -1.1], ["recorded", "measured"], rotation=90, va="center")
    for tick, paint in zip(axes.get_yticklabels(), (BLUE, INK), strict=True):
        tick.set_color(paint)
    axes.set_ylabel("Acceleration (1 = peak)")


def _stretch(axes: Axes, press: Representative, check: Check, with_legend: bool) -> None:
    time = 1e3 * (np.arange(len(check.target)) / check.rate_hz - activation_time(press, check.drive))
    middle = time[int(np.argmax(np.abs(check.target)))]
    part = (time >= middle - 15) & (time <= middle + 15)
    axes.plot(time[part], check.target[part], color=ORANGE, linewidth=2.0, label="Target")
    axes.plot(time[part], check.measured[part], color=INK, linewidth=0.8, label="Measured")
    axes.set_xlim(time[part][0], time[part][-1])
    axes.set_ylabel("Acceleration (m/s²)")
    if with_legend:
        legend_under(axes, 2)


def _spectra(axes: Axes, press: Representative, check: Check, with_legend: bool) -> None:
    drive = check.drive
    curves: tuple[tuple[str, FloatArray, float, dict[str, Any]], ...] = (
        ("Recorded", press.acceleration * drive.scale, press.rate_hz, {"color": BLUE, "linewidth": 0.8}),
        ("Target", check.target, check.rate_hz, {"color": ORANGE, "linewidth": 1.9}),
        ("Measured", check.measured, check.rate_hz, {"color": INK, "linewidth": 0.7}),
        (
            "Noise",
            check.noise,
            check.rate_hz,
            {"color": SKY, "linewidth": 0.5, "linestyle": ":", "zorder": 1},
        ),
    )
    top = 0.0
    for label, signal, rate_hz, look in curves:
        frequencies, density = smoothed(*spectrum(np.asarray(signal), rate_hz), check.judged_hz)
        axes.plot(frequencies, density, label=label, **look)
        top = max(top, float(density.max()))
    density_axis(axes, check.judged_hz, top)
    axes.axvspan(*drive.band, color=GREY, alpha=0.25, linewidth=0)
    if with_legend:
        legend_under(axes, 2)
