"""Common parts of the figures: palette, style, panels, headings, and simple signal processing."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont, get_font
from matplotlib.legend import Legend
from matplotlib.ticker import FuncFormatter, NullLocator
from matplotlib.transforms import ScaledTranslation
from numpy.typing import NDArray

from ...base.arrays import ComplexArray, FloatArray

# Palette of Okabe and Ito, distinguishable with any colour vision. Curves of one panel differ in brightness,
# width, dashes or marks as well, because journals are printed in grey.
BLUE, VERMILLION, GREEN = "#0072B2", "#D55E00", "#009E73"
ORANGE, PURPLE, SKY = "#E69F00", "#CC79A7", "#56B4E9"
GREY, SOFT, INK = "#8C8C8C", "#666666", "#222222"
_DASHES: tuple[Any, ...] = ("-", (0, (5, 2)), (0, (1.5, 1.5)), (0, (6, 1.5, 1.5, 1.5)), (0, (9, 3)))
_HATCHES = ("", "////", "....", "xxxx", "----", "oo")
BUTTON_COLOURS = (BLUE, ORANGE, GREEN, PURPLE, SKY, VERMILLION)

Columns = Literal[1, 2]
"""Width of a figure: one or two columns of a journal."""
_WIDTHS = {1: 3.46, 2: 7.1}
"""Inches; 88 and 180 mm."""
_TITLE_PAD, _LEGEND_ROW, _LETTER = 4.0, 11.0, 11.0
"""Points below a panel's title; that each row of a legend adds; from a panel's letter to its title."""

_SUPERSCRIPTS = "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"

_STYLE: Any = {
    "font.family": "sans-serif",
    "font.sans-serif": ["Arial", "Helvetica", "Liberation Sans", "DejaVu Sans"],
    "font.size": 8,
    "axes.titlesize": 8.5,
    "axes.titlepad": _TITLE_PAD,
    "axes.labelsize": 8,
    "axes.labelcolor": INK,
    "axes.edgecolor": "#555555",
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlelocation": "left",
    "axes.unicode_minus": True,
    # Numbers are written in full: a factor or an offset above the axis would stand in the title.
    "axes.formatter.limits": (-9, 9),
    "axes.formatter.useoffset": False,
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
    "legend.labelspacing": 0.25,
    "mathtext.default": "regular",
    "path.simplify": True,
    "figure.facecolor": "white",
    "figure.constrained_layout.h_pad": 0.05,
    "figure.constrained_layout.w_pad": 0.05,
    "agg.path.chunksize": 20000,
    # Text stays text, and the same figure is the same bytes.
    "pdf.fonttype": 42,
    "svg.hashsalt": "haploop",
}


def style() -> AbstractContextManager[None]:
    """Context manager that applies the common style to figures made and saved in it."""
    return mpl.rc_context(_STYLE)


def new_figure(height: float, columns: Columns = 2) -> Figure:
    """Create an empty figure of one or two columns' width, `height` inches high."""
    return Figure(figsize=(_WIDTHS[columns], height), layout="constrained")


def panels(
    rows: int, across: int, height: float, columns: Columns = 2, ratios: Sequence[float] = ()
) -> tuple[Figure, NDArray[Any]]:
    """Create a figure and its panels, an array of Axes (rows, across).

    On two columns' width the panels of a row stand side by side, with widths in the `ratios` given; on one
    column's width they stand one below the other. `height` (inches) is that of a row with its labels.
    """
    if columns == 2 or across == 1:
        figure = new_figure(height * rows + 0.35, columns)
        found = figure.subplots(rows, across, squeeze=False, width_ratios=ratios or None)
    else:
        figure = new_figure(height * rows * across + 0.35, columns)
        found = figure.subplots(rows * across, 1, squeeze=False).reshape(rows, across)
    return figure, found


def label_below(grid: NDArray[Any], labels: Sequence[str], columns: Columns = 2) -> None:
    """Label the x axes of `panels`: below the last row only, if the panels of a row stand side by side."""
    stacked = columns == 1 and grid.shape[1] > 1
    for row in grid if stacked else grid[-1:]:
        for axes, label in zip(row, labels, strict=True):
            axes.set_xlabel(label)


