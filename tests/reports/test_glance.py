"""One glance, and what a page, a console, a notebook and a terminal show of it."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path

import pytest
from rich.console import Console

from haploop.calibration import DigitalButton
from haploop.console.server.shown_routes import glance_json
from haploop.reports import notebook
from haploop.reports.contents import Glance, contents_of, text_of, unbroken
from haploop.reports.html import glances_html
from haploop.reports.show.glance import print_glance


@pytest.fixture(scope="module")
def button(made: Path) -> DigitalButton:
    return DigitalButton.load(made / "latch.h5")


@pytest.fixture(scope="module")
def glance(button: DigitalButton) -> Glance:
    (only,) = contents_of(button).glances
    return only()


def printed(glance: Glance, terminal: bool, width: int = 100, encoding: str = "utf-8") -> str:
    out = io.TextIOWrapper(io.BytesIO(), encoding=encoding, errors="replace")
    print_glance(glance, Console(file=out, force_terminal=terminal, width=width, color_system=None))
    out.seek(0)
    return out.read()


SHOWN: dict[str, Callable[[Glance, DigitalButton], str]] = {
    "page": lambda glance, _: glances_html([glance]),
    "console": lambda glance, _: json.dumps(glance_json(glance), ensure_ascii=False),
    "notebook": lambda _, button: notebook.html(button),
    "terminal": lambda glance, _: printed(glance, terminal=True),
    "pipe": lambda glance, _: printed(glance, terminal=False),
}


@pytest.mark.parametrize("where", SHOWN)
def test_a_glance_says_the_same_everywhere(where: str, glance: Glance, button: DigitalButton) -> None:
    shown = unbroken(SHOWN[where](glance, button))
    for said in (glance.title, text_of(glance.verdict), glance.sentence, *(g.said for g in glance.gauges)):
        assert unbroken(said) in shown
    if where != "pipe":
        assert all(unbroken(end) in shown for end in glance.motion.ends)


@pytest.mark.parametrize("where", ["page", "console", "notebook"])
def test_a_glance_is_drawn_by_the_same_strokes(where: str, glance: Glance, button: DigitalButton) -> None:
    shown = SHOWN[where](glance, button)
    assert [name for name, _ in glance.motion.strokes()] == ["band", "recorded", "measured", "activation"]
    assert all(path in shown for _, path in glance.motion.strokes())


@pytest.mark.parametrize("width", [40, 80, 200])
def test_a_terminal_draws_within_its_width(width: int, glance: Glance) -> None:
    lines = printed(glance, terminal=True, width=width).splitlines()
    figure = [line for line in lines if any(0x2800 < ord(c) < 0x2900 for c in line)]
    assert 4 <= len(figure) <= 6 and max(map(len, lines)) <= width


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_a_terminal_without_braille_gets_words(encoding: str, glance: Glance) -> None:
    told = printed(glance, terminal=True, encoding=encoding)
    assert "how much: " in told and "????" not in told
