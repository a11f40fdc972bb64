"""Recordings and studies on the pages, in a real Chromium, on the simulated rig in real time."""

from __future__ import annotations

import re
import time

import pytest

from haploop.acquisition import Recording, load_study
from tests.console.browser.browsing import WAIT, expect, fill, told, visit

pytestmark = pytest.mark.timeout(600)


def test_a_recording_by_keyboard_alone(tab, console):
    """Start, reject and redo, note, pause and go on; a reload and a second tab show the same."""
    page = visit(tab, console, "record")
    lists = [page.get_by_label(label, exact=True) for label in ("Participant", "Button")]
    fields = [page.get_by_label(label) for label in ("New participant", "New button")]
    expect(lists[0].or_(fields[0]).filter(visible=True)).to_have_count(1, timeout=WAIT)
    for at, text in zip(range(2), ("P11", "toggle"), strict=True):
        if lists[at].is_visible():
            lists[at].focus()
            page.keyboard.press("End")  # a new one
        else:
            fields[at].focus()
        page.keyboard.type(text)
        page.keyboard.press("Tab")
    for text in ("8", ""):
        page.keyboard.press("Control+A")
        page.keyboard.type(text)
        page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    prompt = page.locator("#prompt")
    expect(prompt).to_contain_text("Press the toggle button", timeout=WAIT)
    expect(page.locator("#last")).to_contain_text("good", timeout=WAIT)
    page.keyboard.press("r")
    expect(page.locator("#verdicts")).to_contain_text("The operator rejected it.", timeout=WAIT)
    page.keyboard.press("t")
    page.keyboard.type("Somebody came in. r p n")
    page.keyboard.press("Enter")
    expect(page.locator("#note")).to_have_value("", timeout=WAIT)
    page.keyboard.press("p")
    expect(prompt).to_contain_text("Paused", timeout=WAIT)
    before = page.locator("#count").inner_text()
    second = tab.another()
    second.goto(f"{console.base}/record")
    expect(second.locator("#prompt")).to_contain_text("Paused", timeout=WAIT)
    page.reload()
    expect(page.locator("#verdicts")).to_contain_text("The operator rejected it.", timeout=WAIT)
    time.sleep(3)
    assert page.locator("#count").inner_text() == before, "a pause is a pause"
    second.keyboard.press("n")
    told(page, "by P11: done")
    told(second, "by P11: done")
    expect(page.locator("#disk")).to_contain_text("at the end: all that were received", timeout=WAIT)
    expect(page.locator("#missed")).to_have_text("none")
    assert page.locator("#force-plot canvas").count() == 1
    recording = Recording.open(console.data / "recordings" / "P11-toggle.h5")
    assert len(recording.accepted) == 8 and recording.complete
    kinds = {event.kind: event.text for event in recording.events}
    assert kinds["note"] == "Somebody came in. r p n" and {"paused", "resumed"} <= set(kinds)


def test_a_study_of_two_participants(tab, console):
    page = visit(tab, console, "study")
    page.get_by_role("button", name="Record what is due").click()
    for participant in ("P01", "P02"):
        expect(page.locator("#prompt")).to_contain_text(f"Has {participant} read and signed", timeout=WAIT)
        page.keyboard.press("n")
        expect(page.locator("#said")).to_contain_text("y for yes", timeout=WAIT)
        page.keyboard.press("y")
        expect(page.locator("#prompt")).to_contain_text("Ready?", timeout=WAIT)
        page.keyboard.press("n")
        expect(page.locator("#prompt")).to_contain_text("<b>Press</b> 1 of 2", timeout=WAIT)
        if participant == "P01":
            expect(page.locator("#last")).to_contain_text("Press 1: good", timeout=WAIT)
            page.keyboard.press("r")
    told(page, "Study study: done")
    expect(page.locator("#entries")).to_contain_text("2 of 2", timeout=WAIT)
    study = load_study(console.data / "study")
    assert all(entry.complete and entry.consented for entry in study.progress())
    assert sum(entry.rejected for entry in study.progress()) == 1


def test_the_participants_page_has_the_prompt_and_nothing_else(browser, tab, console):
    page = visit(tab, console, "record")
    address = page.get_by_role("link", name="Open the participant's page").get_attribute("href")
    other = browser.new_context(viewport={"width": 1000, "height": 700})
    shown = other.new_page()
    shown.goto(console.base + address)
    expect(shown.locator("#prompt")).to_have_text("Please wait.", timeout=WAIT)
    fill(page, "P13", "push", 3)
    page.get_by_role("button", name="Record", exact=True).click()
    expect(shown.locator("#prompt")).to_contain_text("Press the push button", timeout=WAIT)
    assert "P13" not in shown.locator("body").inner_text()
    heard = shown.locator("body")
    expect(heard).to_have_attribute("data-sounds", "now good now good now good", timeout=WAIT)
    assert shown.locator("a, input, #stop").count() == 0
    told(page, "by P13: done")
    other.close()


def test_the_simulated_finger_presses_with_a_key(tab, console):
    page = visit(tab, console, "record")
    page.get_by_label("The simulated person presses by itself").uncheck()
    expect(page.get_by_role("button", name="Let the simulated finger press")).to_be_visible(timeout=WAIT)
    fill(page, "P14", "toggle", 2)
    page.get_by_role("button", name="Record", exact=True).click()
    for number in (1, 2):
        expect(page.locator("#prompt")).to_contain_text(f"({number} of 2)", timeout=WAIT)
        page.keyboard.press("f")
        expect(page.locator("#last")).to_contain_text(f"Press {number}: good", timeout=WAIT)
    told(page, "by P14: done")
    page.get_by_label("The simulated person presses by itself").check()


def test_the_scope_shows_every_channel_and_a_latched_overload(tab, console):
    page = visit(tab, console, "record")
    fill(page, "P15", "latch", 4)
    page.get_by_role("button", name="Record", exact=True).click()
    expect(page.locator("#scope canvas")).to_have_count(4, timeout=WAIT)
    expect(page.locator("#rate")).to_have_text(re.compile(r"^\d+ updates a second"), timeout=WAIT)
    expect(page.locator("#received")).to_contain_text("at 5000 Hz", timeout=WAIT)
    told(page, "by P15: done")
