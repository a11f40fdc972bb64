"""The small figure of a glance, as SVG inside a page: it takes its colours from the page, also when dark."""

from __future__ import annotations

import numpy as np
from markupsafe import Markup

from ...instruments.arrays import FloatArray
from ..contents import Motion

_WIDTH, _HEIGHT = 360, 100
"""Units of the drawing, which is stretched to its place in the page."""


def small_figure(motion: Motion) -> Markup:
    """Draw recorded press, tolerated band, measured motion and activation as an SVG element."""
    low, high = float(motion.time[0]), float(motion.time[-1])
    curves = [motion.target + motion.band, motion.target - motion.band, motion.measured]
    top = 1.05 * max(1.0, *(float(np.abs(one).max()) for one in curves))

    def across(time: FloatArray) -> FloatArray:
        return np.asarray(_WIDTH * (time - low) / (high - low))

    def line(values: FloatArray) -> str:
        down = _HEIGHT * (0.5 - 0.5 * np.clip(values / top, -1, 1))
        return "L".join(f"{x:.1f} {y:.1f}" for x, y in zip(across(motion.time), down, strict=True))

    band = f"M{line(motion.target + motion.band)}L{_reversed(line(motion.target - motion.band))}Z"
    parts = [f'<path class="band" d="{band}"/>']
    if motion.recorded is not None:
        parts.append(f'<path class="recorded" d="M{line(motion.recorded)}"/>')
    parts.append(f'<path class="measured" d="M{line(motion.measured)}"/>')
    if motion.activation is not None:
        x = float(across(np.array([motion.activation]))[0])
        parts.append(f'<path class="activation" d="M{x:.1f} 0V{_HEIGHT}"/>')
    return Markup(
        f'<svg class="motion" viewBox="0 0 {_WIDTH} {_HEIGHT}" preserveAspectRatio="none" role="img" '
        f'aria-label="Recorded press, tolerated band and measured motion">{"".join(parts)}</svg>'
    )


def _reversed(path: str) -> str:
    return "L".join(reversed(path.split("L")))
