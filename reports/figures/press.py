"""Figures of presses: one of each recording, like the paper's figure 6, over time, spectra and travel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ...acquisition import ButtonPress, Recording, high_pass
from ...acquisition.presses import bandwidth_of
from ...base.arrays import FloatArray
from ...base.errors import DataError
from ...base.wording import capital
from .plotting import (
    BLUE,
    GREEN,
    GREY,
    SOFT,
    VERMILLION,
    Columns,
    colour,
    density_axis,
    label_below,
    legend_under,
    letter,
    panels,
    share_x,
    spectrum,
    style,
)

if TYPE_CHECKING:
    from ...acquisition import Representative


_SETTLING = 10.0
"""s before and after a press, of which nothing is left in it behind the high-pass."""


def recording_figure(
    recordings: Sequence[tuple[Recording, tuple[ButtonPress, ...]]], columns: Columns = 2
) -> Figure:
    """Draw, of each recording, its press with the median force at activation. Raises DataError."""
    return profiles([_press_of(one, _median_press(one, found)) for one, found in recordings], columns)


def travel_figure(recording: Recording, found: Sequence[ButtonPress], columns: Columns = 2) -> Figure:
    """Draw the force over the travel of presses of a recording that has both."""
    return force_over_travel([_press_of(recording, press) for press in found], columns)


def _median_press(recording: Recording, found: tuple[ButtonPress, ...]) -> ButtonPress:
    """The press with the median force at activation, or the middle one without forces.

    Raises DataError when none has an activation.
    """
    whole = [p for p in found if p.activation is not None]
    if not whole:
        raise DataError(
            f"{recording.path} holds no accepted press with an activation, so there is nothing to plot."
        )
    return sorted(whole, key=lambda p: p.force_at_activation or 0.0)[len(whole) // 2]


def _press_of(recording: Recording, press: ButtonPress) -> Profile:
    """One press of a recording, to draw; its time begins at its activation, or at its onset without one."""
    zero = press.onset if press.activation is None else press.activation
    part = slice(press.start, press.stop)
    time = np.asarray((np.arange(press.start, press.stop) - zero) / recording.rate_hz)
    moved, bandwidth_hz = np.zeros(len(time)), None
    if recording.motion:
        first = max(0, press.start - round(_SETTLING * recording.rate_hz))
        near = slice(first, press.stop + round(_SETTLING * recording.rate_hz))
        moved = high_pass(recording.in_parts("vertical")[near], recording.rate_hz)
        moved = moved[press.start - first : press.stop - first]
        bandwidth_hz = min(bandwidth_of(recording), recording.motion_hz or np.inf)
    activation = np.asarray(time >= 0, dtype=np.float64)
    if recording.has("activation"):
        # A maintained button opens at every other press: plot the change of state.
        state = recording.in_parts("activation")[part]
        activation = np.abs(state - state[0])
    return Profile(
        button=recording.button,
        time=time,
        acceleration=moved,
        force=recording.in_parts("force")[part] if recording.has("force") else None,
        activation=activation,
        rate_hz=recording.rate_hz,
        bandwidth_hz=bandwidth_hz if bandwidth_hz and np.isfinite(bandwidth_hz) else None,
        travel=recording.in_parts("travel")[part] if recording.has("displacement") else None,
        motion=recording.motion or "",
        activated_by=press.activated_by,
        participant=recording.participant,
    )


# Figure 6 of the paper, presses over time and their spectra, and the force over the travel.


@dataclass(frozen=True, eq=False)
class Profile:
    """A press to draw: arrays (samples,), with the time (s) of each sample relative to activation."""

    button: str
    time: FloatArray
    acceleration: FloatArray
    force: FloatArray | None
    activation: FloatArray
    rate_hz: float
    bandwidth_hz: float | None = None
    spread: FloatArray | None = None
    """Standard deviation of the averaged presses (m/s^2)."""
    travel: FloatArray | None = None
    """m of the cap."""
    motion: str = "acceleration"
    """What the acceleration is from, see `Representative.motion`."""
    activated_by: str = "activation"
    """See `Representative.activated_by`."""
    participant: str = ""
    """Whose press it is; empty for one that stands for many."""

    @classmethod
    def of(cls, press: Representative) -> Profile:
        """Profile of a representative press."""
        time = (np.arange(len(press.acceleration)) - press.activation_index) / press.rate_hz
        return cls(
            press.button,
            time,
            press.acceleration,
            press.force,
            press.activation,
            press.rate_hz,
            press.bandwidth_hz,
            press.spread,
            press.travel,
            press.motion,
            press.activated_by,
        )


def profiles(presses: Sequence[Profile], columns: Columns = 2) -> Figure:
    """Draw figure 6: normalised acceleration, force and activation over time, and the spectral density."""
    with style():
        figure, grid = panels(len(presses), 2, 1.62, columns, ratios=(1.55, 1))
        for row, (press, (left, right)) in enumerate(zip(presses, grid, strict=True)):
            room = 1 if row == 0 else 0
            whose = f", {press.participant}" if press.participant else ""
            letter(left, 2 * row, f"{capital(press.button)}{whose}", room)
            letter(right, 2 * row + 1, "Spectrum", room if columns == 2 else 0)
            _profile(left, press, with_legend=row == 0)
            _density(right, press, with_legend=row == 0)
        share_x(grid)
        label_below(grid, ("Time after activation (ms)", "Frequency (Hz)"), columns)
        return figure


def _profile(axes: Axes, press: Profile, with_legend: bool) -> None:
    time = 1e3 * press.time
    peak = float(np.max(np.abs(press.acceleration))) or 1.0
    axes.fill_between(
        time, 0, 1, where=press.activation > 0.5, transform=axes.get_xaxis_transform(),
        color=GREEN, alpha=0.10, linewidth=0,
    )  # fmt: skip
    slow = _pressed(axes, press)
    if press.spread is not None:
        band = press.spread / peak
        centre = press.acceleration / peak
        axes.fill_between(time, centre - band, centre + band, color=BLUE, alpha=0.3, linewidth=0)
    (acceleration,) = axes.plot(
        time, press.acceleration / peak, color=BLUE, linewidth=0.8, label=_motion_label(press)
    )
    (state,) = axes.plot(
        time, press.activation, color=GREEN, linewidth=0.9, linestyle="--", label=_activation_label(press)
    )
    axes.set_ylim(-1.2, 1.2)
    axes.set_yticks([-1, 0, 1])
    axes.set_xlim(time[0], time[-1])
    axes.set_ylabel("Acceleration\n(1 = peak)", color=BLUE)
    axes.tick_params(axis="y", labelcolor=BLUE)
    axes.annotate(
        f"peak {peak:.1f} m/s²", (1, 0), xycoords="axes fraction", xytext=(-3, 3),
        textcoords="offset points", ha="right", va="bottom", fontsize=7, color=BLUE,
    )  # fmt: skip
    if with_legend:
        legend_under(axes, 3, [acceleration, *slow, state])


def _pressed(axes: Axes, press: Profile) -> list[Any]:
    """Draw the force, or the travel where there is none, on an axis of its own at the right."""
    values, label, unit = press.force, "Force", "N"
    if values is None and press.travel is not None:
        values, label, unit = 1e3 * press.travel, "Travel", "mm"
    if values is None:
        return []
    twin = axes.twinx()
    twin.spines["right"].set_visible(True)
    twin.spines["right"].set_color(VERMILLION)
    twin.tick_params(axis="y", color=VERMILLION, labelcolor=VERMILLION)
    lines = twin.plot(1e3 * press.time, values, color=VERMILLION, linewidth=1.4, label=label)
    twin.set_ylabel(f"{label} ({unit})", color=VERMILLION, y=0.75)
    top = max(float(values.max()), 1e-3)
    twin.set_ylim(-1.2 * top, 1.2 * top)
    # Zero force is level with zero acceleration; the axis shows no labels below it.
    twin.yaxis.set_major_locator(MaxNLocator(5))
    twin.set_yticks([t for t in twin.get_yticks() if 0 <= t <= 1.15 * top])
    twin.spines["right"].set_bounds(0, 1.2 * top)
    axes.set_zorder(twin.get_zorder() + 1)
    axes.patch.set_visible(False)
    return list(lines)


def _motion_label(press: Profile) -> str:
    return "Acceleration" if press.motion == "acceleration" else f"Acceleration (from {press.motion})"


def _activation_label(press: Profile) -> str:
    """What the activation is, and from what it was taken where no contact told it."""
    if press.activated_by == "activation":
        return "Activation"
    return f"Activation ({'' if press.activated_by == 'stated' else 'from '}{press.activated_by})"


def force_over_travel(presses: Sequence[Profile], columns: Columns = 2) -> Figure:
    """Draw the force (N) over the travel (mm) of presses that have both."""
    with style():
        figure, grid = panels(1, 1, 2.2, columns)
        axes = grid[0, 0]
        for number, press in enumerate(presses):
            assert press.force is not None and press.travel is not None
            axes.plot(
                1e3 * press.travel, press.force, color=colour(number), linewidth=0.9,
                label=capital(press.button),
            )  # fmt: skip
            at = int(np.argmin(np.abs(press.time)))
            axes.plot(1e3 * press.travel[at], press.force[at], "o", color=colour(number), markersize=3)
        axes.set_xlabel("Travel (mm)")
        axes.set_ylabel("Force (N)")
        if len({press.button for press in presses}) > 1:
            legend_under(axes, 3)
        return figure


def _density(axes: Axes, press: Profile, with_legend: bool) -> None:
    frequencies, density = spectrum(press.acceleration, press.rate_hz)
    part = (frequencies >= 5) & (frequencies <= 1000)
    axes.plot(frequencies[part], density[part], color=BLUE)
    density_axis(axes, 1000, float(density[part].max()))
    if press.bandwidth_hz and press.bandwidth_hz < 1000:
        axes.axvline(press.bandwidth_hz, color=GREY, linewidth=0.6, linestyle=(0, (4, 3)))
        if with_legend:
            # Left of the line where the label does not fit on its right.
            left = press.bandwidth_hz > 550
            axes.annotate(
                f"sensor's corner, {press.bandwidth_hz:g} Hz", (press.bandwidth_hz, 1),
                xycoords=("data", "axes fraction"), xytext=(-3 if left else 3, -2),
                textcoords="offset points", ha="right" if left else "left", va="top", fontsize=7, color=SOFT,
            )  # fmt: skip
