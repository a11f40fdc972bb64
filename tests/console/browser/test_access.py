"""Every page for everybody: axe-core, 200 % zoom, keyboard."""

from __future__ import annotations

import pytest

from tests.console.browser.browsing import PAGES, WAIT, Tab, barriers, expect, visit

pytestmark = pytest.mark.timeout(600)


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("name", [*PAGES, "participant"])
def test_no_barrier_that_axe_finds(browser, console, name, scheme):
    tab = Tab(browser, console, bypass_csp=True, color_scheme=scheme)
    page = visit(tab, console, name) if name != "participant" else tab.page
    if name == "participant":
        page.goto(f"{console.base}/participant")
    assert barriers(page) == []
    tab.context.close()
    assert tab.hosts <= {"127.0.0.1", "blob"}, "no request leaves the machine"


CONTROLS = "a[href], button, input, select, textarea, summary, [tabindex='0']"
USABLE = f'[...document.querySelectorAll("{CONTROLS}")].filter((o) => !o.disabled && o.checkVisibility())'


@pytest.mark.parametrize("name", PAGES)
def test_every_control_is_reached_and_seen_by_the_tab_key_at_200_percent(browser, console, name):
    """In the order of the page, without a trap, and never behind the bar that stays at the top.

    A window of 1280 pixels at 200 % is 640 pixels wide to the page.
    """
    context = browser.new_context(
        viewport={"width": 640, "height": 450}, device_scale_factor=2, bypass_csp=True
    )
    page = context.new_page()
    page.goto(console.url)
    page.goto(f"{console.base}/{name}")
    expect(page.locator("#rig")).to_contain_text("Rig simulated", timeout=WAIT)
    page.wait_for_timeout(1000)  # lists of files come behind the first snapshot
    assert page.evaluate("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
    expect(page.get_by_role("button", name="STOP")).to_be_in_viewport()
    count = page.evaluate(f"{USABLE}.length")
    reached = []
    for _ in range(count):
        page.keyboard.press("Tab")
        reached.append(page.evaluate(f"{USABLE}.indexOf(document.activeElement)"))
        hidden = page.evaluate(
            """() => {
                const one = document.activeElement, box = one.getBoundingClientRect();
                const y = Math.min(Math.max(box.top + box.height / 2, 0), innerHeight - 1);
                const over = document.elementFromPoint(box.left + box.width / 2, y);
                return one.contains(over) || (over && over.contains(one)) ? "" : one.outerHTML.slice(0, 90);
            }"""
        )
        assert hidden == ""
    assert reached == list(range(count)), "each once, in the order of the page"
    context.close()
