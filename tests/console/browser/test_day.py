"""A day's work: preflight, a recording, a calibration, a map and a digital button."""

from __future__ import annotations

import re

import pytest

from tests.console.browser.browsing import WAIT, Tab, expect, fill, press, told, visit, write
from tests.console.serving import served

pytestmark = pytest.mark.timeout(600)


def test_preflight_calibration_map_and_button(browser, tmp_path):  # noqa: PLR0915  one day of work
    """By keyboard alone; in virtual time, because a calibration alone plays for a minute."""
    data = tmp_path / "data"
    with served(data, "--port", "0", "--virtual-time", state=tmp_path / "state") as console:
        tab = Tab(browser, console)
        page = visit(tab, console, "preflight")
        press(page.get_by_role("button", name="Run the preflight"))
        expect(page.locator("#result")).to_contain_text("All green", timeout=WAIT)
        assert page.locator("#findings tr").count() > 15
        page = visit(tab, console, "record")
        fill(page, "P01", "latch", 3)
        press(page.get_by_role("button", name="Record", exact=True))
        told(page, "Record latch by P01: done")
        page = visit(tab, console, "table")
        press(page.get_by_role("button", name="Calibrate"))
        told(page, "Calibrate patch A: done")
        expect(page.locator("#calibration-said")).to_contain_text("the model fits to", timeout=WAIT)
        press(page.get_by_label("The simulated person aims the laser by itself"), "Space")
        write(page.get_by_label(re.compile("^Points, for example")), "0, 3, 40")
        write(page.get_by_label(re.compile("^Patches, for example")), "A")
        press(page.get_by_role("button", name="Measure"))
        expect(page.locator("#prompt")).to_contain_text("PDV-100", timeout=WAIT)
        page.keyboard.press("n")
        for point in ("0", "3"):
            expect(page.locator("#prompt")).to_have_text(f"Aim the laser at point {point}.", timeout=WAIT)
            expect(page.locator(".cell.aim")).to_have_text(point, timeout=WAIT)
            page.reload()
            expect(page.locator("#prompt")).to_have_text(f"Aim the laser at point {point}.", timeout=WAIT)
            page.keyboard.press("n")
        expect(page.locator("#prompt")).to_have_text("Aim the laser at point 40.", timeout=WAIT)
        page.keyboard.press("Escape")
        told(page, "Map map: stopped")
        expect(page.locator("#grid-said")).to_contain_text("2 of 3 points", timeout=WAIT)
        expect(page.get_by_label("The simulated person aims the laser by itself")).to_be_checked()
        write(page.get_by_label(re.compile("^Points, for example")), "0, 3, 40")
        write(page.get_by_label(re.compile("^Patches, for example")), "A")
        press(page.get_by_role("button", name="Measure"))
        told(page, "Map map: done")
        expect(page.locator("#grid-said")).to_contain_text("3 of 3 points", timeout=WAIT)
        page = visit(tab, console, "buttons")
        expect(page.locator("#recordings option")).to_have_count(1, timeout=WAIT)
        press(page.get_by_label("Recordings of one button"), "ArrowDown", "Space")
        write(page.get_by_label("Corrections, at most"), "0")
        press(page.get_by_role("button", name="Compute, play and check"))
        told(page, "Make a digital button latch: done")
        expect(page.locator("#said-of-it")).to_contain_text("of people)", timeout=WAIT)
        assert page.locator("#motion-plot canvas, #drive-plot canvas, #octave-plot canvas").count() == 3
        press(page.get_by_label("The simulated person does what is asked by itself"), "Space")
        press(page.get_by_role("button", name="Play again and check"))
        expect(page.locator("#prompt")).to_contain_text("PDV-100", timeout=WAIT)
        page.keyboard.press("Escape")
        told(page, "Play buttons/latch.h5: stopped")
        page = visit(tab, console, "catalogue")
        expect(page.locator("#count")).to_have_text("5 files", timeout=WAIT)
        press(page.get_by_text("Choose which"))
        write(page.get_by_label("Other, such as"), "patch=A, button=latch")
        page.keyboard.press("Enter")
        expect(page.locator("#count")).to_have_text("1 file", timeout=WAIT)
        expect(page.locator("#files")).to_contain_text("buttons/latch.h5")
        write(page.get_by_label("Other, such as"), "colour=red")
        page.keyboard.press("Enter")
        expect(page.locator("#said")).to_contain_text("'colour=red' is no condition", timeout=WAIT)
        assert not tab.errors and tab.hosts <= {"127.0.0.1", "blob"}
        tab.context.close()
