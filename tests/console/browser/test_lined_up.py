"""An operator lines up recordings, changes their order, and starts each of them."""

from __future__ import annotations

import re

import pytest

from tests.console.browser.browsing import WAIT, expect, fill, fits, named, told, visit

pytestmark = pytest.mark.timeout(600)


def rows(page):
    return page.locator("#queue li")


def test_recordings_are_lined_up_reordered_and_started_by_a_person(tab, console):
    page = visit(tab, console, "record")
    for number, button in enumerate(("latch", "toggle", "push"), 1):
        fill(page, "P01", button, 1)
        page.get_by_role("button", name="Line up").click()
        expect(rows(page)).to_have_count(number, timeout=WAIT)
    page.get_by_role("button", name="Up: P01 toggle").click()
    expect(rows(page).first).to_contain_text("P01 toggle", timeout=WAIT)
    page.get_by_role("button", name="Drop: P01 push").click()
    expect(rows(page)).to_have_count(2, timeout=WAIT)
    page.reload()
    expect(rows(page)).to_have_count(2, timeout=WAIT)
    expect(page.locator("#queue-said")).to_contain_text("2 recordings, 2 presses, about", timeout=WAIT)
    for width in (390, 1024, 1400):
        fits(page, width)
    page.get_by_role("button", name="Start: P01 toggle").click()
    told(page, "Record toggle by P01: done")
    expect(rows(page)).to_have_count(1, timeout=WAIT)
    expect(rows(page).first).to_contain_text("P01 latch, 1 press")
    page.wait_for_timeout(1000)
    assert (console.data / "recordings" / "P01-toggle.h5").exists()
    assert not (console.data / "recordings" / "P01-latch.h5").exists(), "the next one waits for a person"
    page.get_by_role("button", name="Start: P01 latch").click()
    expect(page.locator("#queue-said")).to_contain_text("Nothing is lined up", timeout=WAIT)
    expect(page.locator("#estimate")).to_contain_text("measured pace of 2 simulated recordings", timeout=WAIT)


def test_sessions_are_lined_up_among_recordings_and_begin_on_their_page(tab, console):
    page = visit(tab, console, "experiment")
    page.get_by_label(re.compile("^Experiment")).select_option("rating")
    for who in ("P01", "P02"):
        named(page, "Participant", who)
        page.get_by_role("button", name="Line up").click()
        expect(rows(page).last).to_contain_text(f"{who} rating, session", timeout=WAIT)
    expect(page.locator("#queue-said")).to_contain_text("2 sessions. Each begins when you start it.")
    for width in (390, 1024, 1400):
        fits(page, width)
    page = visit(tab, console, "record")
    page.get_by_role("button", name="Start: P01 rating").click()
    expect(page.get_by_label(re.compile("^Experiment"))).to_have_value("rating", timeout=WAIT)
    page.get_by_label(re.compile("consent form")).check()
    page.get_by_role("button", name="Begin or continue").click()
    expect(rows(page).first).to_contain_text("runs now", timeout=WAIT)
    page.get_by_role("button", name="End here").click()
    expect(page.get_by_role("button", name="Start: P01 rating")).to_be_enabled(timeout=WAIT)


def test_the_longest_names_fit_on_a_phone(tab, console):
    page = visit(tab, console, "record")
    fill(page, "P09", "W" * 40, 1)
    page.get_by_label("File, without .h5").fill("n" * 60)
    page.get_by_role("button", name="Line up").click()
    expect(rows(page).last).to_contain_text("W" * 40, timeout=WAIT)
    fits(page, 390)
    page.get_by_role("button", name=f"Drop: P09 {'W' * 40}").click()
