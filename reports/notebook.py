"""What a notebook shows of a rig, recording, press, calibration, map, drive, check or button."""

from __future__ import annotations

import base64
from html import escape
from typing import Any

from matplotlib.figure import Figure

from ..base.errors import DataError
from ..instruments import Rig
from .contents import Contents, Grid, contents_of, text_of
from .figures import Columns, mark_simulated, png
from .html import GLANCE_STYLE, glances_html
from .plot import shown

_DPI = 100.0
_STYLES = (
    ".haploop { --ink: currentColor; --soft: #808080; --line: #80808060; --good: #2a8f6c; --bad: #d9622b; "
    "--doubtful: #b08a1e; --recorded: #8c8c8c; --measured: #2f8fd0; --band: #e69f0055; "
    "--activation: #d55e00; "
    ".good { color: var(--good); } .bad { color: var(--bad); } .doubtful { color: var(--doubtful); } "
    f"{GLANCE_STYLE.read_text(encoding='utf-8')} }}"
)
"""Style of a glance in a cell, within it alone, in colours that are seen on light and on dark."""
_STYLE = "text-align:left;vertical-align:top;font-weight:normal"


def html(value: Any) -> str:
    """HTML of a value: its facts and a small picture. Text from files is text, never markup."""
    if isinstance(value, Rig):
        return _rig(value)
    contents = contents_of(value)
    said = f"<div>{escape(contents.origin)}</div>" if contents.simulated else ""
    rows = [(label, text_of(text)) for label, text in contents.rows]
    grids = "".join(_grid(one) for one in contents.tables)
    told, picture = _table(contents.title, rows) + grids, _picture(contents)
    if not contents.glances:
        return told + said + picture
    seen = glances_html([glance() for glance in contents.glances])
    folded = (
        f"<details><summary>{name}</summary>{part}</details>"
        for name, part in (("Figure", picture), ("Numbers", told))
    )
    return f'<style>{_STYLES}</style><div class="haploop">{seen}</div>{said}{"".join(folded)}'


def plot(value: Any, columns: Columns = 2) -> Figure:
    """The figure of a value, as its report has it; one that is simulated says so."""
    if isinstance(value, Rig):
        raise DataError("A rig has no figure: plot what it measured.")
    contents = contents_of(value)
    return shown(contents.draw(columns), bool(contents.simulated))


def _table(title: str, rows: list[tuple[str, str]]) -> str:
    body = "".join(
        f'<tr><th style="{_STYLE}">{escape(name)}</th><td style="{_STYLE}">{escape(text)}</td></tr>'
        for name, text in rows
    )
    return f"<div><b>{escape(title)}</b><table>{body}</table></div>"


def _grid(grid: Grid) -> str:
    cells = [
        [f'<{kind} style="{_STYLE}">{escape(text_of(cell))}</{kind}>' for cell in row]
        for kind, row in [("th", grid.headings), *(("td", row) for row in grid.rows)]
    ]
    body = "".join(f"<tr>{''.join(row)}</tr>" for row in cells)
    return f"<div><b>{escape(grid.title)}</b><table>{body}</table></div>"


def _picture(contents: Contents) -> str:
    try:
        figure = contents.draw(columns=1)
    except DataError as error:
        return f"<div>{escape(str(error))}</div>"
    if contents.simulated:
        mark_simulated(figure)
    data = base64.b64encode(png(figure, _DPI)).decode("ascii")
    return f'<img alt="plot" src="data:image/png;base64,{data}">'


def _rig(rig: Rig) -> str:
    """A rig: its instruments, in the order in which a signal passes them."""
    instruments = [
        (role, str(getattr(one, "identity", "")) or type(one).__name__)
        for role, one in rig.instruments.items()
    ]
    kind = f"simulated by its {rig.mode}" if rig.simulated else "not simulated"
    rows = [("State", f"{'closed' if rig.is_closed else 'open'}, {kind}"), *instruments]
    return _table(f"Rig {rig.name}", rows) + _chain([role for role, _ in instruments], rig.simulated)


def _chain(roles: list[str], simulated: bool) -> str:
    """A small picture of a rig: a box for each instrument, in a row."""
    width, height, gap = 92, 34, 14
    boxes = []
    for number, role in enumerate(roles):
        x = number * (width + gap)
        boxes.append(
            f'<rect x="{x + 1}" y="1" width="{width - 2}" height="{height - 2}" rx="4" fill="none" '
            f'stroke="#0072B2"/><text x="{x + width / 2}" y="{height / 2 + 4}" font-size="12" '
            f'text-anchor="middle" font-family="sans-serif" fill="currentColor">{escape(role)}</text>'
        )
        if number:
            boxes.append(
                f'<line x1="{x - gap}" x2="{x}" y1="{height / 2}" y2="{height / 2}" stroke="#8C8C8C"/>'
            )
    whole = max(1, len(roles) * (width + gap))
    word = (
        f'<text x="0" y="{height + 14}" font-size="11" font-family="sans-serif" fill="currentColor">'
        "simulated</text>"
        if simulated
        else ""
    )
    return (
        f'<svg role="img" aria-label="instruments of the rig" width="{whole}" height="{height + 18}" '
        f'viewBox="0 0 {whole} {height + 18}">{"".join(boxes)}{word}</svg>'
    )
