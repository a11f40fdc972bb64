"""A digital button of several patches, made, checked and looked at on the console's pages."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

import haploop
from haploop.calibration.drive.checked import Silence
from tests.console.browser.browsing import WAIT, Tab, expect, told, visit
from tests.console.serving import served

pytestmark = pytest.mark.timeout(600)


def save_what_it_takes(data: Path) -> None:
    """A recording, and a calibration of each patch, in virtual time."""
    (data / "calibrations-made").mkdir(parents=True)
    with haploop.open_rig("four-channel", simulate="twin") as rig:
        haploop.record(rig, "push", "P01", 3, data / "recordings")
        for patch in "ABCD":
            haploop.calibrate(rig, patch).save(data / "calibrations-made" / f"{patch}-button.h5")


def test_a_button_of_four_patches_is_made_checked_and_shown(browser, tmp_path):
    data = tmp_path / "data"
    save_what_it_takes(data)
    options = ("--port", "0", "--rig", "four-channel")
    with served(data, *options, state=tmp_path / "state") as console:
        tab = Tab(browser, console)
        page = visit(tab, console, "buttons")
        page.set_viewport_size({"width": 1400, "height": 900})
        page.get_by_label("Recordings of one button").select_option("recordings/P01-push.h5")
        made = [f"calibrations-made/{patch}-button.h5" for patch in "ABCD"]
        page.get_by_label("Calibrations").select_option(made)
        page.get_by_label("Points to keep silent").fill("58")
        page.get_by_label("Corrections, at most").fill("0")
        page.get_by_label("Name of the file").fill("four")
        page.get_by_role("button", name="Compute, play and check").click()
        told(page, "No patch was calibrated at the 58 point")
        page.get_by_label("Points to keep silent").fill("")
        page.get_by_role("button", name="Compute, play and check").click()
        expect(page.locator("#prompt")).to_contain_text("PDV-100", timeout=WAIT)
        page.keyboard.press("n")
        expect(page.locator("#job")).to_contain_text("Make a digital button four: done", timeout=4 * WAIT)
        expect(page.locator("#verdict")).to_have_text("pass", timeout=WAIT)
        said = page.locator("#said-of-it")
        expect(said).to_contain_text("push, patch A + B + C + D at the button point, simulated.")
        expect(page.locator("#drive-plot .legend")).to_have_text(
            "".join(f"drive of patch {patch}" for patch in "ABCD")
        )
        page.get_by_role("button", name="Play again and check").click()
        expect(page.locator("#prompt")).to_contain_text("PDV-100", timeout=WAIT)
        page.keyboard.press("n")
        told(page, "Play buttons/four.h5: done")
        expect(page.get_by_label("Check", exact=True).locator("option")).to_have_count(2, timeout=WAIT)
        page.get_by_label("Check", exact=True).select_option(index=1)
        expect(page.locator("#verdict")).to_have_text("pass", timeout=WAIT)
        for width in (1400, 390):
            page.set_viewport_size({"width": width, "height": 900})
            # Plots are drawn anew after the page has another width.
            page.wait_for_function("document.documentElement.scrollWidth <= innerWidth", timeout=WAIT)
            page.screenshot(path=tmp_path / f"buttons-{width}.png", full_page=True)
        button = haploop.DigitalButton.load(data / "buttons" / "four.h5")
        assert button.drive.patches == tuple("ABCD") and len(button.calibrations) == 4
        silent = (Silence("57", button.check.within),)
        quiet = replace(button, check=replace(button.check, silent=silent))
        quiet.save(data / "buttons" / "quiet.h5")
        page.reload()
        page.get_by_label("Digital button").select_option("buttons/quiet.h5")
        expect(said).to_contain_text("Point 57, which is to be silent, moves", timeout=WAIT)
        report = haploop.write_report([data / "buttons" / "four.h5"], tmp_path / "report.html").html
        page.goto(report.as_uri())
        wider = "[...document.querySelectorAll('.table')].map((one) => one.scrollWidth - one.clientWidth)"
        assert set(page.evaluate(wider)) == {0}, "a phone shows the verdicts whole"
        assert not tab.errors
        tab.context.close()
