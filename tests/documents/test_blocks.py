"""The documents and what they are about: example packages word by word, the reference's names."""

import pkgutil
import re

import pytest

import haploop
from tests.documents.pages import ROOT, SHARES, Page, blocks, name_of, pages_of
from tests.raising import raises

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
        "pyproject.toml", "acme.toml", "haploop_acme/relay.py", "haploop_acme/twin.py",
        "tests/test_acme_relay.py",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("folder", "name", "block"),
    [*((EXAMPLE, *block) for block in BLOCKS), *((ROLES, *block) for block in shown(ROLE_PART))],
)
def test_a_block_is_in_its_example(folder, name, block):
    assert block in (folder / name).read_text(encoding="utf-8")


def test_a_driver_with_its_twin_is_short_and_a_role_with_both():
    role = (ROLES / "haploop_acme_thermometer").glob("*.py")
    driver = (EXAMPLE / "haploop_acme" / name for name in ("relay.py", "twin.py"))
    for paths, most in ((role, 200), (driver, 100)):
        assert sum(len(path.read_text(encoding="utf-8").splitlines()) for path in paths) < most


def test_the_reference_has_each_name_once_in_use():
    folder = ROOT / "docs" / "reference"
    # The roles of drivers have a page of their own, and no program.
    pages = [page for page in (folder / "python").glob("*.md") if page.stem != "roles"]
    listed = [
        name
        for page in pages
        for name in re.findall(r"^::: (haploop\.[\w.]+)$", page.read_text("utf-8"), re.MULTILINE)
    ]
    assert all(pkgutil.resolve_name(name) is not None for name in listed) and len(set(listed)) == len(listed)
    flat = {name for name in dir(haploop) if not hasattr(getattr(haploop, name), "__path__")}
    assert flat <= {name.removeprefix("haploop.") for name in listed}
    text = (folder / "python.md").read_text(encoding="utf-8")
    assert [name for name in listed if not re.search(rf"\b{name.rpartition('.')[2]}\b", text)] == []


def test_each_page_is_run_once():
    shared = [page for patterns in SHARES.values() for page in pages_of(*patterns)]
    assert sorted(shared) == sorted(pages_of("README.md", "docs/**/*.md"))


def test_no_page_needs_what_its_reader_does_not_see():
    """A comment that the site does not show excuses a block, or makes it smaller; it prepares nothing."""
    for page in [ROOT / "README.md", ROOT / ".github/CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")]:
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
    raises(AssertionError, "page:1", Page(tmp_path / "page").run, first, "page:1")
    raises(KeyError, "", Page(tmp_path / "page").run, last, "page:8")
