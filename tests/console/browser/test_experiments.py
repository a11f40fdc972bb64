"""An experiment on the operator's page and the participant's, in a real Chromium."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from haploop.experiments import Store, load_experiment
from tests.console.browser.browsing import WAIT, Tab, expect, experiments, named, visit
from tests.console.serving import Served, end, start

pytestmark = pytest.mark.timeout(600)

COMPARED = """
name = "compared"
kind = "two-interval"
seed = 1
consent = false
question = { text = "Which was stronger?" }
comparison = { standard = 1.0, levels = [1.2, 1.6] }
block = [{ name = "experiment" }]
"""
STAIRS = """
name = "stairs"
kind = "staircase"
seed = 1
consent = false
question = { text = "In which interval?" }
comparison = { standard = 0.0, start = 0.5, step = 0.1, highest = 1.0, reversals = 2 }
block = [{ name = "experiment" }]
"""


def participants_tab(browser: Any, page: Any, console: Served) -> Any:
    link = page.get_by_role("link", name="Open the participant's page")
    expect(link).to_have_attribute("href", re.compile("#.{20}"), timeout=WAIT)
    # As large as a table-top's touch surface may be shown; touch events, no mouse.
    shown = browser.new_context(viewport={"width": 1280, "height": 800}, has_touch=True).new_page()
    shown.goto(console.base + link.get_attribute("href"))
    return shown


def begin(page: Any, experiment: str, participant: str, consent: bool = True) -> None:
    page.get_by_label(re.compile("^Experiment")).select_option(experiment)
    named(page, "Participant", participant)
    if consent:
        page.get_by_label("The participant has read and signed the consent form").check()
    page.get_by_role("button", name="Begin or continue").click()
    expect(page.locator("#where")).to_contain_text(participant, timeout=WAIT)


def present(page: Any) -> None:
    expect(page.locator("#next")).to_be_enabled(timeout=WAIT)
    page.locator("h1").click()
    page.keyboard.press("n")


def stored(console_data: Path, experiment: str) -> Any:
    store = Store(load_experiment(console_data / experiment), console_data / experiment / "answers")
    return store.session("P01", 1)


def test_matching_by_touch_and_keyboard_and_a_server_killed_in_between(browser, tmp_path):  # noqa: PLR0915  one session
    data = tmp_path / "data"
    experiments(data)
    console = start(data, "--port", "0", state=tmp_path / "state")
    try:
        tab = Tab(browser, console)
        page = visit(tab, console, "experiment")
        shown = participants_tab(browser, page, console)
        begin(page, "matching", "P01")
        expect(page.locator("#about")).to_contain_text("<script>alert(1)</script>", timeout=WAIT)
        expect(shown.locator("#question")).to_contain_text("<i>Attend</i> to it.", timeout=WAIT)
        for number in (1, 2, 3):
            expect(shown.locator("#where")).to_have_text(f"familiarisation, {number} of 3", timeout=WAIT)
            present(page)
            expect(shown.get_by_role("button", name="Done")).to_be_in_viewport(timeout=WAIT)
            shown.get_by_role("button", name="Done").tap()
        for number in (1, 2, 3):
            expect(shown.locator("#where")).to_have_text(f"training, {number} of 3", timeout=WAIT)
            present(page)
            expect(shown.locator("#question")).to_have_text("<b>Which</b> one?", timeout=WAIT)
            choices = shown.locator(".choices button")
            assert choices.count() == 3 and "P01" not in shown.locator("body").inner_text()
            for place in range(3):
                expect(choices.nth(place)).to_be_in_viewport(ratio=1)
                assert choices.nth(place).bounding_box()["height"] > 150
            choices.nth(0).tap()
            expect(shown.locator("#question")).to_contain_text(
                re.compile("^(Right|No, it was)"), timeout=WAIT
            )
        present(page)
        expect(shown.locator(".choices button")).to_have_count(3, timeout=WAIT)
        shown.keyboard.press("2")
        expect(shown.locator("#where")).to_have_text("experiment, 2 of 3", timeout=WAIT)
        expect(shown.locator("#question")).to_have_text("Please wait.")
        present(page)
        expect(shown.locator(".choices button")).to_have_count(3, timeout=WAIT)
        shown.reload()
        expect(shown.locator(".choices button")).to_have_count(3, timeout=WAIT)
        due = stored(data, "matching").due
        console.process.kill()
        console.process.wait()
        expect(shown.locator("#connection")).to_contain_text("does not answer", timeout=WAIT)
        console.process.stdout.close()
        console = start(data, "--port", "0", state=tmp_path / "state")
        second = Tab(browser, console)
        page = visit(second, console, "experiment")
        shown = participants_tab(browser, page, console)
        begin(page, "matching", "P01", consent=False)
        assert stored(data, "matching").due == due
        for number in (2, 3):
            expect(shown.locator("#where")).to_have_text(f"experiment, {number} of 3", timeout=WAIT)
            present(page)
            expect(shown.locator(".choices button")).to_have_count(3, timeout=WAIT)
            shown.keyboard.press("3")
        expect(shown.locator("#question")).to_contain_text("complete", timeout=WAIT)
        assert not tab.errors + second.errors
    finally:
        end(console)
    found = stored(data, "matching")
    assert found.due is None
    assert [answer for _, answer, _ in found.answers][-3:] == ["toggle", "push", "push"]
    assert [event.kind for event in found.events].count("resumed") == 1


def test_ratings_by_keyboard_with_a_pause_and_a_reload(browser, tab, console):  # noqa: PLR0915  one session
    page = visit(tab, console, "experiment")
    shown = participants_tab(browser, page, console)
    begin(page, "rating", "P01")
    for number in range(1, 7):
        expect(shown.locator("#where")).to_have_text(f"ratings, {number} of 6", timeout=WAIT)
        present(page)
        sliders = shown.locator("#answers input")
        expect(sliders).to_have_count(7, timeout=WAIT)
        assert [float(sliders.nth(n).input_value()) for n in range(7)] == [51] * 7, "they stand in the middle"
        done = shown.get_by_role("button", name="Done")
        expect(done).to_be_disabled()
        expect(shown.locator("#missing")).to_have_text("Set each scale: 7 of 7 are left.")
        assert shown.locator(".untouched[aria-valuetext='not set yet']").count() == 7
        expect(shown.get_by_role("button", name="Done")).to_be_in_viewport(ratio=1)
        if number == 1:
            shown.set_viewport_size({"width": 640, "height": 450})  # as at 200 % on a screen of 1280
            assert shown.evaluate("document.documentElement.scrollWidth <= innerWidth")
            assert not shown.evaluate(
                "(([a, b]) => a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom)"
                "(['where', 'full'].map((one) => document.getElementById(one).getBoundingClientRect()))"
            ), "the button beside the question covers nothing"
            shown.set_viewport_size({"width": 1280, "height": 800})
        sliders.nth(6).focus()
        shown.keyboard.press("End")
        shown.keyboard.press("ArrowLeft")
        expect(shown.locator("#missing")).to_have_text("Set each scale: 6 of 7 are left.")
        sliders.nth(5).focus()
        shown.keyboard.press("Tab")  # passing by touches nothing
        shown.keyboard.press("Enter")  # nor is it an answer
        expect(shown.locator("#missing")).to_have_text("Set each scale: 6 of 7 are left.")
        for place in range(6):
            sliders.nth(place).focus()
            shown.keyboard.press(" ")  # it stays in the middle, because somebody wants it there
        if number == 2:
            page.keyboard.press("p")
            expect(shown.locator("#question")).to_have_text("Pause. Please wait.", timeout=WAIT)
            expect(shown.get_by_role("button", name="Done")).to_be_hidden()
            shown.reload()
            page.reload()
            expect(page.locator("#pause")).to_have_text(re.compile("Go on"), timeout=WAIT)
            page.locator("#pause").click()
            expect(sliders).to_have_count(7, timeout=WAIT)
            assert float(sliders.nth(6).input_value()) == 100, "a reload keeps where they are"
            assert shown.locator(".untouched").count() == 0, "and that they were touched"
        expect(done).to_be_enabled()
        done.focus()
        shown.keyboard.press("Enter")
    expect(shown.locator("#question")).to_contain_text("complete", timeout=WAIT)
    assert shown.locator("a, #stop").count() == 0, "STOP is the operator's"
    expect(page.locator("#entries")).to_contain_text("complete", timeout=WAIT)
    expect(page.locator("#about")).to_contain_text("participants so far: 1)")
    page.get_by_role("button", name="End here").click()
    expect(page.locator("#where")).to_have_text("No session runs.", timeout=WAIT)
    answers = [answer for _, answer, _ in stored(console.data, "rating").answers]
    assert len(answers) == 6
    for answer in answers:
        last = answer.pop("Rough-Smooth")
        assert last.value == 100 and len(last.touched) == 2
        assert all(one.value == 51 and len(one.touched) == 1 for one in answer.values())
        times = [last.touched[0], *(one.touched[0] for one in answer.values())]
        assert times == sorted(times) and times[0] > 0 and times[-1] < 300
    shown.context.close()


def test_ratings_by_touch_and_mouse_count_each_touch(browser, tab, console):
    page = visit(tab, console, "experiment")
    shown = participants_tab(browser, page, console)
    begin(page, "rating", "P02")
    present(page)
    sliders = shown.locator("#answers input")
    expect(sliders).to_have_count(7, timeout=WAIT)
    shown.screenshot(path=console.data / "rating-before.png")
    box = sliders.nth(0).bounding_box()
    middle = box["y"] + box["height"] / 2
    shown.mouse.move(box["x"] + box["width"] / 2, middle)
    shown.mouse.down()  # one touch, however often it moves
    for share in (0.6, 0.7, 0.8):
        shown.mouse.move(box["x"] + box["width"] * share, middle)
    shown.mouse.up()
    shown.mouse.click(box["x"] + box["width"] * 0.9, middle)
    sliders.nth(1).tap()  # in the middle, where it stands
    sliders.nth(2).tap(position={"x": 5, "y": 5})
    expect(shown.locator("#missing")).to_have_text("Set each scale: 4 of 7 are left.")
    # A finger that scrolls the page: its pointer is taken away.
    for name in ("pointerdown", "pointercancel"):
        sliders.nth(3).dispatch_event(name)
    expect(shown.locator("#missing")).to_have_text("Set each scale: 4 of 7 are left.")
    shown.screenshot(path=console.data / "rating-some.png")
    sliders.nth(3).focus()
    shown.keyboard.down("ArrowRight")
    for _ in range(5):
        shown.keyboard.down("ArrowRight")  # repeated by the keyboard
    shown.keyboard.up("ArrowRight")
    for place in (4, 5, 6):
        sliders.nth(place).tap()
    shown.get_by_role("button", name="Done").tap()
    expect(shown.locator("#where")).to_have_text("ratings, 2 of 6", timeout=WAIT)
    page.get_by_role("button", name="End here").click()
    expect(page.locator("#where")).to_have_text("No session runs.", timeout=WAIT)
    store = Store(load_experiment(console.data / "rating"), console.data / "rating" / "answers")
    _, answer, _ = store.session("P02", 1).answers[0]
    found = [(len(one.touched), one.value) for one in answer.values()]
    assert [count for count, _ in found] == [2, 1, 1, 1, 1, 1, 1]
    assert found[0][1] > 80 and found[1][1] == 51 and found[2][1] < 10 and found[3][1] == 57
    shown.context.close()


def test_two_intervals_by_touch_ended_and_continued_at_the_very_trial(browser, tab, console):
    """The operator is told what to present, the participant chooses the first or the second."""
    (console.data / "compared").mkdir()
    (console.data / "compared" / "experiment.toml").write_text(COMPARED, encoding="utf-8")
    page = visit(tab, console, "experiment")
    shown = participants_tab(browser, page, console)
    begin(page, "compared", "P01", consent=False)
    expect(page.locator("#prompt")).to_contain_text(re.compile("Present: .*, then "), timeout=WAIT)
    present(page)
    choices = shown.locator(".choices button")
    expect(choices).to_have_text([re.compile("First"), re.compile("Second")], timeout=WAIT)
    assert "1.2" not in shown.locator("body").inner_text()
    choices.nth(1).tap()
    expect(shown.locator("#where")).to_have_text("experiment, 2 of 2", timeout=WAIT)
    present(page)
    expect(choices).to_have_count(2, timeout=WAIT)
    page.get_by_role("button", name="End here").click()
    expect(choices.first).to_be_hidden(timeout=WAIT)
    begin(page, "compared", "P01", consent=False)
    expect(shown.locator("#where")).to_have_text("experiment, 2 of 2", timeout=WAIT)
    present(page)
    expect(choices).to_have_count(2, timeout=WAIT)
    shown.keyboard.press("1")
    expect(shown.locator("#question")).to_contain_text("complete", timeout=WAIT)
    page.get_by_role("button", name="End here").click()
    assert [answer for _, answer, _ in stored(console.data, "compared").answers] == [2, 1]
    shown.context.close()


def test_a_staircase_by_keyboard_follows_the_answers(browser, tab, console):
    (console.data / "stairs").mkdir()
    (console.data / "stairs" / "experiment.toml").write_text(STAIRS, encoding="utf-8")
    page = visit(tab, console, "experiment")
    shown = participants_tab(browser, page, console)
    begin(page, "stairs", "P01", consent=False)
    for number, right in enumerate((True, True, False, True, True), 1):
        # How many trials there will be is not known, and not shown.
        expect(shown.locator("#where")).to_have_text(f"experiment, {number}", timeout=WAIT)
        first, second = stored(console.data, "stairs").due.values
        present(page)
        expect(shown.locator(".choices button")).to_have_count(2, timeout=WAIT)
        shown.keyboard.press("1" if (first > second) == right else "2")
    expect(shown.locator("#question")).to_contain_text("complete", timeout=WAIT)
    page.get_by_role("button", name="End here").click()
    levels = [max(step.values) for step, _, _ in stored(console.data, "stairs").answers]
    assert levels == pytest.approx([0.5, 0.5, 0.4, 0.45, 0.45])
    shown.context.close()
