"""Common parts of the figures: style, page width, and simple signal processing."""

from __future__ import annotations

import io
from contextlib import AbstractContextManager
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from haploop.instruments.arrays import ComplexArray, FloatArray

__all__ = [
    "BLUE",
    "GREEN",
    "GREY",
    "INK",
    "ORANGE",
    "SKY",
    "VERMILLION",
    "active",
    "colour",
    "continuous_phase",
    "density_axis",
    "legend_above",
    "letter",
    "mark_simulated",
    "new_figure",
    "png",
    "spectrum",
    "style",
    "unit_peak",
]

# Palette of Okabe and Ito, distinguishable with any colour vision.
BLUE, VERMILLION, GREEN = "#0072B2", "#D55E00", "#009E73"
ORANGE, PURPLE, SKY = "#E69F00", "#CC79A7", "#56B4E9"
GREY, INK = "#8C8C8C", "#222222"
BUTTON_COLOURS = (BLUE, ORANGE, GREEN, PURPLE, SKY, VERMILLION)

WIDTH = 7.1
"""Width of a journal's double column (inches; 180 mm)."""

_STYLE: Any = {
    "font.family": "sans-serif",
    "font.sans-serif": ["Arial", "Helvetica", "Liberation Sans", "DejaVu Sans"],
    "font.size": 8,
    "axes.titlesize": 8.5,
    "axes.labelsize": 8,
    "axes.labelcolor": INK,
    "axes.edgecolor": "#555555",
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlelocation": "left",
    "axes.unicode_minus": True,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "xtick.color": "#555555",
    "ytick.color": "#555555",
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.direction": "out",
    "ytick.direction": "out",
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "xtick.major.size": 2.8,
    "ytick.major.size": 2.8,
    "ytick.minor.size": 1.5,
    "lines.linewidth": 0.9,
    "lines.solid_joinstyle": "round",
    "legend.fontsize": 7.5,
    "legend.frameon": False,
    "legend.handlelength": 1.6,
    "legend.borderaxespad": 0.2,
    "mathtext.default": "regular",
    "path.simplify": True,
    "figure.facecolor": "white",
    "figure.constrained_layout.h_pad": 0.05,
    "figure.constrained_layout.w_pad": 0.05,
    "agg.path.chunksize": 20000,
}


def style() -> AbstractContextManager[None]:
    """Context manager that applies the common style to figures made and saved in it."""
    return mpl.rc_context(_STYLE)


def new_figure(height: float) -> Figure:
    """Create an empty figure of the page's width, `height` inches high."""
    return Figure(figsize=(WIDTH, height), layout="constrained")


def letter(axes: Axes, index: int, title: str = "") -> None:
    """Write the panel's letter, bold, and its title."""
    bold = rf"$\bf{{{chr(ord('a') + index)}}}$"
    axes.set_title(f"{bold}  {title}" if title else bold)


def legend_above(axes: Axes, columns: int) -> None:
    """Add a legend above the panel's title, outside the layout."""
    legend = axes.legend(
        loc="lower right",
        bbox_to_anchor=(1.03, 1.13),
        ncols=columns,
        columnspacing=0.8,
        handlelength=0.9,
        handletextpad=0.4,
    )
    legend.set_in_layout(False)


def mark_simulated(figure: Figure) -> None:
    """Mark a figure as simulated in a corner, because a PNG is often passed on without its report."""
    figure.text(0.997, 0.004, "simulated", ha="right", va="bottom", fontsize=7, color="#666666")


def colour(index: int) -> str:
    """Colour of the button at `index`."""
    return BUTTON_COLOURS[index % len(BUTTON_COLOURS)]


def spectrum(signal: FloatArray, rate_hz: float) -> tuple[FloatArray, FloatArray]:
    """Compute the one-sided power spectral density of a transient (samples,): Hz, and unit^2/Hz.

    One Fourier transform covers the whole signal, as in the paper; a press begins and ends at rest,
    so no window is needed. Zero padding to at least 0.5 s only refines the frequency grid.
    """
    points = max(len(signal), round(rate_hz / 2))
    lines = np.fft.rfft(signal, points)
    density = np.abs(lines) ** 2 / (rate_hz * len(signal))
    density[1 : (points + 1) // 2] *= 2
    return np.asarray(np.fft.rfftfreq(points, 1 / rate_hz), dtype=np.float64), density


def density_axis(axes: Axes, stop_hz: float, top: float) -> None:
    """Set up `axes` for spectral densities of acceleration: six decades up to `top`."""
    axes.set_xlim(0, stop_hz)
    axes.set_ylabel("PSD ((m/s²)²/Hz)")
    if top > 0:
        axes.set_yscale("log")
        axes.set_ylim(2e-6 * top, 4 * top)
        axes.yaxis.set_minor_formatter(NullFormatter())


def active(signal: FloatArray, rate_hz: float) -> tuple[float, float]:
    """Begin and end (s) of the part above 1 % of the peak, extended by 10 % to either side."""
    loud = np.flatnonzero(np.abs(signal) > 0.01 * np.max(np.abs(signal), initial=0.0))
    if not len(loud):
        return 0.0, len(signal) / rate_hz
    margin = 0.1 * (loud[-1] - loud[0] + 1)
    return max(0.0, (loud[0] - margin) / rate_hz), min(len(signal), loud[-1] + margin) / rate_hz


def continuous_phase(values: ComplexArray, smooth: ComplexArray, reference: int) -> FloatArray:
    """Phase (degrees) of `values`, unwrapped along `smooth`, its noise-free counterpart.

    At index `reference` it lies within 180 degrees of zero. Unwrapping the noisy values directly would
    add false turns near zero magnitude.
    """
    phase = np.unwrap(np.angle(smooth))
    phase -= 2 * np.pi * np.round(phase[reference] / (2 * np.pi))
    return np.asarray(np.rad2deg(phase + np.angle(values * np.conj(smooth))))


def unit_peak(signal: FloatArray) -> FloatArray:
    """Scale a signal to unit peak magnitude; a zero signal stays zero."""
    peak = float(np.max(np.abs(signal), initial=0.0))
    return signal / peak if peak > 0 else signal


def png(figure: Figure, dpi: int = 200) -> bytes:
    """Encode a figure as PNG bytes, reproducibly: without a date or program name."""
    buffer = io.BytesIO()
    with style():
        figure.savefig(buffer, format="png", dpi=dpi, metadata={"Software": None})
    return buffer.getvalue()
