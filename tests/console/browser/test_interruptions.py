"""STOP, reloads, two tabs and a server that dies, in the middle of each job."""

from __future__ import annotations

import os
import re
import signal
from typing import Any

import pytest

import haploop
from haploop.acquisition import Recording
from tests.console.browser.browsing import STUDY, WAIT, Tab, expect, fill, told, visit
from tests.console.serving import Served, end, start

pytestmark = pytest.mark.timeout(600)


@pytest.fixture(scope="module")
def button(console: Served) -> None:
    """A recording, a calibration, a digital button and a long study in the console's data folder."""
    with haploop.open_rig("simulated") as rig:
        recording = haploop.record(rig, "latch", "P01", 3, console.data / "recordings")
        calibration = haploop.calibrate(rig, patch="A", point="button")
        made = haploop.build_button(rig, haploop.representative([recording]), calibration, iterations=0)
    # So many presses that a slow machine is still in the middle of them when STOP comes.
    study = console.data / "study" / "study.toml"
    study.write_text(STUDY.replace("presses = 2", "presses = 60"), encoding="utf-8")
    for folder, one in (("calibrations-made", calibration), ("buttons", made)):
        (console.data / folder).mkdir()
        one.save(console.data / folder / "latch.h5")


def a_preflight(page: Any) -> None:
    page.get_by_role("button", name="Run the preflight").click()


def a_recording(page: Any) -> None:
    fill(page, "P21", "toggle", 60)
    page.get_by_role("button", name="Record", exact=True).click()


def a_study(page: Any) -> None:
    page.get_by_role("button", name="Record what is due").click()
    for asked in ("read and signed", "Ready?"):
        expect(page.locator("#prompt")).to_contain_text(asked, timeout=WAIT)
        page.keyboard.press("y")


def a_calibration(page: Any) -> None:
    page.get_by_role("button", name="Calibrate").click()


def a_map(page: Any) -> None:
    page.get_by_label(re.compile("^Points, for example")).fill("0-40")
    page.get_by_role("button", name="Measure").click()


def a_button(page: Any) -> None:
    page.get_by_label("Recordings of one button").select_option("recordings/P01-latch.h5")
    page.get_by_label("Name of the file").fill("another")
    page.get_by_role("button", name="Compute, play and check").click()


def a_check(page: Any) -> None:
    expect(page.get_by_label("Digital button")).to_have_value("buttons/latch.h5", timeout=WAIT)
    page.get_by_role("button", name="Play again and check").click()


JOBS = {
    "Preflight": ("preflight", a_preflight), "Record toggle": ("record", a_recording),
    "Study study": ("study", a_study), "Calibrate patch A": ("table", a_calibration),
    "Map map": ("table", a_map), "Make a digital button": ("buttons", a_button),
    "Play buttons/latch.h5": ("buttons", a_check),
}  # fmt: skip


@pytest.mark.usefixtures("button")
@pytest.mark.parametrize("job", JOBS)
def test_a_reload_a_second_tab_and_stop_in_the_middle_of(job, tab, console):
    name, begin = JOBS[job]
    page = visit(tab, console, name)
    begin(page)
    pressing = name in ("record", "study")
    middle = "#last" if pressing else "#doing"
    done = re.compile("good" if pressing else r"[1-9]\d*(\.\d)? of|0\.[1-9] of")
    if name == "preflight":  # its parts are named; from the patches on, something is played
        done = re.compile("Patch|Wiring|Safe state")
    expect(page.locator(middle)).to_have_text(done, timeout=WAIT)
    second = tab.another()
    second.goto(f"{console.base}/{name}")
    page.reload()
    for one in (page, second):
        expect(one.locator("#job")).to_have_text(re.compile(f"^{job}.*: running$"), timeout=WAIT)
        expect(one.locator(middle)).to_have_text(done, timeout=WAIT)
    second.keyboard.press("Escape")
    expect(second.locator("#stopped")).to_contain_text("the relay is open, read back", timeout=WAIT)
    for one in (page, second):
        expect(one.locator("#job")).to_have_text(re.compile(f"^{job}.*: stopped$"), timeout=WAIT)
    # The rig can be used again at once, and what was measured was kept.
    if name == "record":
        kept = Recording.open(console.data / "recordings" / "P21-toggle.h5")
        assert kept.state == "interrupted" and kept.accepted
    if name == "study":
        study = haploop.load_study(console.data / "study")
        assert [entry.interrupted for entry in study.progress()] == [1, 0]
    if name == "preflight":
        expect(page.locator("#result")).not_to_contain_text("green")
    page.get_by_role("button", name="STOP").click()
    expect(page.locator("#stopped")).to_contain_text("the relay is open, read back", timeout=WAIT)


def test_stop_reaches_the_safe_state_while_the_server_hangs(tab, console):
    if os.name == "nt":
        pytest.skip("no SIGSTOP")
    page = visit(tab, console, "record")
    fill(page, "P12", "toggle", 60)
    page.get_by_role("button", name="Record", exact=True).click()
    expect(page.locator("#count")).to_contain_text("P12", timeout=WAIT)
    expect(page.locator("#last")).to_contain_text("good", timeout=WAIT)
    console.process.send_signal(signal.SIGSTOP)
    try:
        page.keyboard.press("Escape")
        expect(page.locator("#stopped")).to_contain_text("the relay is open, read back", timeout=10_000)
    finally:
        console.process.send_signal(signal.SIGCONT)
    told(page, "by P12: stopped")
    assert Recording.open(console.data / "recordings" / "P12-toggle.h5").state == "interrupted"


def test_a_server_that_is_killed_is_missed_and_stop_works_all_the_same(browser, tmp_path):
    console = start(tmp_path / "data", "--port", "0", state=tmp_path / "state")
    again = None
    try:
        console.ask("/api/command/override", {"reason": "a test"})
        tab = Tab(browser, console)
        page = visit(tab, console, "record")
        fill(page, "P01", "toggle", 60)
        page.get_by_role("button", name="Record", exact=True).click()
        expect(page.locator("#last")).to_contain_text("good", timeout=WAIT)
        console.process.kill()
        console.process.wait()
        expect(page.locator("#connection")).to_contain_text("STOP works", timeout=WAIT)
        again = start(tmp_path / "data", "--port", console.base.rpartition(":")[2], state=tmp_path / "state")
        second = tab.another()
        second.goto(again.url)
        second.goto(f"{again.base}/record")
        # The old tab hears of the new token from the one that was opened with it.
        for one in (second, page):
            expect(one.locator("#prompt")).to_contain_text("Press the toggle button", timeout=WAIT)
        again.process.kill()
        again.process.wait()
        expect(page.locator("#connection")).to_contain_text("STOP works", timeout=WAIT)
        page.get_by_role("button", name="STOP").click()
        expect(page.locator("#stopped")).to_contain_text("the relay is open, read back", timeout=10_000)
        recording = Recording.open(tmp_path / "data" / "recordings" / "P01-toggle.h5")
        assert recording.state == "interrupted" and len(recording.accepted) > 1
        assert recording.blocks["first"][-1] + recording.blocks["count"][-1] == recording.volts.shape[1]
        tab.context.close()
    finally:
        for one in filter(None, (console, again)):
            one.process.stdout.close()
        end_worker = start(tmp_path / "data", "--port", "0", state=tmp_path / "state")
        end(end_worker)
