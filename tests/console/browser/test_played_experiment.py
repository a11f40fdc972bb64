"""A session whose digital buttons the rig plays, on both pages, stopped in between and resumed."""

from __future__ import annotations

from collections import Counter
from typing import Any

import pytest

from tests.console.browser.browsing import WAIT, Tab, expect, told, visit
from tests.console.browser.test_experiments import begin, participants_tab, present, stored
from tests.console.serving import served
from tests.experiments.played import played

pytestmark = pytest.mark.timeout(600)


def prepare(page: Any) -> None:
    """Prepare the rig; the simulated person confirms what no software reads, the laser's settings."""
    page.get_by_role("button", name="Prepare the rig").click()
    expect(page.locator("#ready")).to_have_text("The rig is ready.", timeout=5 * WAIT)


def test_the_rig_plays_the_digital_buttons_and_stop_leaves_the_trial_due(browser, tmp_path, made):
    """Prepared, the finger calibrated, a trial played and answered; STOP; prepared again; the last trial."""
    data = tmp_path / "data"
    played(data / "played", made)
    options = ("--port", "0", "--rig", "experiment", "--virtual-time")
    with served(data, *options, state=tmp_path / "state") as console:
        tab = Tab(browser, console)
        page = visit(tab, console, "experiment")
        shown = participants_tab(browser, page, console)
        begin(page, "played", "P01", consent=False)
        present(page)
        expect(page.locator("#said")).to_contain_text("prepare it first", timeout=WAIT)
        prepare(page)
        present(page)
        expect(shown.locator("#where")).to_have_text("experiment, 1 of 2", timeout=2 * WAIT)
        present(page)
        expect(shown.locator(".choices button")).to_have_count(2, timeout=WAIT)
        shown.keyboard.press("1")
        expect(shown.locator("#where")).to_have_text("experiment, 2 of 2", timeout=WAIT)
        page.keyboard.press("Escape")
        expect(page.locator("#stopped")).to_contain_text("The output is zero", timeout=WAIT)
        expect(page.locator("#ready")).to_have_text("The rig is not prepared.", timeout=WAIT)
        assert shown.locator("#stop").count() == 0
        prepare(page)
        present(page)
        expect(shown.locator(".choices button")).to_have_count(2, timeout=WAIT)
        shown.keyboard.press("2")
        expect(shown.locator("#question")).to_contain_text("complete", timeout=WAIT)
        page.get_by_role("button", name="Leave the rig").click()
        told(page, "Rig for the experiment played: done")
        assert not tab.errors
    found = stored(data, "played")
    kinds = Counter(event.kind for event in found.events)
    assert found.due is None and kinds["activation"] == 2 and kinds["finger"] == 1
