"""A psychologist runs and reports Experiment I with two people, and never sees a shell."""

from __future__ import annotations

import re
from pathlib import Path
from time import monotonic

import pytest

from haploop.experiments import load_experiment
from tests.console.browser.browsing import WAIT, Tab, expect, fits, visit
from tests.console.browser.test_experiments import begin, participants_tab, present
from tests.console.serving import served

pytestmark = pytest.mark.timeout(600)
MOST_CLICKS = 18
"""The operator's, beside `n` for each stimulus. They were counted, and are not to grow."""
MOST_WORDS = 920
"""On the pages, once they are whole: what is folded is not read. They were counted too."""
READ = "document.querySelector('main').innerText.split(/\\s+/).filter(Boolean).length"
COUNTED = """
window.clicks = Number(sessionStorage.getItem('clicks') || 0);
addEventListener('click', (event) => {
  const control = event.target.closest('a, button, input, select, summary, label');
  if (event.isTrusted && control) sessionStorage.setItem('clicks', ++window.clicks);
}, true);
"""


def words(page):
    """Words on a page once it has its contents, which come one after another."""
    counts = [page.evaluate(READ)]
    while len(counts) < 5 or len(set(counts[-5:])) > 1:
        page.wait_for_timeout(200)
        counts.append(page.evaluate(READ))
    return counts[-1]


def block(page, name):
    """The fields of a block of the form."""
    summary = re.compile(rf"^Block \d: {name}$")
    found = page.locator("#fields details").filter(has=page.locator("summary").filter(has_text=summary))
    found.locator("summary").first.click()
    return found


def test_a_psychologist_runs_and_reports_experiment_1_with_two_people(browser, tmp_path):
    data, begun = tmp_path / "data", monotonic()
    with served(data, "--port", "0", state=tmp_path / "state") as console:
        tab = Tab(browser, console)
        tab.context.add_init_script(COUNTED)
        page = visit(tab, console, "experiment")
        read = words(page)
        page.get_by_role("link", name="make one from an example").click()
        expect(page.locator("#trial .choices button")).to_have_count(3, timeout=WAIT)
        read += words(page)
        block(page, "familiarisation").get_by_role("button", name="Remove").click()
        block(page, "finger calibration").get_by_role("button", name="Remove").click()
        repetitions = block(page, "experiment").get_by_label("Repetitions")
        repetitions.fill("many")
        expect(page.locator("#problem")).to_contain_text("must be a whole number", timeout=WAIT)
        repetitions.fill("2")
        expect(page.locator("#shown tbody tr").last).to_contain_text("6", timeout=WAIT)
        expect(page.locator("#problem")).to_be_empty()
        page.get_by_label("Sessions").fill("1")
        page.get_by_label("New folder in the data folder").fill("pilot")
        page.get_by_role("button", name="Save").click()
        expect(page.get_by_label("Experiment (a folder")).to_have_value("pilot", timeout=WAIT)
        read += words(page)
        shown = participants_tab(browser, page, console)
        for who in ("P01", "P02"):
            if who == "P02":  # the first one is offered, once the list has been read again
                page.reload()
                expect(page.locator("#who-of option[value='P01']")).to_have_count(1, timeout=WAIT)
            begin(page, "pilot", who)
            for _ in range(9 + 6):
                present(page)
                expect(shown.locator(".choices button")).to_have_count(3, timeout=WAIT)
                shown.locator(".choices button").nth(0 if who == "P01" else 1).tap()
                expect(shown.locator("#answers")).to_be_hidden(timeout=WAIT)
            expect(shown.locator("#question")).to_contain_text("complete", timeout=WAIT)
            page.get_by_role("button", name="End here").click()
            expect(page.locator("#where")).to_have_text("No session runs.", timeout=WAIT)
        for word in ("Accuracy", "Precision", "Sensitivity"):
            heading = page.locator("#results").get_by_role("columnheader", name=word).first
            expect(heading).to_be_visible(timeout=WAIT)
        for name, start in (("Answers (CSV)", "participant,group,day,"), ("Report (HTML)", "<!")):
            with page.expect_download(timeout=WAIT) as download:
                page.get_by_role("button", name=name, exact=True).click()
            assert Path(download.value.path()).read_text("utf-8").startswith(start)
        read += page.locator("#results").evaluate("one => one.innerText.split(/\\s+/).length")
        print(f"{page.evaluate('clicks')} clicks, {read} words, {monotonic() - begun:.0f} s")
        assert page.evaluate("clicks") <= MOST_CLICKS and read <= MOST_WORDS
        visit(tab, console, "design")
        for width in (1400, 1024, 390):
            fits(page, width)
        assert not tab.errors
    assert load_experiment(data / "pilot").file.sessions == 1


def test_a_study_is_made_in_a_form_and_is_chosen(browser, tmp_path):
    with served(tmp_path / "data", "--port", "0", state=tmp_path / "state") as console:
        tab = Tab(browser, console)
        page = visit(tab, console, "study")
        page.get_by_role("link", name="make one").click()
        page.get_by_label("Buttons", exact=True).fill("doorbell, switch")
        page.get_by_label("Participant", exact=True).fill("P01.age = 31\nP02.age = 44\nP03.age = 5.5")
        expect(page.locator("#text")).to_contain_text("age = 5.5", timeout=WAIT)
        columns = ("tall, left-handed", '"007"', "true")
        page.get_by_label("Participant", exact=True).fill(
            "\n".join(f"P0{k}.age = 5.5\nP0{k}.note = {one}" for k, one in enumerate(columns, 1))
        )
        for kept in ('note = "tall, left-handed"', 'note = "007"', "note = true"):
            expect(page.locator("#text")).to_contain_text(kept, timeout=WAIT)
        page.get_by_label("Button", exact=True).fill("doorbell.force = 1, 5")
        expect(page.locator("#shown tbody")).to_contain_text("doorbell, switch", timeout=WAIT)
        expect(page.locator("#text")).to_contain_text("force = [1, 5]", timeout=WAIT)
        page.get_by_role("button", name="Save").click()
        expect(page.locator("#entries tr")).to_have_count(6, timeout=WAIT)
        assert not tab.errors
