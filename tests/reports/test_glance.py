"""One glance, and what a page, a console, a notebook and a terminal show of it."""

import io
import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from haploop.calibration import DigitalButton, check_feeling
from haploop.calibration.drive import SharedPower
from haploop.console.server.shown_routes import glance_json
from haploop.reports import notebook
from haploop.reports.contents import Glance, check_glance, contents_of, text_of, unbroken
from haploop.reports.html import glances_html
from haploop.reports.show.terminal import print_glance


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
def test_a_glance_says_the_same_everywhere(where, glance, button):
    shown = unbroken(SHOWN[where](glance, button))
    for said in (glance.title, text_of(glance.verdict), glance.sentence, *(g.said for g in glance.gauges)):
        assert unbroken(said) in shown
    if where != "pipe":
        assert all(unbroken(end) in shown for end in glance.motion.ends)


def test_no_error_of_zero_is_shown_as_measured(button):
    whole = replace(button.check.whole, value=-1e-6)
    check = replace(button.check, whole=whole)
    like = check_glance(check, check_feeling(check, button.press), button.press).gauges[1]
    assert like.said == f"error at most {100 * whole.interval[1]:.1f} %" and not like.known
    assert {name for name, *_ in like.marks()} == {"scale", "interval", "limit"}
    contents = contents_of(replace(button, check=check))
    told = " ".join([str(check), repr(check), *(verdict.measured for verdict in contents.verdicts)])
    assert told.count("at most") == 3 and not re.search(r"\b0\.0+ ?%", told)


@pytest.mark.parametrize(
    ("verdict", "value", "says"),
    [
        ("fail", 0.09, "Does not repeat the press: the motion is off by more than 20 %."),
        ("fail", 0.01, "Does not pass: the reason, which is not the error, stands with the verdict."),
        ("fail", float("nan"), "Does not pass: the reason, which is not the error, stands with the verdict."),
        ("not shown", 0.04, "These plays cannot tell whether the motion is within 20 % of the press."),
        ("not shown", 0.01, "These plays do not show that it passes: the reason, which is not the error,"),
        ("not shown", float("nan"),
         "These plays cannot tell whether the motion is within 20 % of the press."),
    ],
)  # fmt: skip
def test_a_glance_gives_no_reason_that_is_not_so(button, verdict, value, says):
    whole = SharedPower(value, 0.0005, 1e-4, 8)
    check = replace(button.check, whole=whole, verdict=verdict)
    said = check_glance(check, check_feeling(check, button.press), button.press).sentence
    assert said.startswith(says) and len(said.split()) <= 20


@pytest.mark.parametrize("where", ["page", "console", "notebook"])
def test_a_glance_is_drawn_by_the_same_strokes(where, glance, button):
    shown = SHOWN[where](glance, button)
    assert [name for name, _ in glance.motion.strokes()] == ["band", "recorded", "measured", "activation"]
    assert all(path in shown for _, path in glance.motion.strokes())


@pytest.mark.parametrize("width", [40, 80, 200])
def test_a_terminal_draws_within_its_width(width, glance):
    lines = printed(glance, terminal=True, width=width).splitlines()
    figure = [line for line in lines if any(0x2800 < ord(c) < 0x2900 for c in line)]
    assert 4 <= len(figure) <= 6 and max(map(len, lines)) <= width


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_a_terminal_without_braille_gets_words(encoding, glance):
    told = printed(glance, terminal=True, encoding=encoding)
    assert "how much: " in told and "????" not in told
