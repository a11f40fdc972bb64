"""The documents and what they are about: example packages word by word, the reference's names."""

from __future__ import annotations

import re

import pytest

import haploop
from tests.documents.pages import ROOT, SHARES, Page, blocks, name_of, pages_of

EXAMPLE = ROOT / "examples" / "haploop-acme-relay"
ROLES = ROOT / "examples" / "haploop-acme-thermometer"
GUIDE = (ROOT / "docs" / "how-to" / "adding-an-instrument.md").read_text(encoding="utf-8")
DRIVER_PART, ROLE_PART = GUIDE.split("## Adding a role")


def shown(guide: str) -> list[tuple[str, str]]:
    """The blocks that begin with a file's name: the name, and the rest."""
    return re.findall(r"^```\w+\n# (\S+)\n(.*?)^```$", guide, re.MULTILINE | re.DOTALL)


BLOCKS = shown(DRIVER_PART)


def test_the_guide_shows_every_file():
    files = {name for name, _ in BLOCKS}
    assert files == {
        "pyproject.toml",
        "acme.toml",
        "haploop_acme/relay.py",
        "haploop_acme/twin.py",
        "tests/test_acme_relay.py",
    }


@pytest.mark.parametrize(("name", "block"), BLOCKS)
def test_a_block_is_in_the_example(name, block):
    assert block in (EXAMPLE / name).read_text(encoding="utf-8")


@pytest.mark.parametrize(("name", "block"), shown(ROLE_PART))
def test_a_block_is_in_the_example_with_roles(name, block):
    assert block in (ROLES / name).read_text(encoding="utf-8")


def test_a_role_with_driver_and_twin_is_short():
    texts = [path.read_text(encoding="utf-8") for path in (ROLES / "haploop_acme_thermometer").glob("*.py")]
    assert sum(len(text.splitlines()) for text in texts) < 200


def test_driver_and_twin_are_short():
    texts = [
        (EXAMPLE / "haploop_acme" / name).read_text(encoding="utf-8") for name in ("relay.py", "twin.py")
    ]
    assert sum(len(text.splitlines()) for text in texts) < 100


def test_the_reference_has_each_name_once():
    text = (ROOT / "docs" / "reference" / "python.md").read_text(encoding="utf-8")
    named = re.findall(r"^::: haploop\.(\w+)$", text, re.MULTILINE)
    assert sorted(named) == sorted(haploop.__all__)


def test_the_reference_shows_each_name_in_use():
    text = (ROOT / "docs" / "reference" / "python.md").read_text(encoding="utf-8")
    shown = re.sub(r"^::: .*$", "", text, flags=re.MULTILINE)
    assert [name for name in haploop.__all__ if not re.search(rf"\b{name}\b", shown)] == []


def test_each_name_that_tab_completes_has_an_example():
    text = (ROOT / "docs" / "reference" / "python.md").read_text(encoding="utf-8")
    programs = "".join(block.text for block in blocks(text) if block.language == "python")
    assert [name for name in dir(haploop) if not re.search(rf"\b{name}\b", programs)] == []


def test_each_page_is_run_once():
    shared = [page for patterns in SHARES.values() for page in pages_of(*patterns)]
    assert sorted(shared) == sorted(pages_of("README.md", "docs/**/*.md"))


def test_no_page_needs_what_its_reader_does_not_see():
    """A comment that the site does not show excuses a block, or makes it smaller; it prepares nothing."""
    for page in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")]:
        text = page.read_text(encoding="utf-8")
        comments = len(re.findall("<!-- ", text))
        known = len(re.findall(r"^<!-- not run: .+ -->$", text, re.MULTILINE))
        known += sum(one.text.startswith("sed -i ") for one in blocks(text))
        assert comments == known, name_of(page)


@pytest.mark.parametrize("hidden", ["haploop demo", "sed -i s/10/2/ study.toml; haploop demo"])
def test_what_prepares_in_a_comment_is_no_block(hidden):
    assert blocks(f"<!-- smaller:\n{hidden}\n-->\n") == []
    assert [one.text for one in blocks("<!-- smaller:\nsed -i s/10/2/ study.toml\n-->\n")]


def test_a_block_that_fails_is_noticed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "page").mkdir()
    text = "```sh\nfalse\n```\n<!-- not run: x -->\n```sh\nfalse\n```\n```python\nraise KeyError\n```\n"
    first, excused, last = blocks(text)
    assert (first.excuse, excused.excuse, last.line) == ("", "x", 8)
    with pytest.raises(AssertionError, match="page:1"):
        Page(tmp_path / "page").run(first, "page:1")
    with pytest.raises(KeyError):
        Page(tmp_path / "page").run(last, "page:8")
