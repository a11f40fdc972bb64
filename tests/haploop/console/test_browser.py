"""The pages in a real Chromium, on the simulated rig in real time: docs/console.md, "Tests in a browser"."""

from __future__ import annotations

import os
import re
import shutil
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from haploop.acquisition import Recording, load_study
from haploop.experiments import Store, load_experiment
from tests.haploop.console.serving import Served, end, served, start

playwright = pytest.importorskip(
    "playwright.sync_api", reason="playwright is not installed: python -m pip install -e '.[browser]'"
)
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
ROOT = Path(__file__).parents[3]
AXE = Path(os.environ.get("HAPLOOP_AXE", ROOT / "node_modules" / "axe-core" / "axe.min.js"))
pytestmark = [
    pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium: apt-get install chromium"),
    pytest.mark.timeout(600),
]
expect = playwright.expect
WAIT = 60_000
PAGES = ("", "preflight", "record", "study", "table", "buttons", "experiment")
STUDY = """
name = "<script>alert(1)</script>"
buttons = ["toggle"]
participants = ["P01", "P02"]
presses = 2
[prompts]
press = "<b>Press</b> {number} of {of}"
"""
MATCHING = """
name = "matching"
title = "<script>alert(1)</script>"
kind = "identification"
seed = 1
[[factor]]
name = "button"
levels = ["latch", "toggle", "push"]
[question]
text = "<b>Which</b> one?"
identify = "button"
[[block]]
name = "familiarisation"
kind = "presses"
text = "<i>Attend</i> to it."
[[block]]
name = "training"
practice = true
feedback = true
[[block]]
name = "experiment"
"""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as program:
        found = program.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield found
        found.close()


