"""Make the pictures of docs/pictures again, and figures of docs/figures, from the simulated rig.

    python -m tests.console.browser.pictures [FOLDER]

A lab's data are made first, in virtual time, or taken from FOLDER/data if an earlier run has left them there.
Then a console in real time is shown to Chromium, page by page, in the middle of what each is for. Pictures
are 1280 pixels wide, in few colours; `console-widths.png` has every page at three widths, smaller. Needs the
extra `browser`, and takes some minutes.
"""

from __future__ import annotations

import re
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from io import BytesIO
from pathlib import Path
from typing import Any

from PIL import Image

import haploop
from tests.console.browser.browsing import CHROMIUM, OPTIONS, PAGES, WAIT, expect, fill, named, playwright
from tests.console.browser.drawing import PICTURES, figures, paper, report, save
from tests.console.browser.test_several_patches import few_modes, fill_two_buttons, made, save_what_it_takes
from tests.console.serving import Served, served

_WIDTHS = (1400, 1024, 390)
_SMALL = 0.36
"""Scale of a page on the sheet of all pages."""
_MEASURED = 47
"""Points of the map that are measured before its picture: it is seen filling in."""
_NIGHTS = (0.0, 0.0004, 0.0009, 0.0013)
"""Drift of the table at each verification, as a part of its resonances."""
_HIDE = """([folder, place]) => {
  const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (texts.nextNode()) texts.currentNode.data = texts.currentNode.data.replaceAll(folder, place);
}"""
"""Writes another folder where a page names the one in which the pictures are made."""
_STUDY = """
name = "two buttons"
buttons = ["push", "toggle"]
participants = ["P01", "P02", "P03"]
presses = 12
order = "as-listed"
"""
_MATCHING = """
name = "matching"
title = "Which button was it?"
kind = "identification"
seed = 1
consent = false
factor = [{ name = "button", levels = ["latch", "toggle", "push"] }]
question = { text = "Which physical button was it?", identify = "button" }
block = [{ name = "experiment" }]
"""


def make_data(data: Path) -> None:
    """Recordings, a calibration, two digital buttons, half a map and a history, in virtual time."""
    with haploop.open_rig("simulated") as rig:
        for button in ("latch", "toggle"):
            for participant in ("P01", "P02"):
                haploop.record(rig, button, participant, 5, data / "recordings")
        calibration = haploop.calibrate(rig, patch="A", point="button")
        _save(calibration, data / "calibrations-made" / "A-button.h5")
        buttons = []
        for button in ("latch", "toggle"):
            recordings = [
                haploop.Recording.open(path) for path in sorted(data.glob(f"recordings/*-{button}.h5"))
            ]
            buttons.append(haploop.build_button(rig, haploop.representative(recordings), calibration))
            _save(buttons[-1], data / "buttons" / f"{button}.h5")
        (data / "maps").mkdir()
        measured = data / "maps" / "map"
        with suppress(KeyboardInterrupt):
            haploop.measure_map(rig, measured, haploop.map_plan(rig), _until(measured, _MEASURED))
    _drift(data, buttons)
    _forms(data)


def _drift(data: Path, buttons: list[haploop.DigitalButton]) -> None:
    """A history of a table that drifts."""
    history = haploop.History(data / "simulated-calibrations")
    begun = datetime.now(UTC) - timedelta(days=len(_NIGHTS))
    haploop.calibration.adopt(history, buttons, actor="the console", reason="first of this table", when=begun)
    for night, drift in enumerate(_NIGHTS):
        drifted = data.parent / "drifted.toml"
        drifted.write_text(f'base = "simulated"\n[simulation]\nmode_drift = {drift}\n', encoding="utf-8")
        with haploop.open_rig(haploop.load_rig_file(drifted)) as rig:
            when = begun + timedelta(days=night + 0.5)
            haploop.recalibrate(rig, history, when=when)


def _forms(data: Path) -> None:
    """Two experiments and a study, of which nothing is recorded yet."""
    rating = haploop.experiments.load_experiment("rating").path.read_text(encoding="utf-8")
    for name, text in (("matching", _MATCHING), ("rating", rating)):
        (data / name).mkdir()
        (data / name / "experiment.toml").write_text(text, encoding="utf-8")
    (data / "study").mkdir()
    (data / "study" / "study.toml").write_text(_STUDY, encoding="utf-8")


def _save(one: Any, path: Path) -> None:
    path.parent.mkdir(exist_ok=True)
    one.save(path)


def _until(folder: Path, points: int) -> Callable[[str, float, float, str], None]:
    """What interrupts a map, as Ctrl-C does, after some points."""

    def progress(_doing: str, _done: float, _of: float, _unit: str, /) -> None:
        if len([*folder.glob("point-*.h5")]) >= points:
            raise KeyboardInterrupt

    return progress


