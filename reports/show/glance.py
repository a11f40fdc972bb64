"""A verdict at a glance in a terminal: the small figure in braille, three gauges, and one sentence."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console
from rich.text import Text

from ..contents import text_of

if TYPE_CHECKING:
    from ...base.arrays import FloatArray
    from ..contents import Gauge, Glance, Motion

_KEY = " grey: recorded press; blue: measured; yellow: activation "
_ROWS, _WIDEST = 6, 72
"""Lines of the figure, and its largest width (characters)."""
_GAUGE = 24
"""Characters of a gauge's scale."""
_DOTS = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
"""Bits of a braille character (rows, columns)."""
_MARKS = {"scale": "─", "range": "░", "interval": "━", "limit": "│", "value": "●"}
_COLOURS = {
    "measured": "blue",
    "recorded": "bright_black",
    "activation": "yellow",
    "limit": "yellow",
    "value": "bold",
    "scale": "bright_black",
    "range": "bright_black",
    "interval": "",
}
_TONES = {"good": "bold green", "bad": "bold red", "doubtful": "bold yellow"}


def print_glance(glance: Glance, console: Console) -> None:
    """Print a glance: drawn where the terminal shows braille, and in words elsewhere."""
    tone = _TONES.get(glance.verdict.tone, "bold")
    head = Text.assemble(glance.title, "  ", (text_of(glance.verdict), tone))
    console.print(head, highlight=False)
    drawn = console.is_terminal and not console.is_dumb_terminal and not console.legacy_windows
    if drawn and console.encoding.lower().startswith("utf"):
        console.print(_figure(glance.motion, min(console.width - 1, _WIDEST)), no_wrap=True, highlight=False)
        widest = max(len(one.label) for one in glance.gauges)
        for one in glance.gauges:
            line = Text.assemble(f"{one.label:<{widest}}  ", _scale(one), f"  {one.said}")
            console.print(line, no_wrap=True, overflow="ellipsis", highlight=False)
    else:
        said = "; ".join(f"{one.label}: {one.said}" for one in glance.gauges)
        console.print(f"{said}.", soft_wrap=True, highlight=False)
    console.print(glance.sentence, soft_wrap=not console.is_terminal, highlight=False)


def _figure(motion: Motion, width: int) -> Text:
    """Recorded press (grey), measured motion (blue) and activation (yellow); the later one is on top."""
    cells = np.zeros((_ROWS, width), dtype=int)
    owner = np.full((_ROWS, width), "", dtype=object)
    time = np.linspace(motion.time[0], motion.time[-1], 2 * width)
    if motion.activation is not None:
        across = int(np.argmin(np.abs(time - motion.activation)))
        for down in range(0, 4 * _ROWS, 2):
            _dot(cells, owner, (down, across), "activation")
    curves = {"recorded": motion.recorded, "measured": motion.measured}
    for name, curve in curves.items():
        if curve is not None:
            _curve(cells, owner, np.interp(time, motion.time, curve) / motion.top, name)
    text = Text()
    for row in range(_ROWS):
        for bits, name in zip(cells[row], owner[row], strict=True):
            text.append(chr(0x2800 + bits), _COLOURS.get(name, ""))
        text.append("\n")
    first, last = motion.ends
    room = width - len(first) - len(last)
    text.append(f"{first}{_KEY[:room]:^{room}}{last}", "bright_black")
    return text


def _curve(cells: np.ndarray, owner: np.ndarray, values: FloatArray, name: str) -> None:
    """Draw a curve (dots across) of values from -1 to 1, joined from dot to dot."""
    down = np.round((4 * _ROWS - 1) * (0.5 - 0.5 * np.clip(values, -1, 1))).astype(int)
    for across, (here, before) in enumerate(zip(down, [down[0], *down[:-1]], strict=True)):
        step = 1 if here >= before else -1
        for level in range(before + step if here != before else here, here + step, step):
            _dot(cells, owner, (level, across), name)


def _dot(cells: np.ndarray, owner: np.ndarray, at: tuple[int, int], name: str) -> None:
    (row, line), (column, side) = divmod(at[0], 4), divmod(at[1], 2)
    cells[row, column] |= _DOTS[line][side]
    owner[row, column] = name


def _scale(gauge: Gauge) -> Text:
    """A gauge's scale with its marks, each on top of those before it."""
    line = [("scale", _MARKS["scale"])] * _GAUGE
    for name, x, _, width, _ in gauge.marks()[1:]:
        middle = x + width / 2 if name in ("limit", "value") else x
        first = min(_GAUGE - 1, int(middle / 100 * _GAUGE))
        count = 1 if name in ("limit", "value") else max(1, round(width / 100 * _GAUGE))
        line[first : first + count] = [(name, _MARKS[name])] * len(line[first : first + count])
    return Text.assemble(*((mark, _COLOURS[name]) for name, mark in line))