@pytest.fixture(scope="module")
def console(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    folder = tmp_path_factory.mktemp("console")
    (folder / "data" / "study").mkdir(parents=True)
    (folder / "data" / "study" / "study.toml").write_text(STUDY, encoding="utf-8")
    experiments(folder / "data")
    with served(folder / "data", "--port", "0", state=folder / "state") as found:
        found.ask("/api/command/override", {"reason": "a test"})
        yield found


def experiments(data: Path) -> None:
    rating = load_experiment("rating").path.read_text(encoding="utf-8")
    for name, text in (("matching", MATCHING), ("rating", rating)):
        (data / name).mkdir(parents=True)
        (data / name / "experiment.toml").write_text(text, encoding="utf-8")


class Tab:
    """A tab, what went wrong in it, and every host that it asked."""

    def __init__(self, browser: Any, console: Served, **options: Any) -> None:
        self.context = browser.new_context(viewport={"width": 1366, "height": 900}, **options)
        self.errors: list[str] = []
        self.hosts: set[str] = set()
        self.page = self.another()
        self.page.goto(console.url)
        expect(self.page.locator("#rig")).to_contain_text("Rig simulated", timeout=WAIT)

    def another(self) -> Any:
        page = self.context.new_page()
        page.on("pageerror", lambda error: self.errors.append(str(error)))
        page.on("dialog", lambda dialog: self.errors.append(f"dialog {dialog.message}"))
        page.on("request", lambda request: self.hosts.add(re.sub(r"^\w+://([^/:]+).*", r"\1", request.url)))
        return page


@pytest.fixture
def tab(browser: Any, console: Served) -> Iterator[Tab]:
    found = Tab(browser, console)
    yield found
    found.context.close()
    assert not found.errors
    assert found.hosts <= {"127.0.0.1", "blob"}, "no request leaves the machine"


def visit(tab: Tab, console: Served, name: str) -> Any:
    tab.page.goto(f"{console.base}/{name}")
    expect(tab.page.locator("#rig")).to_contain_text("Rig simulated", timeout=WAIT)
    return tab.page


def fill(page: Any, participant: str, button: str, presses: int) -> None:
    page.get_by_label("Participant (a pseudonym such as P01)").fill(participant)
    page.get_by_label("Button", exact=True).fill(button)
    page.get_by_label("Presses", exact=True).fill(str(presses))


def told(page: Any, text: str) -> None:
    expect(page.locator("#job")).to_contain_text(text, timeout=WAIT)


def test_a_recording_by_keyboard_alone(tab, console):
    """Start, reject and redo, note, pause and go on; a reload and a second tab show the same."""
    page = visit(tab, console, "record")
    page.get_by_label("Participant (a pseudonym such as P01)").focus()
    for text in ("P11", "toggle", "8", ""):
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
    told(page, "done")
    told(second, "done")
    expect(page.locator("#disk")).to_contain_text("CRC-checked", timeout=WAIT)
    expect(page.locator("#missed")).to_have_text("none")
    assert page.locator("#force-plot canvas").count() == 1
    recording = Recording.open(console.data / "recordings" / "P11-toggle.h5")
    assert len(recording.accepted) == 8 and recording.complete
    kinds = {event.kind: event.text for event in recording.events}
    assert kinds["note"] == "Somebody came in. r p n" and {"paused", "resumed"} <= set(kinds)


def test_stop_reaches_the_safe_state_while_the_server_hangs(tab, console):
    if os.name == "nt":
        pytest.skip("no SIGSTOP")
    page = visit(tab, console, "record")
    fill(page, "P12", "toggle", 60)
    page.get_by_role("button", name="Record", exact=True).click()
    expect(page.locator("#count")).to_contain_text("P12", timeout=WAIT)
    expect(page.locator("#last")).to_contain_text("good", timeout=WAIT)
    console.process.send_signal(signal.SIGSTOP)
    try:
        page.keyboard.press("Escape")
        expect(page.locator("#stopped")).to_contain_text("the relay is open, read back", timeout=10_000)
    finally:
        console.process.send_signal(signal.SIGCONT)
    told(page, "stopped")
    assert Recording.open(console.data / "recordings" / "P12-toggle.h5").state == "interrupted"


def test_a_server_that_is_killed_is_missed_and_stop_works_all_the_same(browser, tmp_path):
    console = start(tmp_path / "data", "--port", "0", state=tmp_path / "state")
    again = None
    try:
        console.ask("/api/command/override", {"reason": "a test"})
        tab = Tab(browser, console)
        page = visit(tab, console, "record")
        fill(page, "P01", "toggle", 60)
        page.get_by_role("button", name="Record", exact=True).click()
        expect(page.locator("#last")).to_contain_text("good", timeout=WAIT)
        console.process.kill()
        console.process.wait()
        expect(page.locator("#connection")).to_contain_text("STOP works", timeout=WAIT)
        again = start(tmp_path / "data", "--port", console.base.rpartition(":")[2], state=tmp_path / "state")
        second = tab.another()
        second.goto(again.url)
        second.goto(f"{again.base}/record")
        # The old tab hears of the new token from the one that was opened with it.
        for one in (second, page):
            expect(one.locator("#prompt")).to_contain_text("Press the toggle button", timeout=WAIT)
        again.process.kill()
        again.process.wait()
        expect(page.locator("#connection")).to_contain_text("STOP works", timeout=WAIT)
        page.get_by_role("button", name="STOP").click()
        expect(page.locator("#stopped")).to_contain_text("the relay is open, read back", timeout=10_000)
        recording = Recording.open(tmp_path / "data" / "recordings" / "P01-toggle.h5")
        assert recording.state == "interrupted" and len(recording.accepted) > 1
        assert recording.blocks["first"][-1] + recording.blocks["count"][-1] == recording.volts.shape[1]
        tab.context.close()
    finally:
        for one in filter(None, (console, again)):
            one.process.stdout.close()
        end_worker = start(tmp_path / "data", "--port", "0", state=tmp_path / "state")
        end(end_worker)


def test_a_study_of_two_participants(tab, console):
    page = visit(tab, console, "study")
    page.get_by_role("button", name="Record what is due").click()
    for participant in ("P01", "P02"):
        expect(page.locator("#prompt")).to_contain_text(f"Has {participant} read and signed", timeout=WAIT)
        page.keyboard.press("n")
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
    expect(shown.locator("body")).to_have_attribute("data-sound", re.compile("now|good"), timeout=WAIT)
    assert shown.locator("a, input, #stop").count() == 0
    told(page, "done")
    other.close()


def participants_tab(browser: Any, page: Any, console: Served) -> Any:
    link = page.get_by_role("link", name="Open the participant's page")
    expect(link).to_have_attribute("href", re.compile("#.{20}"), timeout=WAIT)
    # As large as a table-top's touch surface may be shown; touch events, no mouse.
    shown = browser.new_context(viewport={"width": 1280, "height": 800}, has_touch=True).new_page()
    shown.goto(console.base + link.get_attribute("href"))
    return shown


def begin(page: Any, experiment: str, participant: str, consent: bool = True) -> None:
    page.get_by_label(re.compile("^Experiment")).select_option(experiment)
    page.get_by_label("Participant (a pseudonym such as P01)").fill(participant)
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
        assert console.process.stdout is not None
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


def test_ratings_by_keyboard_with_a_pause_and_a_reload(browser, tab, console):
    page = visit(tab, console, "experiment")
    shown = participants_tab(browser, page, console)
    begin(page, "rating", "P01")
    for number in range(1, 7):
        expect(shown.locator("#where")).to_have_text(f"ratings, {number} of 6", timeout=WAIT)
        present(page)
        sliders = shown.locator("#answers input")
        expect(sliders).to_have_count(7, timeout=WAIT)
        assert [float(sliders.nth(n).input_value()) for n in range(7)] == [51] * 7, "they start in the middle"
        expect(shown.get_by_role("button", name="Done")).to_be_in_viewport(ratio=1)
        sliders.nth(6).focus()
        shown.keyboard.press("End")
        shown.keyboard.press("ArrowLeft")
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
        shown.get_by_role("button", name="Done").focus()
        shown.keyboard.press("Enter")
    expect(shown.locator("#question")).to_contain_text("complete", timeout=WAIT)
    assert shown.locator("a, #stop").count() == 0, "STOP is the operator's"
    expect(page.locator("#entries")).to_contain_text("complete", timeout=WAIT)
    page.get_by_role("button", name="End here").click()
    expect(page.locator("#where")).to_have_text("No session runs.", timeout=WAIT)
    answers = [answer for _, answer, _ in stored(console.data, "rating").answers]
    assert answers == [{**dict.fromkeys(answers[0], 51), "Rough-Smooth": 100}] * 6
    shown.context.close()


COMPARED = """
name = "compared"
kind = "two-interval"
seed = 1
consent = false
[question]
text = "Which was stronger?"
[comparison]
standard = 1.0
levels = [1.2, 1.6]
[[block]]
name = "experiment"
"""
STAIRS = """
name = "stairs"
kind = "staircase"
seed = 1
consent = false
[question]
text = "In which interval?"
[comparison]
standard = 0.0
start = 0.5
step = 0.1
highest = 1.0
reversals = 2
[[block]]
name = "experiment"
"""


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
    told(page, "done")
    page.get_by_label("The simulated person presses by itself").check()


def test_the_scope_shows_every_channel_and_a_latched_overload(tab, console):
    page = visit(tab, console, "record")
    fill(page, "P15", "latch", 4)
    page.get_by_role("button", name="Record", exact=True).click()
    expect(page.locator("#scope canvas")).to_have_count(4, timeout=WAIT)
    expect(page.locator("#rate")).to_have_text(re.compile(r"^\d+ updates a second"), timeout=WAIT)
    expect(page.locator("#received")).to_contain_text("at 5000 Hz", timeout=WAIT)
    told(page, "done")


@pytest.mark.parametrize("name", [*PAGES, "participant"])
def test_no_barrier_that_axe_finds(browser, console, name):
    if not AXE.is_file():
        pytest.skip(
            "axe-core is not installed: npm install --no-save axe-core, or HAPLOOP_AXE=.../axe.min.js"
        )
    tab = Tab(browser, console, bypass_csp=True)
    page = visit(tab, console, name) if name != "participant" else tab.page
    if name == "participant":
        page.goto(f"{console.base}/participant")
    page.add_script_tag(content=AXE.read_text(encoding="utf-8"))
    tags = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "best-practice"]
    found = page.evaluate("tags => axe.run(document, {runOnly: tags})", tags)
    assert [(one["id"], [n["html"][:90] for n in one["nodes"]]) for one in found["violations"]] == []
    tab.context.close()