class Album:
    """Pages of a console, and pictures of them."""

    def __init__(self, browser: Any, console: Served) -> None:
        self.browser, self.console = browser, console
        self.page = browser.new_context(viewport={"width": 1280, "height": 800}).new_page()
        self.page.goto(console.url)

    def visit(self, name: str) -> Any:
        self.page.goto(f"{self.console.base}/{name}")
        expect(self.page.locator("#rig")).to_have_text(f"Rig {self.console.rig}", timeout=WAIT)
        return self.page

    def participant(self) -> Any:
        """The participant's page, beside the operator's."""
        link = self.page.get_by_role("link", name="Open the participant's page")
        expect(link).to_have_attribute("href", re.compile("#.{20}"), timeout=WAIT)
        shown = self.browser.new_context(viewport={"width": 1280, "height": 800}).new_page()
        shown.goto(self.console.base + link.get_attribute("href"))
        return shown

    def take(self, name: str, page: Any = None, part: str = "") -> None:
        """Save a picture of a whole page, or of the part with a heading, in few colours."""
        page = page or self.page
        page.evaluate("scrollTo(0, 0)")
        page.wait_for_timeout(700)  # plots are drawn at the next frames
        self.hide(page)
        seen = page.locator("section").filter(has=page.get_by_role("heading", name=part)) if part else page
        taken = seen.screenshot() if part else seen.screenshot(full_page=True)
        shot = Image.open(BytesIO(taken)).convert("RGB")
        path = PICTURES / f"console-{name}.png"
        save(shot, path)

    def hide(self, page: Any) -> None:
        """Name another folder than the one in which the pictures are made."""
        page.evaluate(_HIDE, [str(self.console.data.parent), "/home/lab"])
        assert tempfile.gettempdir() not in page.inner_text("body"), "a picture shows where it was made"

    def stop(self) -> None:
        self.page.keyboard.press("Escape")
        expect(self.page.locator("#stopped")).to_contain_text("the relay is open, read back", timeout=WAIT)


def idle_pages(album: Album) -> None:
    """Pages that show what there is: nothing runs."""
    page = album.visit("")
    expect(page.locator("#newest")).to_contain_text("latch", timeout=WAIT)
    album.take("start")
    page = album.visit("buttons")
    page.locator("#octave-plot canvas").wait_for(timeout=WAIT)
    page.get_by_label("Recordings of one button").select_option(
        [f"recordings/{participant}-latch.h5" for participant in ("P01", "P02")]
    )
    album.take("buttons")
    page = album.visit("catalogue")
    page.locator("#files tr").first.wait_for(timeout=WAIT)
    album.take("files")


def preflight(album: Album) -> None:
    page = album.visit("preflight")
    page.get_by_role("button", name="Run the preflight").click()
    expect(page.locator("#result")).to_contain_text(re.compile("green|yellow"), timeout=3 * WAIT)
    if "All green" not in page.locator("#result").inner_text():
        page.get_by_label("Record all the same").fill("the simulated table needs no new verification")
        page.get_by_role("button", name="Override").click()
        expect(page.locator("#overridden")).to_contain_text("simulated", timeout=WAIT)
    album.take("preflight")


def sittings(album: Album) -> None:
    """A recording and a study with a rejected press, and the participant's page in a press."""
    page = album.visit("record")
    shown = album.participant()
    fill(page, "P03", "latch", 20)
    page.get_by_role("button", name="Record", exact=True).click()
    expect(page.locator("#last")).to_contain_text(re.compile("Press [2-9]: good"), timeout=WAIT)
    page.keyboard.press("r")
    expect(shown.locator("#prompt")).to_contain_text("Press the latch", timeout=WAIT)
    expect(shown.locator("#countdown")).to_contain_text("s", timeout=WAIT)
    album.take("participant", shown)
    expect(page.locator("#last")).to_contain_text(re.compile(r"Press ([4-9]|1\d): good"), timeout=WAIT)
    expect(page.locator("#disk")).to_contain_text("CRC", timeout=WAIT)
    album.take("record")
    album.stop()
    page = album.visit("study")
    page.get_by_role("button", name="Record what is due").click()
    for asked in ("read and signed", "Ready?"):
        expect(page.locator("#prompt")).to_contain_text(asked, timeout=WAIT)
        page.keyboard.press("y")
    expect(page.locator("#last")).to_contain_text(re.compile(r"Press ([3-9]|1\d): good"), timeout=WAIT)
    album.take("study")
    album.stop()
    shown.context.close()


