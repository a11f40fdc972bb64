"""A digital button of several patches, made, checked and looked at on the console's pages."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

import haploop
from haploop.calibration import Multisine
from tests.console.browser.browsing import WAIT, Tab, expect, fits, told, visit
from tests.console.serving import served

pytestmark = pytest.mark.timeout(600)


def few_modes(folder: Path) -> Path:
    """A rig file of the table with 17 modes: two buttons at once are nowhere right on that of 236."""
    path = folder / "few-modes.toml"
    path.write_text('base = "four-channel"\n[simulation]\nhighest_hz = 844\n', encoding="utf-8")
    return path


def save_what_it_takes(data: Path, rig_name: str | Path = "four-channel") -> None:
    """Recordings of two buttons, a calibration of each patch, and a map, in virtual time."""
    for name in ("calibrations-made", "maps"):
        (data / name).mkdir(parents=True)
    with haploop.open_rig(rig_name, simulate="twin") as rig:
        for button in ("push", "toggle"):
            haploop.record(rig, button, "P01", 2, data / "recordings")
        for patch in "ABCD":
            made = haploop.calibrate(rig, patch, excitation=Multisine())
            made.save(data / "calibrations-made" / f"{patch}-button.h5")
        haploop.measure_map(rig, data / "maps" / "map", haploop.map_plan(rig, points=(0, 13, 57, 75, 83)))


def fill_two_buttons(page: Any) -> None:
    """The push, the toggle at point 57 by the map, silence at 75, as loud as 15 % of error allows."""
    page.get_by_label("Recordings of one button").select_option("recordings/P01-push.h5")
    page.get_by_label("Calibrations").select_option([f"calibrations-made/{p}-button.h5" for p in "ABCD"])
    page.get_by_label("Corrections, at most").fill("0")
    for fold in ("How loud", "Other points at the same time"):
        page.get_by_text(fold, exact=True).click()
    page.get_by_label("Expected error, at most (%)").fill("15")
    page.get_by_label("Drift of the resonances").fill("0.1")
    page.get_by_label("Points to keep silent").fill("75")
    page.get_by_label("Recordings of a second button").select_option("recordings/P01-toggle.h5")
    page.get_by_label("Point of the second button").fill("57")
    page.get_by_label("Map, for points without").select_option("maps/map")


def made(page: Any, name: str) -> None:
    """Have a button made, and do all that the rig asks for meanwhile."""
    page.get_by_label("Name of the file").fill(name)
    page.get_by_role("button", name="Compute, play and check").click()
    done = page.locator("#job").filter(has_text=f"Make a digital button {name}: done")
    for _ in range(30):  # each point is aimed at for what is learnt, and for the check
        expect(done.or_(page.locator("#yes:enabled"))).to_be_visible(timeout=4 * WAIT)
        if done.is_visible():
            return
        page.keyboard.press("n")
        expect(page.locator("#yes")).to_be_disabled(timeout=WAIT)
    expect(done).to_be_visible(timeout=4 * WAIT)


def test_a_button_of_four_patches_is_made_checked_and_shown(browser, tmp_path):
    data = tmp_path / "data"
    save_what_it_takes(data)
    options = ("--port", "0", "--rig", "four-channel")
    with served(data, *options, state=tmp_path / "state") as console:
        tab = Tab(browser, console)
        page = visit(tab, console, "buttons")
        page.set_viewport_size({"width": 1400, "height": 900})
        page.get_by_label("Recordings of one button").select_option("recordings/P01-push.h5")
        calibrations = [f"calibrations-made/{patch}-button.h5" for patch in "ABCD"]
        page.get_by_label("Calibrations").select_option(calibrations)
        page.get_by_text("Other points at the same time", exact=True).click()
        page.get_by_label("Points to keep silent").fill("58")
        page.get_by_label("Corrections, at most").fill("0")
        page.get_by_label("Name of the file").fill("four")
        page.get_by_role("button", name="Compute, play and check").click()
        told(page, "No patch was calibrated at the 58 point")
        page.get_by_label("Points to keep silent").fill("")
        page.get_by_role("button", name="Compute, play and check").click()
        expect(page.locator("#job")).to_contain_text("Make a digital button four: done", timeout=4 * WAIT)
        expect(page.locator("#verdict")).to_have_text("pass", timeout=WAIT)
        said = page.locator("#said-of-it")
        expect(said).to_contain_text("push, patch A + B + C + D at the button point, simulated.")
        expect(page.locator("#drive-plot .legend")).to_have_text(
            "".join(f"drive of patch {patch}" for patch in "ABCD")
        )
        page.get_by_role("button", name="Play again and check").click()
        told(page, "Play buttons/four.h5: done")
        expect(page.get_by_label("Check", exact=True).locator("option")).to_have_count(2, timeout=WAIT)
        page.get_by_label("Check", exact=True).select_option(index=1)
        expect(page.locator("#verdict")).to_have_text("pass", timeout=WAIT)
        for width in (1400, 390):
            fits(page, width)
            page.screenshot(path=tmp_path / f"buttons-{width}.png", full_page=True)
        button = haploop.DigitalButton.load(data / "buttons" / "four.h5")
        assert button.drive.patches == tuple("ABCD") and len(button.calibrations) == 4
        report = haploop.write_report([data / "buttons" / "four.h5"], tmp_path / "report.html").html
        page.goto(report.as_uri())
        wider = "[...document.querySelectorAll('.table')].map((one) => one.scrollWidth - one.clientWidth)"
        assert set(page.evaluate(wider)) == {0}, "a phone shows the verdicts whole"
        assert not tab.errors
        tab.context.close()


@pytest.mark.night
def test_two_buttons_and_a_silent_point_as_loud_as_an_error_allows(browser, tmp_path):
    data, rig = tmp_path / "data", few_modes(tmp_path)
    save_what_it_takes(data, rig)
    with served(data, "--port", "0", "--rig", str(rig), state=tmp_path / "state") as console:
        tab = Tab(browser, console)
        page = visit(tab, console, "buttons")
        fill_two_buttons(page)
        error, there = (
            page.get_by_label("Expected error, at most (%)"),
            page.get_by_label("Point of the second"),
        )
        error.fill("50")
        page.get_by_role("button", name="Compute, play and check").click()
        assert error.evaluate("(one) => one.validationMessage") == "A number from 0.1 to 20."
        error.fill("20")
        there.fill("")
        page.get_by_role("button", name="Compute, play and check").click()
        expect(page.locator("#said")).to_contain_text("Name the one point at which the second", timeout=WAIT)
        there.fill("57")
        made(page, "both")
        button = haploop.DigitalButton.load(data / "buttons" / "both.h5")
        assert button.drive.points == ("button", "57", "75")
        assert 0.1 < button.drive.expected_error <= 0.2 and button.drive.drift.common == 0.001
        rows = page.locator("#each-point tr")
        expect(rows).to_have_count(5, timeout=WAIT)
        expect(rows.nth(0)).to_contain_text(f"push at the button point{button.check.verdict}, error")
        expect(rows.nth(1)).to_contain_text(f"toggle at the 57 point{button.check.others[0].verdict}, error")
        for row in (0, 1):
            expect(rows.nth(row)).to_contain_text(re.compile(r"feels? it .* dB (above|below) threshold"))
        expect(rows.nth(2)).to_contain_text(
            f"Silence at point 75{button.check.silent[0].contrast_db:.0f} dB below the target"
        )
        said = page.locator("#said-of-it")
        expect(said).to_contain_text("push, patch A + B + C + D at the button point")
        page.get_by_label("Button shown, at point").select_option("57")
        expect(said).to_contain_text("toggle, patch A + B + C + D at the 57 point", timeout=WAIT)
        for width in (1400, 390):
            fits(page, width)
            page.screenshot(path=tmp_path / f"both-{width}.png", full_page=True)
        assert not tab.errors
        tab.context.close()
