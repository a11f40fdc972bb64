"""From Files to a result: its page, its figure as numbers, an experiment's scores, and the nights."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner

from haploop import open_rig, record, representative, write_report
from haploop.calibration import DigitalButton, History, adopt
from haploop.commands.cli import cli
from tests.console.browser.browsing import WAIT, Tab, barriers, expect, fits, press, visit
from tests.console.serving import Served, served

pytestmark = pytest.mark.timeout(600)
WIDTHS = (390, 1024, 1400)
NIGHT = {
    "when": "2026-11-20T02:15:00+00:00", "outcome": "broken", "compared_with": "0001", "active": "0001",
    "places": [], "buttons": {}, "sentences": ["The laser does not see the surface."],
}  # fmt: skip


@pytest.fixture(scope="module")
def console(made: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A lab with a digital button, an answered experiment, and a history with a broken night."""
    folder = tmp_path_factory.mktemp("files")
    data = folder / "data"
    (data / "buttons").mkdir(parents=True)
    shutil.copy(made / "latch.h5", data / "buttons")
    with open_rig("simulated") as rig:
        recording = record(rig, "latch", "P01", 2, data / "recordings")
    representative([recording]).save(data / "press.h5")
    for words in (["new", "--from", "matching"], ["simulate", "--participants", "2"]):
        done = CliRunner().invoke(cli, ["experiment", words[0], str(data / "matching"), *words[1:]])
        assert done.exit_code == 0, done.output
    history = History.of_rig("simulated", data)
    adopt(history, [DigitalButton.load(made / "latch.h5")], actor="a test", reason="it begins")
    history.note(NIGHT)
    report = history.report(NIGHT["when"], "broken")
    report.parent.mkdir()
    report.write_text("<title>a night</title>", encoding="utf-8")
    with served(data, "--port", "0", state=folder / "state") as found:
        yield found


def saved(page, name: str) -> str:
    """The first line of what a button saves."""
    with page.expect_download(timeout=WAIT) as download:
        page.get_by_role("button", name=name, exact=True).first.click()
    return Path(download.value.path()).read_text("utf-8").splitlines()[0]


def test_a_row_of_files_opens_its_verdict_and_its_numbers(tab, console):
    page = visit(tab, console, "catalogue")
    page.get_by_role("link", name="buttons/latch.h5").click(timeout=WAIT)
    expect(page.locator(".glance h2 .good")).to_have_text("pass", timeout=WAIT)
    expect(page.locator(".glance .motion .measured")).to_have_count(1)
    expect(page.locator("details[open] img")).to_be_visible(timeout=WAIT)
    assert saved(page, "Data (CSV)").startswith("panel,curve,x axis,y axis,x,y")
    for width in WIDTHS:
        fits(page, width)


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize(
    "name", ["buttons/latch.h5", "recordings/P01-latch.h5", "press.h5", "matching", "history"]
)
def test_no_barrier_that_axe_finds_on_a_files_page(browser, console, name, scheme):
    tab = Tab(browser, console, bypass_csp=True, color_scheme=scheme)
    asked = "history=1" if name == "history" else f"file={name}"
    page = visit(tab, console, f"file?{asked}")
    expect(page.locator("#shown section").first).to_be_visible(timeout=WAIT)
    page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
    assert barriers(page) == []
    tab.context.close()


def test_what_a_file_was_made_from_is_a_picture_of_links(tab, console):
    page = visit(tab, console, "file?file=recordings/P01-latch.h5")
    picture = page.get_by_role("group", name="What this file was made from")
    for width in WIDTHS:
        fits(page, width)
        expect(picture.get_by_role("img", name="recording P01-latch.h5, this file")).to_be_visible(
            timeout=WAIT
        )
    press(picture.get_by_role("link", name="representative press press.h5, made from P01-latch.h5"))
    expect(page.locator("#name")).to_contain_text("press.h5", timeout=WAIT)
    (console.data / "recordings" / "P01-latch.h5").rename(console.data / "recordings" / "first.h5")
    try:
        page.reload()
        expect(page.locator("#graph")).to_contain_text("first.h5: called P01-latch.h5", timeout=WAIT)
    finally:
        (console.data / "recordings" / "first.h5").rename(console.data / "recordings" / "P01-latch.h5")


