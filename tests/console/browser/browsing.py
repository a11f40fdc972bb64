"""How the tests of this folder drive a browser: see .github/CONTRIBUTING.md, "Test"."""

from __future__ import annotations

import os
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

from haploop.experiments import load_experiment
from tests.console.serving import Served

playwright = pytest.importorskip(
    "playwright.sync_api", reason="playwright is not installed: python -m pip install -e '.[browser]'"
)
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
if CHROMIUM is None:
    pytest.skip("there is no Chromium: apt-get install chromium", allow_module_level=True)
OPTIONS = ["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"]
OPTIONS += ["--disable-background-networking", "--disable-component-update"]
expect = playwright.expect
WAIT = 60_000
AXE = Path(os.environ.get("HAPLOOP_AXE", Path(__file__).parents[3] / "node_modules/axe-core/axe.min.js"))
PAGES = ("", "preflight", "record", "study", "table", "buttons", "experiment", "catalogue", "design")
STUDY = """
name = "<script>alert(1)</script>"
buttons = ["toggle"]
participants = ["P01", "P02"]
presses = 2
[prompts]
press = "<b>Press</b> {number} of {of}"
"""
MATCHING = """
name = "matching"
title = "<script>alert(1)</script>"
kind = "identification"
seed = 1
factor = [{ name = "button", levels = ["latch", "toggle", "push"] }]
question = { text = "<b>Which</b> one?", identify = "button" }
block = [
    { name = "familiarisation", kind = "presses", text = "<i>Attend</i> to it." },
    { name = "training", practice = true, feedback = true },
    { name = "experiment" },
]
"""


def experiments(data: Path) -> None:
    rating = load_experiment("rating").path.read_text(encoding="utf-8")
    for name, text in (("matching", MATCHING), ("rating", rating)):
        (data / name).mkdir(parents=True)
        (data / name / "experiment.toml").write_text(text, encoding="utf-8")


class Tab:
    """A tab, what went wrong in it, and every host that it asked."""

    def __init__(self, browser: Any, console: Served, **options: Any) -> None:
        self.context = browser.new_context(viewport={"width": 1366, "height": 900}, **options)
        self.errors: list[str] = []
        self.hosts: set[str] = set()
        self.page = self.another()
        self.page.goto(console.url)
        expect(self.page.locator("#rig")).to_have_text(f"Rig {console.rig}", timeout=WAIT)

    def another(self) -> Any:
        page = self.context.new_page()
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("dialog", lambda dialog: self.errors.append(f"dialog {dialog.message}"))
        page.on(
            "request",
            lambda request: self.hosts.add(re.sub(r"^(?:blob:)?\w+://([^/:]+).*", r"\1", request.url)),
        )
        return page


def visit(tab: Tab, console: Served, name: str) -> Any:
    tab.page.goto(f"{console.base}/{name}")
    expect(tab.page.locator("#rig")).to_have_text(f"Rig {console.rig}", timeout=WAIT)
    return tab.page


def named(page: Any, label: str, name: str) -> None:
    """Choose a name from a list; write one that is new."""
    field = page.get_by_label(f"New {label.lower()}")
    listed = page.get_by_label(label, exact=True)
    # Both are there while a new name is being written.
    expect(listed.or_(field).filter(visible=True).first).to_be_visible(timeout=WAIT)
    if listed.is_visible():  # what is known is offered
        known = listed.locator(f'option[value="{name}"]').count()
        listed.select_option(name if known else "+")
        if known:
            return
    field.fill(name)


def fill(page: Any, participant: str, button: str, presses: int) -> None:
    named(page, "Participant", participant)
    named(page, "Button", button)
    page.get_by_label("Presses", exact=True).fill(str(presses))


def fits(page: Any, width: int) -> None:
    """Make the page this wide, and wait until it is no wider: plots are drawn anew after that.

    In steps of our own, as what playwright waits for is evaluated by the page, whose policy forbids it.
    """
    page.set_viewport_size({"width": width, "height": 900})
    for _ in range(WAIT // 100):
        if page.evaluate("document.documentElement.scrollWidth <= innerWidth"):
            return
        page.wait_for_timeout(100)
    pytest.fail(f"a page {width} pixels wide scrolls sideways")


def barriers(page: Any) -> list[Any]:
    """What axe-core finds on a page, of a tab with `bypass_csp`; skips the test where it is not installed."""
    if not AXE.is_file():
        pytest.skip(
            "axe-core is not installed: npm install --no-save axe-core, or HAPLOOP_AXE=.../axe.min.js"
        )
    page.add_script_tag(content=AXE.read_text(encoding="utf-8"))
    tags = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "best-practice"]
    found = page.evaluate("tags => axe.run(document, {runOnly: tags})", tags)
    return [(one["id"], [n["html"][:90] for n in one["nodes"]]) for one in found["violations"]]


def told(page: Any, text: str) -> None:
    expect(page.locator("#job")).to_contain_text(text, timeout=WAIT)


def press(locator: Any, *keys: str) -> None:
    """Focus a control, once it can be used, and press keys in it; Enter when none is named."""
    expect(locator).to_be_enabled(timeout=WAIT)
    locator.focus()
    for key in keys or ("Enter",):
        locator.page.keyboard.press(key)


def write(locator: Any, text: str) -> None:
    """Replace what a field holds, by keyboard."""
    press(locator, "Control+A", "Delete")
    locator.page.keyboard.type(text)
