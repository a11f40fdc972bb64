"""A browser, a console and a tab. Only the modules that Chromium and Playwright let run ask for them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from tests.console.serving import Served, served


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    from tests.console.browser.browsing import CHROMIUM, OPTIONS, playwright

    with playwright.sync_playwright() as program:
        found = program.chromium.launch(executable_path=CHROMIUM, args=OPTIONS)
        yield found
        found.close()


@pytest.fixture(scope="module")
def console(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A console of the simulated rig in real time, for all tests of a module."""
    from tests.console.browser.browsing import STUDY, experiments

    folder = tmp_path_factory.mktemp("console")
    (folder / "data" / "study").mkdir(parents=True)
    (folder / "data" / "study" / "study.toml").write_text(STUDY, encoding="utf-8")
    experiments(folder / "data")
    with served(folder / "data", "--port", "0", state=folder / "state") as found:
        found.ask("/api/command/override", {"reason": "a test"})
        yield found


@pytest.fixture
def tab(browser: Any, console: Served) -> Iterator[Any]:
    from tests.console.browser.browsing import Tab

    found = Tab(browser, console)
    yield found
    found.context.close()
    assert not found.errors
    assert found.hosts <= {"127.0.0.1", "blob"}, "no request leaves the machine"