@pytest.mark.parametrize("name", PAGES)
def test_everything_fits_at_200_percent(browser, console, name):
    """A window of 1280 pixels at 200 % is 640 pixels wide to the page."""
    context = browser.new_context(
        viewport={"width": 640, "height": 450}, device_scale_factor=2, bypass_csp=True
    )
    page = context.new_page()
    page.goto(console.url)
    page.goto(f"{console.base}/{name}")
    expect(page.locator("#rig")).to_contain_text("Rig simulated", timeout=WAIT)
    assert page.evaluate("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
    expect(page.get_by_role("button", name="STOP")).to_be_in_viewport()
    context.close()


def test_preflight_calibration_map_and_button(browser, tmp_path):  # noqa: PLR0915  one day of work
    """In virtual time, because a calibration alone plays for a minute; STOP in the middle of the map."""
    data = tmp_path / "data"
    with served(data, "--port", "0", "--virtual-time", state=tmp_path / "state") as console:
        tab = Tab(browser, console)
        page = visit(tab, console, "preflight")
        page.get_by_role("button", name="Run the preflight").click()
        expect(page.locator("#prompt")).to_contain_text("PDV-100", timeout=WAIT)
        page.keyboard.press("n")
        expect(page.locator("#result")).to_contain_text("All green", timeout=WAIT)
        assert page.locator("#findings tr").count() > 15
        page = visit(tab, console, "record")
        fill(page, "P01", "latch", 3)
        page.get_by_role("button", name="Record", exact=True).click()
        told(page, "done")
        page = visit(tab, console, "table")
        page.get_by_role("button", name="Calibrate").click()
        expect(page.locator("#prompt")).to_contain_text("PDV-100", timeout=WAIT)
        page.keyboard.press("n")
        told(page, "done")
        expect(page.locator("#calibration-said")).to_contain_text("the model fits to", timeout=WAIT)
        page.get_by_label("The simulated person aims the laser by itself").uncheck()
        page.get_by_label(re.compile("^Points, for example")).fill("0, 3, 40")
        page.get_by_label(re.compile("^Patches, for example")).fill("A")
        page.get_by_role("button", name="Measure").click()
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
        told(page, "stopped")
        expect(page.locator("#grid-said")).to_contain_text("2 of 3 points", timeout=WAIT)
        page.get_by_label("The simulated person aims the laser by itself").check()
        page.get_by_label(re.compile("^Points, for example")).fill("0, 3, 40")
        page.get_by_label(re.compile("^Patches, for example")).fill("A")
        page.get_by_role("button", name="Measure").click()
        expect(page.locator("#prompt")).to_contain_text("PDV-100", timeout=WAIT)
        page.keyboard.press("n")
        told(page, "done")
        expect(page.locator("#grid-said")).to_contain_text("3 of 3 points", timeout=WAIT)
        page = visit(tab, console, "buttons")
        page.get_by_label("Recordings of one button").select_option("recordings/P01-latch.h5")
        page.get_by_label("Corrections, at most").fill("0")
        page.get_by_role("button", name="Compute, play and check").click()
        expect(page.locator("#prompt")).to_contain_text("PDV-100", timeout=WAIT)
        page.keyboard.press("n")
        told(page, "done")
        expect(page.locator("#said-of-it")).to_contain_text("above the detection threshold", timeout=WAIT)
        assert page.locator("#motion-plot canvas, #drive-plot canvas, #octave-plot canvas").count() == 3
        page.get_by_role("button", name="Play again and check").click()
        expect(page.locator("#prompt")).to_contain_text("PDV-100", timeout=WAIT)
        page.keyboard.press("Escape")
        told(page, "stopped")
        assert not tab.errors and tab.hosts <= {"127.0.0.1", "blob"}
        tab.context.close()
