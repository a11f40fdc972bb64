"""Figures in the style of a journal, from a script or a notebook: `haploop.plot.press(press)`.

Each function returns a matplotlib Figure, one or two columns of a journal wide, marked if it shows simulated
data. `save` writes it as PNG, PDF, SVG or CSV (what it draws), the same bytes every time.

For example:

    >>> figure = haploop.plot.press(haploop.load("press.h5"), columns=1)
    >>> haploop.plot.save(figure, "press.svg")
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

from matplotlib.figure import Figure

from ..acquisition import Curve, Recording, Representative, accepted_presses
from ..base.errors import DataError
from ..calibration import ButtonPlan, Calibration, Check, DigitalButton, Drive, History, check_feeling
from ..calibration.map import VibrationMap
from . import figures
from .contents import forces_in, simulated
from .figures import Columns
from .outputs import PICTURES, check_new_file, save_picture

_One = TypeVar("_One")

_PIXELS_PER_INCH = 100

__all__ = [
    "button",
    "check",
    "comparison",
    "curve",
    "drive",
    "feeling",
    "forces",
    "plan",
    "press",
    "recording",
    "response",
    "save",
    "trend",
    "vibration_map",
]


def recording(of: Recording, columns: Columns = 2) -> Figure:
    """Draw the accepted press with the median force at activation, like the paper's figure 6.

    Raises DataError when there is none.
    """
    return shown(figures.recording_figure([(of, accepted_presses(of))], columns), of.simulated)


def press(*presses: Representative, columns: Columns = 2) -> Figure:
    """Draw representative presses, one below the other, like the paper's figure 6."""
    profiles = [figures.Profile.of(one) for one in _some(presses, "representative presses")]
    return shown(figures.profiles(profiles, columns), any(one.simulated for one in presses))


def plan(*plans: ButtonPlan, columns: Columns = 2) -> Figure:
    """Draw what error buys which level above threshold, of buttons that are planned."""
    return shown(figures.plan_figure(_some(plans, "plans"), columns), any(one.simulated for one in plans))


def forces(recordings: Sequence[Recording], columns: Columns = 2) -> Figure:
    """Draw the force at activation by participant and button, like the paper's figure 7. Raises DataError."""
    found = forces_in(recordings)
    if not found:
        raise DataError("The recordings hold no accepted press with an activation, so there is no force.")
    simulated_one = any(one.simulated for one in recordings)
    return shown(figures.activation_forces(found, columns=columns), simulated_one)


def response(calibration: Calibration, columns: Columns = 2) -> Figure:
    """Draw the measured response, the model and the coherence of a calibration."""
    return shown(figures.response(calibration, columns=columns), calibration.response.simulated)


def vibration_map(found: VibrationMap, columns: Columns = 2) -> Figure:
    """Draw the displacement over the table and the strongest modes, like the paper's figure 3."""
    return shown(figures.map_figure(found, columns), found.plan.simulated)


def curve(*curves: Curve, columns: Columns = 2) -> Figure:
    """Draw force-travel curves, laid over each other."""
    figure = figures.curves_figure(_some(curves, "curves"), columns)
    return shown(figure, any(one.simulated for one in curves))


def drive(*drives: Drive, columns: Columns = 2) -> Figure:
    """Draw voltages at the patch, one below the other, like the paper's figure 8."""
    _some(drives, "drives")
    return shown(figures.drives(drives, columns=columns), any(one.simulated for one in drives))


def check(of: Check, columns: Columns = 2) -> Figure:
    """Draw target and measured motion, third octaves, and what is felt of them."""
    return shown(figures.check_figure(of, columns), of.simulated)


def comparison(*buttons: DigitalButton, columns: Columns = 2) -> Figure:
    """Draw the recorded press against the measured motion of digital buttons, like the paper's figure 9."""
    results = [(one.press, one.check) for one in _some(buttons, "digital buttons")]
    return shown(figures.comparison(results, columns), any(one.simulated for one in buttons))


def button(of: DigitalButton, columns: Columns = 2) -> Figure:
    """Draw the check of a digital button, what is felt of it, and the error of each iteration."""
    return shown(figures.button_figure(of, columns), of.simulated)


def feeling(*buttons: DigitalButton, columns: Columns = 2) -> Figure:
    """Draw what a finger would feel of digital buttons: levels against thresholds of detection."""
    results = [
        (one.press.button, check_feeling(one.check, one.press)) for one in _some(buttons, "digital buttons")
    ]
    return shown(figures.feeling_figure(results, columns), any(one.simulated for one in buttons))


def trend(history: History, columns: Columns = 2) -> Figure:
    """Draw resonance, damping, gain and coherence of a calibration history over time. Raises DataError."""
    return shown(figures.trend(history, columns), simulated(history))


def save(figure: Figure, path: str | Path) -> None:
    """Write a figure of this module as a new PNG, PDF, SVG or CSV, by the suffix of `path`.

    Raises ConfigurationError when the file exists or cannot be written.
    """
    path = Path(path)
    check_new_file(path, PICTURES)
    save_picture(figure, path, simulated=False)  # it is marked already


def __dir__() -> list[str]:
    """What the tab key finds: the figures, and nothing else."""
    return list(__all__)


def _some(things: Sequence[_One], what: str) -> Sequence[_One]:
    if not things:
        raise DataError(f"There are no {what} to plot.")
    return things


def shown(figure: Figure, is_simulated: bool) -> Figure:
    """The figure, marked where it shows what is simulated; a notebook shows it as a picture."""
    if is_simulated:
        figures.mark_simulated(figure)
    _let_notebooks_show_figures()
    return figure


def _let_notebooks_show_figures() -> None:
    """A notebook shows a Figure as a picture only when pyplot was imported; make it do so without."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    if shell is None:
        return
    formatter = shell.display_formatter.formatters["image/png"]
    if Figure not in formatter.type_printers:
        formatter.for_type(Figure, _picture)


def _picture(figure: Figure) -> tuple[bytes, dict[str, int]]:
    """A figure as PNG, and its width in a notebook: in proportion to its columns."""
    return figures.png(figure), {"width": round(_PIXELS_PER_INCH * figure.get_figwidth())}