@pytest.mark.parametrize("name", ["matching", "rating", "staircase", "two-interval", "study"])
def test_what_nobody_has_answered_says_what_it_is(tab, console, name):
    folder, kind = console.data / f"unanswered-{name}", "study" if name == "study" else "experiment"
    new = ["study", "new"] if name == "study" else ["experiment", "new", "--from", name]
    if not folder.exists():
        done = CliRunner().invoke(cli, [*new, str(folder)])
        assert done.exit_code == 0, done.output
    page = visit(tab, console, "catalogue")
    page.get_by_role("link", name=f"unanswered-{name}/{kind}.toml").click(timeout=WAIT)
    expect(page.locator("#shown table").first).to_be_visible(timeout=WAIT)
    if kind == "experiment":
        expect(page.locator("#shown")).to_contain_text("Nobody has answered yet.")
        expect(page.locator("#shown table").first).to_contain_text("Steps of a participant")
    for width in WIDTHS:
        fits(page, width)
    page.get_by_role("link", name="Run a session").click()
    expect(page.locator(f"#{kind}")).to_have_value(folder.name, timeout=WAIT)


def test_a_press_is_laid_over_that_of_another_file(tab, console):
    page = visit(tab, console, "file?file=recordings/P01-latch.h5")
    page.get_by_label("Lay a press of another file over it").select_option("press.h5", timeout=WAIT)
    expect(page.locator("#traces canvas")).to_have_count(2, timeout=WAIT)
    expect(page.locator("#which")).to_contain_text("press.h5: the representative press")
    for width in WIDTHS:
        fits(page, width)
    page.get_by_label("Lay a press of another file over it").select_option("none")
    expect(page.locator("#traces canvas")).to_have_count(0)


def test_a_psychologist_reads_the_scores_and_saves_the_answers(tab, console):
    page = visit(tab, console, "experiment")
    expect(page.locator("#prompt")).to_have_text("")
    page.get_by_text("Results", exact=True).click()
    for heading in ("Accuracy", "Precision", "Sensitivity"):
        expect(page.locator("#results").get_by_role("columnheader", name=heading).first).to_be_visible(
            timeout=WAIT
        )
    expect(page.locator("#results details[open] img")).to_be_visible(timeout=WAIT)
    assert saved(page, "Answers (CSV)").startswith("participant,group,day,")
    for width in WIDTHS:
        fits(page, width)


def test_an_engineer_sees_last_night_and_saves_its_report(tab, console):
    page = visit(tab, console, "table")
    night = page.locator("#nights tr")
    expect(night).to_contain_text("broken", timeout=WAIT)
    expect(night).to_contain_text("The laser does not see the surface.")
    expect(page.locator("#folder")).to_contain_text("simulated-calibrations")
    assert saved(page, "Save") == "<title>a night</title>"
    page.get_by_role("link", name="The history on a page of its own").click()
    expect(page.locator("#title")).to_contain_text("History of calibrations", timeout=WAIT)
    for width in WIDTHS:
        fits(page, width)


def test_a_preflight_of_a_simulated_rig_needs_no_click(tab, console):
    page = visit(tab, console, "preflight")
    page.get_by_role("button", name="Run the preflight").click()
    expect(page.locator("#result")).to_contain_text("(", timeout=4 * WAIT)


def test_a_tablet_and_a_phone_show_a_glance(browser, console):
    for width in WIDTHS[:2]:
        tab = Tab(browser, console)
        tab.page.set_viewport_size({"width": width, "height": 844})
        page = visit(tab, console, "file?file=buttons/latch.h5")
        expect(page.locator(".gauge")).to_have_count(3, timeout=WAIT)
        box = page.locator(".glance").bounding_box()
        assert box["y"] + box["height"] <= 844, "the first screen shows all of it"
        assert not tab.errors
        tab.context.close()


def test_a_report_of_three_buttons_is_two_pages_of_paper(browser, made, tmp_path):
    for name in ("latch", "toggle", "push"):
        shutil.copy(made / "latch.h5", tmp_path / f"{name}.h5")
    write_report([tmp_path / f"{name}.h5" for name in ("latch", "toggle", "push")], tmp_path / "report.html")
    page = browser.new_page()
    page.goto((tmp_path / "report.html").as_uri())
    printed = page.pdf(format="A4")
    page.close()
    assert 1 <= len(re.findall(rb"/Type\s*/Page\b", printed)) <= 2


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_no_barrier_that_axe_finds_in_a_report_on_a_phone(browser, made, tmp_path, scheme):
    write_report([made / "latch.h5", made / "push.h5"], tmp_path / "report.html")
    context = browser.new_context(viewport={"width": 390, "height": 844}, color_scheme=scheme)
    page = context.new_page()
    page.goto((tmp_path / "report.html").as_uri())
    page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    assert barriers(page) == []
    context.close()
