"""An empty data folder, and a phone: what the pages say first, and that STOP covers nothing."""

from __future__ import annotations

import re
from contextlib import suppress

import pytest

import haploop
from tests.console.browser.browsing import PAGES, STUDY, WAIT, Tab, expect, fill, told, visit
from tests.console.serving import served

pytestmark = pytest.mark.timeout(600)

FIRST = {
    "": (
        "first run the preflight, then record a button",
        "none yet: first make a study",
        "none yet: first make an experiment",
    ),
    "study": ("There is no study in the data folder yet: first make one",),
    "experiment": ("There is no experiment in the data folder yet: first make one",),
    "table": ("There is no calibration yet: first aim", "There is no map yet: first choose Measure"),
    "buttons": ("There is no recording yet: first record", "no digital button yet: first make one"),
    "catalogue": ("Nothing is in the data folder yet. First record a button",),
}


def refused(page, button, sentence):
    """A button is refused by a sentence: on a busy machine the worker takes its time, and is asked again."""
    for _ in range(5):
        page.get_by_role("button", name=button, exact=True).click()
        with suppress(AssertionError):
            return expect(page.locator("#said")).to_contain_text(sentence, timeout=WAIT / 3)
    return expect(page.locator("#said")).to_contain_text(sentence)


def test_empty_lists_say_what_to_do_first_in_a_normal_size(browser, tmp_path):
    with served(tmp_path / "data", "--port", "0", state=tmp_path / "state") as console:
        tab = Tab(browser, console)
        for name, sentences in FIRST.items():
            page = visit(tab, console, name)
            for sentence in sentences:
                said = page.locator("main p:visible, main dd").filter(has_text=re.compile(sentence))
                expect(said).to_be_visible(timeout=WAIT)
                expect(said).to_have_css("font-size", "16px")
        page = visit(tab, console, "buttons")
        refused(page, "Compute, play and check", "Choose at least one recording")
        assert not tab.errors
        tab.context.close()


@pytest.mark.parametrize("width", [390, 900])
def test_stop_covers_nothing_where_the_window_is_small(width, tab, console):
    """What scrolls goes below a strip of its own; what has the focus is beside it."""
    for name in PAGES:
        page = visit(tab, console, name)
        page.set_viewport_size({"width": width, "height": 700})
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), name
        page.evaluate("scrollTo(0, 300)")
        beside = page.evaluate(
            """() => {
              const stop = document.getElementById("stop").getBoundingClientRect();
              const at = (x) => document.elementFromPoint(x, (stop.top + stop.bottom) / 2);
              return [2, innerWidth / 2, innerWidth - 2].map((x) => Boolean(at(x).closest("header")));
            }"""
        )
        assert beside == [True] * 3, name
        covered = page.evaluate(
            """() => [...document.querySelectorAll("main input, main button, main select, main a")]
              .filter((one) => one.getClientRects().length && !one.disabled)
              .filter((one) => {
                one.focus();
                const box = one.getBoundingClientRect();
                const strip = document.getElementById("stop").parentElement.getBoundingClientRect();
                return box.top < strip.bottom && box.bottom > strip.top;
              }).map((one) => one.id || one.textContent)"""
        )
        assert covered == [], name


def test_files_shows_experiments_too(tab, console):
    page = visit(tab, console, "catalogue")
    page.get_by_text("Choose which").click()
    page.get_by_label("Kind").select_option("experiment")
    page.get_by_role("button", name="List").click()
    # Of the answer to this question: the files of any kind, which the page lists first, hold it too.
    expect(page.locator("#count")).to_have_text("2 files", timeout=2 * WAIT)
    expect(page.locator("#files tr")).to_have_count(2)
    expect(page.locator("#files")).to_contain_text("rating/experiment.toml")
    page.get_by_label("Other, such as patch=A").fill("patches=A")
    page.get_by_role("button", name="List").click()
    expect(page.locator("#said")).to_contain_text("'patches=A' is no condition", timeout=WAIT)
    expect(page.locator("#files tr")).to_have_count(0)


