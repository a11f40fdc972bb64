"""Who holds the rig, on every page; what is over, and what the pages say before anything was done."""

from __future__ import annotations

import json
import re

import pytest

from tests.console.browser.browsing import PAGES, WAIT, expect, fill, named, told, visit

_NOT_THERE = {"generation": "no-such-one", "reason": "a test"}
pytestmark = pytest.mark.timeout(600)


def test_every_page_says_who_holds_the_rig_and_leads_there(browser, tab, console):
    page = visit(tab, console, "record")
    shown = participants_page(browser, page, console)
    fill(page, "P41", "toggle", 60)
    page.get_by_role("button", name="Record", exact=True).click()
    expect(shown.locator("#prompt")).to_contain_text("Press the toggle", timeout=WAIT)
    page.keyboard.press("p")
    for name in PAGES:
        visit(tab, console, name)
        link = page.get_by_role("link", name="Record toggle by P41: paused")
        expect(link).to_have_attribute("href", "/record", timeout=WAIT)
    visit(tab, console, "experiment")
    # The list of names may be renewed while a new one is about to be written.
    page.get_by_label("Participant", exact=True).select_option("+")
    with page.expect_response(lambda answer: "/api/experiment?" in answer.url):
        page.get_by_label(re.compile("^Experiment")).dispatch_event("change")
    page.wait_for_timeout(300)
    expect(page.get_by_label("New participant")).to_be_visible()
    begin_experiment(page, "P42")
    expect(page.locator("#said")).to_contain_text("busy (Record toggle by P41)", timeout=WAIT)
    expect(shown.locator("#prompt")).to_have_text("Pause. Please wait.")
    page.keyboard.press("Escape")
    told(page, "by P41: stopped")
    begin_experiment(page, "P42")
    expect(shown.locator("#where")).to_have_text("ratings, 1 of 6", timeout=WAIT)
    for name in PAGES:
        visit(tab, console, name)
        link = page.get_by_role("link", name="P42's session of the experiment rating holds the rig")
        expect(link).to_have_attribute("href", "/experiment", timeout=WAIT)
    visit(tab, console, "record")
    fill(page, "P43", "toggle", 2)
    page.get_by_role("button", name="Record", exact=True).click()
    expect(page.locator("#said")).to_contain_text("P42's session", timeout=WAIT)
    visit(tab, console, "experiment")
    page.get_by_role("button", name="End here").click()
    expect(page.locator("#held")).to_have_text("", timeout=WAIT)
    shown.context.close()


def test_the_participants_page_asks_for_nothing_that_it_may_not_have(browser, tab, console):
    page = visit(tab, console, "record")
    refused: list[str] = []
    shown = participants_page(browser, page, console, refused)
    expect(shown.locator("#simulated")).to_be_visible(timeout=WAIT)
    shown.reload()
    expect(shown.locator("#simulated")).to_be_visible(timeout=WAIT)
    assert not refused
    shown.context.close()


def test_numbers_agree_after_stop_and_settings_are_the_next_sessions_own(tab, console):
    """The last blocks of a recording that is stopped may be in its file only."""
    page = tab.page

    def without_the_last(message):
        """The view lags by 200 samples, as when STOP comes between a block's file and its view."""
        told = json.loads(message) if isinstance(message, str) else {}
        if told.get("scope", {}).get("received"):
            told["scope"]["received"] -= 200
            message = json.dumps(told)
        socket[0].send(message)

    socket = []

    def route(one):
        socket[:] = [one]
        one.connect_to_server().on_message(without_the_last)

    page.route_web_socket("**/socket", route)
    visit(tab, console, "record")
    page.get_by_label("Notes").fill("A note of this one.")
    fill(page, "P44", "toggle", 60)
    page.get_by_role("button", name="Record", exact=True).click()
    expect(page.get_by_label("Notes")).to_have_value("", timeout=WAIT)
    expect(page.locator("#count")).to_contain_text("P44", timeout=WAIT)
    expect(page.locator("#last")).to_contain_text("good", timeout=WAIT)
    page.keyboard.press("Escape")
    told(page, "by P44: stopped")
    expect(page.locator("#disk")).to_contain_text("at the end: all that were received", timeout=WAIT)
    counts = [page.locator(one).inner_text().split(" samples")[0] for one in ("#received", "#disk")]
    assert counts[0] == counts[1] and counts[0] != "-"
    expect(page.locator("#missed")).to_contain_text("did not reach this view; the file has them")


def test_banners_of_what_is_over_go_away(tab, console):
    page = tab.page
    page.clock.install()
    visit(tab, console, "record")
    fill(page, "P45", "toggle", 60)
    page.get_by_role("button", name="Record", exact=True).click()
    expect(page.locator("#count")).to_contain_text("P45", timeout=WAIT)
    expect(page.locator("#last")).to_contain_text("good", timeout=WAIT)
    page.keyboard.press("Escape")
    told(page, "by P45: stopped")
    expect(page.locator("#stopped")).to_contain_text("read back", timeout=WAIT)
    page.clock.fast_forward(31_000)
    for banner in ("#job", "#stopped"):
        expect(page.locator(banner)).to_have_text("")
    console.ask("/api/command/start", {"kind": "activate", "parameters": _NOT_THERE})
    told(page, "no-such-one")
    page.clock.fast_forward(31_000)
    told(page, "no-such-one")
    page.reload()
    told(page, "no-such-one")
    page.get_by_role("button", name="Close").click()
    expect(page.locator("#job")).to_have_text("")
    visit(tab, console, "preflight")
    expect(page.locator("#auto-label")).to_be_visible()
    for banner in ("#job", "#stopped", "#said"):
        expect(page.locator(banner)).to_have_text("")


def participants_page(browser, page, console, refused=None):
    link = page.get_by_role("link", name="Open the participant's page")
    expect(link).to_have_attribute("href", re.compile("#.{20}"), timeout=WAIT)
    shown = browser.new_context(viewport={"width": 1000, "height": 700}).new_page()
    if refused is not None:
        shown.on("response", lambda one: refused.append(one.url) if one.status >= 400 else None)
    shown.goto(console.base + link.get_attribute("href"))
    return shown


def begin_experiment(page, participant):
    expect(page.locator("#experiment option")).not_to_have_count(0, timeout=WAIT)
    page.get_by_label(re.compile("^Experiment")).select_option("rating")
    named(page, "Participant", participant)
    page.get_by_label("The participant has read and signed the consent form").check()
    page.get_by_role("button", name="Begin or continue").click()
