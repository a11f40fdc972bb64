"""Two servers, of two accounts, on one data folder: what one activates, the pages of the other show."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from haploop.calibration import DigitalButton, History, adopt
from haploop.console.worker import Address, WorkerLink
from tests.console.browser.browsing import WAIT, Tab, expect, visit
from tests.console.serving import Served, served

pytestmark = pytest.mark.timeout(600)


@pytest.fixture(scope="module")
def both(made: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Served, Served]]:
    """A history of two generations, of which the second is active, under two servers."""
    folder = tmp_path_factory.mktemp("two")
    (folder / "data" / "buttons").mkdir(parents=True)
    shutil.copy(made / "latch.h5", folder / "data" / "buttons")
    history = History.of_rig("simulated", folder / "data")
    for reason in ("it begins", "once more"):
        adopt(history, [DigitalButton.load(made / "latch.h5")], actor="a test", reason=reason)
    with (
        served(folder / "data", "--port", "0", state=folder / "one") as one,
        served(folder / "data", "--port", "0", state=folder / "other") as other,
    ):
        yield one, other


def names(console: Served) -> list[str]:
    return [one.name for one in History.of_rig("simulated", console.data).generations]


def test_what_one_server_activates_the_pages_of_the_other_show(browser, both):
    first, second = names(both[0])
    working, looking = (Tab(browser, console) for console in both)
    start, shown, history = looking.another(), looking.another(), looking.another()
    for page, name, place in ((start, "", "#calibration"), (shown, "table", "#active"),
        (history, "file?history=1", "#shown")):  # fmt: skip
        page.goto(f"{both[1].base}/{name}")
        expect(page.locator(place)).to_contain_text(second, timeout=WAIT)
    page = visit(working, both[0], "table")
    expect(page.locator("#active")).to_contain_text(second, timeout=WAIT)
    page.locator("#generation").select_option(first)
    page.get_by_label("Reason").fill("the second one rattles")
    page.locator("#sure").check()
    page.locator("#activate").click()
    expect(page.locator("#active")).to_contain_text(first, timeout=WAIT)
    expect(shown.locator("#active")).to_contain_text(first, timeout=WAIT)
    expect(shown.locator("#activations tr").first).to_contain_text("the second one rattles")
    expect(start.locator("#calibration")).to_contain_text(first, timeout=WAIT)
    expect(history.get_by_role("row", name="active")).to_contain_text(first, timeout=WAIT)
    graphs = [console.ask("/api/lineage?file=buttons/latch.h5") for console in both]
    assert graphs[0] == graphs[1] and len(graphs[0]["nodes"]) > 1
    for tab in (working, looking):
        assert not tab.errors
        tab.context.close()


def test_both_activate_at_once_and_each_entry_is_whole(both):
    history = History.of_rig("simulated", both[0].data)
    before, (first, second) = len(history.activations), names(both[0])

    def activate(console, generation, account):
        address = Address.read(next((console.data.parent / account / "simulated").glob("console-*.json")))
        assert address is not None
        worker = WorkerLink(address)
        values = {"generation": generation, "reason": "at once"}
        number = console.ask("/api/command/start", {"kind": "activate", "parameters": values})["job"]
        until = time.monotonic() + 60
        while (job := worker.state()["job"])["number"] == number and job["state"] in ("waiting", "running"):
            assert time.monotonic() < until
            time.sleep(0.02)
        assert job["state"] == "done" or "is in use" in job["sentence"], job
        return job["state"] == "done"

    with ThreadPoolExecutor(2) as pool:
        done = [one for _ in range(4) for one in pool.map(activate, both, (first, second), ("one", "other"))]
    assert any(done) and len(history.activations) == before + sum(done)
    assert history.active().name in (first, second)