def letter(axes: Axes, index: int, title: str = "", legend_rows: int = 0) -> None:
    """Write the panel's letter, bold, and its title, above room for a legend of `legend_rows` rows."""
    pad = _TITLE_PAD + _LEGEND_ROW * legend_rows
    # With its height given, a title is not measured against the ticks' labels again and again.
    told = axes.set_title(title, y=1.0, pad=pad, parse_math=False)
    beside = ScaledTranslation(_LETTER / 72, 0, axes.figure.dpi_scale_trans)
    told.set_transform(told.get_transform() + beside)
    axes.annotate(
        chr(ord("a") + index), (0, 1), (0, pad), "axes fraction", "offset points",
        fontsize=mpl.rcParams["axes.titlesize"], fontweight="bold",
    )  # fmt: skip


def legend_under(axes: Axes, across: int, handles: Sequence[Any] | None = None) -> Legend:
    """Add a legend with `across` entries a row between the panel's title and its axes; see `letter`."""
    return axes.legend(
        handles=handles,
        loc="lower left",
        bbox_to_anchor=(0, 1),
        ncols=across,
        borderpad=0,
        borderaxespad=0.25,
        columnspacing=1.0,
        handlelength=1.4,
        handletextpad=0.4,
    )


def colour(index: int) -> str:
    """Colour of the button at `index`."""
    return BUTTON_COLOURS[index % len(BUTTON_COLOURS)]


def dash(index: int) -> Any:
    """Matplotlib's line style of curve `index` of a panel, for a printer that knows no colours."""
    return _DASHES[index % len(_DASHES)]


def hatch(index: int) -> str:
    """Hatching of bar `index`, for a printer that knows no colours."""
    return _HATCHES[index % len(_HATCHES)]


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


def smoothed(frequencies: FloatArray, density: FloatArray, stop_hz: float) -> tuple[FloatArray, FloatArray]:
    """Means of a spectral density over hundredths of the band up to `stop_hz`, each at its middle.

    Noise, whose lines scatter over two decades, is then a curve, and hides no other.
    """
    edges = np.linspace(0, stop_hz, 101)
    bins = np.digitize(frequencies, edges) - 1
    there = (bins >= 0) & (bins < 100)
    count = np.bincount(bins[there], minlength=100)
    total = np.bincount(bins[there], density[there], minlength=100)
    middle = (edges[:-1] + edges[1:]) / 2
    return middle[count > 0], total[count > 0] / count[count > 0]


def log_scale(axes: Axes) -> None:
    """Make the vertical axis of `axes` logarithmic.

    Powers of ten are written with superscript digits where the font has them: as formulas, which matplotlib
    parses, a dozen of them took as long as four panels.
    """
    axes.set_yscale("log")
    font = get_font(findfont(FontProperties()))
    if all(font.get_char_index(ord(mark)) for mark in _SUPERSCRIPTS):
        axes.yaxis.set_major_formatter(FuncFormatter(_power_of_ten))


def _power_of_ten(value: float, _position: int | None) -> str:
    exponent = round(np.log10(value))
    if not np.isclose(value, 10.0**exponent):
        return f"{value:g}"
    return "10" + "".join(_SUPERSCRIPTS["-0123456789".index(mark)] for mark in str(exponent))


def density_axis(axes: Axes, stop_hz: float, top: float) -> None:
    """Set up `axes` for spectral densities of acceleration: six decades up to `top`."""
    axes.set_xlim(0, stop_hz)
    axes.set_ylabel("PSD ((m/s²)²/Hz)")
    if top > 0:
        log_scale(axes)
        axes.set_ylim(2e-6 * top, 4 * top)
        # Forty of them on six decades are a grey edge, and take a fifth of a figure's time.
        axes.yaxis.set_minor_locator(NullLocator())


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


def share_x(grid: Any, hide: bool = True) -> None:
    """Give the panels of a column the same x axis; with `hide`, labels below the last one only."""
    side_by_side = grid.shape[1] == 1 or grid[0, 0].get_gridspec().ncols > 1
    for column in grid.T if hide else ():
        for axes in column[1:]:
            axes.sharex(column[0])
        for axes in column[:-1] if side_by_side else ():
            axes.tick_params(labelbottom=False)
