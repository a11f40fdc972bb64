"""A report opens for a person at a screen, and for nobody else."""

import sys
import webbrowser
from pathlib import Path

import pytest

from haploop.commands import files
from haploop.terminal.browser import open_page


@pytest.mark.parametrize(
    ("terminal", "environment", "opened"),
    [
        (True, {"DISPLAY": ":0"}, True),
        (True, {"WAYLAND_DISPLAY": "wayland-0"}, True),
        (True, {}, False),
        (True, {"DISPLAY": ":0", "CI": "true"}, False),
        (False, {"DISPLAY": ":0"}, False),
    ],
)
def test_a_page_opens_where_somebody_watches(monkeypatch, terminal, environment, opened):
    pages: list[str] = []
    monkeypatch.setattr(webbrowser, "open", lambda page: pages.append(page) or True)
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(sys.stdout, "isatty", lambda: terminal, raising=False)
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "CI"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert open_page(Path("report.html")) is opened
    assert pages == [Path("report.html").resolve().as_uri()] * opened


@pytest.mark.long
def test_report_opens_its_page_unless_told_not_to(demo, run, tmp_path, monkeypatch):
    pages: list[Path] = []
    monkeypatch.setattr(files, "open_page", pages.append)
    press = demo.folder / "presses" / "latch.h5"
    for name, options in (("a", []), ("b", ["--no-open"]), ("c", ["--json"])):
        run("report", press, "--out", tmp_path / f"{name}.html", *options, ends=0)
    assert pages == [tmp_path / "a.html"]