def test_a_participant_who_is_recorded_again_gets_a_name_for_the_file(tab, console):
    page = visit(tab, console, "record")
    name = page.get_by_label("File, without .h5")
    for _ in range(2):
        fill(page, "P51", "toggle", 1)
        page.get_by_role("button", name="Record", exact=True).click()
        told(page, "by P51: done")
        expect(name).to_have_value(re.compile("P51-toggle-[23]"), timeout=WAIT)
    expect(name).to_have_value("P51-toggle-3", timeout=WAIT)
    expect(page.locator("#again")).to_contain_text("P51-toggle.h5 was recorded already")
    name.fill("P51-toggle")
    refused(page, "Record", "P51-toggle.h5 already exists")
    found = sorted(path.name for path in (console.data / "recordings").glob("*.h5"))
    assert found == ["P51-toggle-2.h5", "P51-toggle.h5"]


def test_participant_and_button_are_chosen_and_a_new_one_is_asked_for(browser, tmp_path):
    """Nothing is known in an empty folder; then what a study names, and what was recorded."""
    data = tmp_path / "data"
    with served(data, "--port", "0", state=tmp_path / "state") as console:
        tab = Tab(browser, console)
        page = visit(tab, console, "record")
        expect(page.get_by_label("New participant")).to_be_visible(timeout=WAIT)
        expect(page.get_by_label("Participant", exact=True)).to_be_hidden()
        with haploop.open_rig("simulated") as rig:
            haploop.record(rig, "soft-push", "P52", 1, data / "recordings")
        (data / "study").mkdir()
        (data / "study" / "study.toml").write_text(STUDY)
        page = visit(tab, console, "record")
        offered = page.get_by_label("Participant", exact=True).locator("option:not([hidden])")
        expect(offered).to_have_text(["P01", "P02", "P52", "A new participant ..."], timeout=WAIT)
        offered = page.get_by_label("Button", exact=True).locator("option:not([hidden])")
        expect(offered).to_have_text(["toggle", "soft-push", "A new button ..."])
        expect(page.get_by_label("New participant")).to_be_hidden()
        page.get_by_role("button", name="Record", exact=True).click()
        listed = page.get_by_label("Participant", exact=True)
        assert listed.evaluate("(one) => one.validationMessage") == "Fill this in first."
        listed.select_option("P52")
        page.get_by_label("Button", exact=True).select_option("soft-push")
        expect(page.get_by_label("File, without .h5")).to_have_value("P52-soft-push-2")
        listed.select_option(label="A new participant ...")
        expect(page.get_by_label("New participant")).to_be_focused()
        assert not tab.errors
        tab.context.close()


def test_what_a_name_may_contain_is_said_by_us(tab, console):
    page = visit(tab, console, "record")
    fill(page, "P59", "unheard-of", 1)
    for label, wrong, sentence in (
        ("New participant (a pseudonym such as P01)", "Anna Smith", "one to four letters, then one to four"),
        ("New participant (a pseudonym such as P01)", "", "Fill this in first."),
        ("New button (a name such as doorbell)", "my button", "up to 40 letters, digits, _ and -"),
        ("File, without .h5", "a/b", "up to 60 letters"),
        ("Presses", "900", "A number from 1 to 200, a whole one."),
    ):
        field = page.get_by_label(label, exact=True)
        right = field.input_value()
        field.fill(wrong)
        page.get_by_role("button", name="Record", exact=True).click()
        assert sentence in field.evaluate("(one) => one.validationMessage")
        field.fill(right)
        assert field.evaluate("(one) => one.validationMessage") == ""


def test_sensors_are_looked_at_before_anything_is_recorded(browser, tmp_path):
    with served(tmp_path / "data", "--port", "0", state=tmp_path / "state") as console:
        tab = Tab(browser, console)
        page = visit(tab, console, "record")
        page.get_by_role("button", name="Look at the sensors").click()
        expect(page.locator("#prompt")).to_have_text(
            "Looking at the sensors: nothing is recorded.", timeout=WAIT
        )
        scope = page.locator("#scope")
        for plot in ("acceleration z (m/s²) over time (s)", "velocity (mm/s) over time (s)"):
            expect(scope.get_by_role("img", name=plot)).to_be_visible(timeout=WAIT)
        plotted, room = (
            page.evaluate(f"document.querySelector('{at}').offsetWidth") for at in (".uplot", "#scope")
        )
        assert plotted > 0.98 * room
        page.get_by_label("Take the mean off").check()
        page.get_by_role("button", name="Let the simulated finger press").click()
        page.get_by_role("button", name="Look no more").click()
        expect(page.locator("#prompt")).to_have_text("Nothing is being recorded.", timeout=WAIT)
        assert console.ask("/api/files")["recordings"] == []
        assert not tab.errors
        tab.context.close()