def table(album: Album) -> None:
    """In the middle of a map, with a calibration, its history, and a shape of vibration."""
    page = album.visit("table")
    expect(page.locator("#grid-said")).to_contain_text("points measured", timeout=WAIT)
    page.get_by_role("button", name="Fit and animate").click()
    expect(page.locator("#frequency option").first).to_be_attached(timeout=5 * WAIT)
    page.get_by_role("button", name="Stand still").click()
    page.get_by_role("button", name="Measure").click()
    expect(page.locator("#coherence")).to_contain_text("median coherence", timeout=2 * WAIT)
    expect(page.locator(".cell.aim")).to_have_count(1, timeout=WAIT)
    expect(page.locator("#coherence")).to_contain_text("median coherence", timeout=WAIT)
    album.take("table")
    album.stop()


def experiments(album: Album) -> None:
    """The operator's page in the middle of a session, and both kinds of answers."""
    for name, answer, wanted in (("matching", "choices", "matching"), ("rating", "rating", "rating")):
        page = album.visit("experiment")
        page.get_by_label(re.compile("^Experiment")).select_option(name)
        shown = album.participant()
        named(page, "Participant", "P01")
        if page.get_by_label("The participant has read").is_visible():
            page.get_by_label("The participant has read").check()
        page.get_by_role("button", name="Begin or continue").click()
        expect(page.locator("#next")).to_be_enabled(timeout=WAIT)
        page.locator("#next").click()
        expect(shown.locator(".choices, .rate").first).to_be_visible(timeout=WAIT)
        if answer == "rating":
            shown.locator("#answers input").nth(1).fill("80")
        album.take(wanted, shown)
        if answer == "choices":
            shown.keyboard.press("2")
            expect(page.locator("#last")).to_contain_text("Last answer", timeout=WAIT)
            page.locator("#next").click()
            album.take("experiment")
        page.get_by_role("button", name="End here").click()
        expect(page.locator("#where")).to_have_text("No session runs.", timeout=WAIT)
        shown.context.close()


def two_buttons(album: Album) -> None:
    """Two buttons of four patches at once, and a point that is kept silent."""
    page = album.visit("buttons")
    if not (album.console.data / "buttons" / "both.h5").exists():
        fill_two_buttons(page)
        made(page, "both")
    expect(page.locator("#each-point tr")).to_have_count(5, timeout=WAIT)
    page.locator("#octave-plot canvas").wait_for(timeout=WAIT)
    album.take("two-buttons", part="Look at one")


def widths(album: Album) -> None:
    """The first screen of each page on a desk, a tablet and a phone, on one sheet."""
    files = ("buttons/latch.h5", "recordings/P01-latch.h5")
    pages = [*(name for name in PAGES if name != "catalogue"), "catalogue"]
    pages += [f"file?file={one}" for one in files]
    rows = []
    for name in pages:
        page, row = album.visit(name), []
        for width in _WIDTHS:
            page.set_viewport_size({"width": width, "height": 900})
            page.wait_for_timeout(3000)  # lists and plots have come
            album.hide(page)
            shot = Image.open(BytesIO(page.screenshot())).convert("RGB")
            row.append(
                shot.resize(
                    (round(shot.width * _SMALL), round(shot.height * _SMALL)), Image.Resampling.LANCZOS
                )
            )
        rows.append(row)
    _sheet(rows, PICTURES / "console-widths.png")


def _sheet(rows: list[list[Image.Image]], path: Path) -> None:
    """Pictures side by side and one below the other, in few colours."""
    gap, high = 12, [max(one.height for one in row) for row in rows]
    width = max(sum(one.width + gap for one in row) for row in rows) + gap
    sheet = Image.new("RGB", (width, sum(high) + gap * (len(rows) + 1)), "#808890")
    top = gap
    for row, height in zip(rows, high, strict=True):
        left = gap
        for one in row:
            sheet.paste(one, (left, top))
            left += one.width + gap
        top += height + gap
    save(sheet, path, 64)


PARTS = (idle_pages, widths, preflight, sittings, table, experiments)


def main() -> None:
    """Make the data, serve them, and take the pictures."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(sys.argv[1] if len(sys.argv) > 1 else name).resolve()
        data = folder / "data"
        if not data.is_dir():
            data.mkdir(parents=True)
            make_data(data)
        several, few = folder / "several", few_modes(folder)
        if not several.is_dir():
            save_what_it_takes(several, few)
        figures(data)
        with playwright.sync_playwright() as program:
            browser = program.chromium.launch(executable_path=CHROMIUM, args=OPTIONS)
            paper(browser, data, Path(tempfile.mkdtemp(dir=folder)))
            report(browser, Path(tempfile.mkdtemp(dir=folder)))
            for lab, rig, parts in ((data, "simulated", PARTS), (several, str(few), (two_buttons,))):
                with served(lab, "--port", "0", "--rig", rig, state=folder / "state") as console:
                    for part in parts:
                        if len(sys.argv) < 3 or part.__name__ in sys.argv[2:]:
                            part(Album(browser, console))
            browser.close()


if __name__ == "__main__":
    main()
