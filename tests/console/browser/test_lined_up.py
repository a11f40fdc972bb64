"""An operator lines up recordings, changes their order, and starts each of them."""

from __future__ import annotations

import pytest

from tests.console.browser.browsing import WAIT, expect, fill, fits, told, visit

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
