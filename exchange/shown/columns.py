"""Figure of a file of another program, as it was understood."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from ...base.arrays import FloatArray
from ...reports.figures import BLUE, GREEN, ORANGE, SOFT, VERMILLION, Columns, new_figure, style
from ..importing import Understanding, presses_in

_COLOURS = {"force": VERMILLION, "displacement": ORANGE, "acceleration": BLUE, "activation": GREEN}
_AXES = {
    "force": "force (N)", "displacement": "travel (mm)", "acceleration": "acceleration\n(m/s²)",
    "activation": "activation",
}  # fmt: skip
_MOST = 20_000
"""Points of a curve; more are drawn as the smallest and the largest of equal parts."""


def columns_figure(files: Sequence[Understanding], columns: Columns = 2) -> Figure:
    """Draw each signal of a file over time, with the presses found marked."""
    (found,) = files
    roles = [role for role in _COLOURS if role in found.signals and len(found.signals[role].values)]
    with style():
        figure = new_figure(0.4 + 1.1 * len(roles), columns)
        axes = figure.subplots(len(roles), 1, sharex=True, squeeze=False)[:, 0]
        for axis, role in zip(axes, roles, strict=True):
            values = found.signals[role].values * (1e3 if role == "displacement" else 1.0)
            time, curve = _thinned(values, found.rate_hz)
            axis.plot(time, curve, color=_COLOURS[role], linewidth=0.6)
            axis.set_ylabel(_AXES[role])
            for instant in presses_in(found):
                axis.axvline(instant, color=SOFT, linewidth=0.5, linestyle=":")
        axes[-1].set_xlabel("time (s)")
    return figure


def _thinned(values: FloatArray, rate_hz: float) -> tuple[FloatArray, FloatArray]:
    width = max(1, -(-len(values) // (_MOST // 2)))
    if width == 1:
        return np.arange(len(values)) / rate_hz, values
    whole = values[: len(values) // width * width].reshape(-1, width)
    curve = np.stack([whole.min(axis=1), whole.max(axis=1)], axis=1).ravel()
    return np.arange(len(curve)) * width / 2 / rate_hz, curve
