"""The blocks of the documents are run: each page is a program, from its first block to its last.

A page is run in an empty folder with a rig file lab.toml, which is the simulated rig's. A block of shell is
run by bash, and one of Python in one namespace a page. A block that begins with a file's name in a comment is
written into that file, and TOML without one is parsed. Comments that the site does not show:

    <!-- not run: REASON -->      before a block, which is then skipped
    <!-- before:                  commands that prepare what the next block needs, up to -->;
                                  `before python:` likewise

The blocks of docs/how-to/adding-an-instrument.md are those of the example packages, word by word.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import pytest

import haploop

ROOT = Path(__file__).parents[1]
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").rglob("*.md")])
EXAMPLE = ROOT / "examples" / "haploop-acme-relay"
ROLES = ROOT / "examples" / "haploop-acme-thermometer"
GUIDE = (ROOT / "docs" / "how-to" / "adding-an-instrument.md").read_text(encoding="utf-8")
DRIVER_PART, ROLE_PART = GUIDE.split("## Adding a role")


def shown(guide: str) -> list[tuple[str, str]]:
    """The blocks that begin with a file's name: the name, and the rest."""
    return re.findall(r"^```\w+\n# (\S+)\n(.*?)^```$", guide, re.MULTILINE | re.DOTALL)


BLOCKS = shown(DRIVER_PART)


def test_the_guide_shows_every_file() -> None:
    files = {name for name, _ in BLOCKS}
    assert files == {
        "pyproject.toml",
        "acme.toml",
        "haploop_acme/relay.py",
        "haploop_acme/twin.py",
        "tests/test_acme_relay.py",
    }


@pytest.mark.parametrize(("name", "block"), BLOCKS)
def test_a_block_is_in_the_example(name: str, block: str) -> None:
    assert block in (EXAMPLE / name).read_text(encoding="utf-8")


@pytest.mark.parametrize(("name", "block"), shown(ROLE_PART))
def test_a_block_is_in_the_example_with_roles(name: str, block: str) -> None:
    assert block in (ROLES / name).read_text(encoding="utf-8")


def test_a_role_with_driver_and_twin_is_short() -> None:
    texts = [path.read_text(encoding="utf-8") for path in (ROLES / "haploop_acme_thermometer").glob("*.py")]
    assert sum(len(text.splitlines()) for text in texts) < 200


def test_driver_and_twin_are_short() -> None:
    texts = [
        (EXAMPLE / "haploop_acme" / name).read_text(encoding="utf-8") for name in ("relay.py", "twin.py")
    ]
    assert sum(len(text.splitlines()) for text in texts) < 100


_LONGEST = 240.0
"""Seconds after which a block is given up."""


class Block(NamedTuple):
    line: int
    language: str
    text: str
    excuse: str


FENCE = re.compile(
    r"(?:^<!-- not run: (?P<excuse>.+?) -->\n)?^```(?P<language>\w*)\n(?P<text>.*?)^```$"
    r"|^<!-- before(?P<hidden> python)?:\n(?P<setup>.*?)^-->$",
    re.MULTILINE | re.DOTALL,
)


def blocks(text: str) -> list[Block]:
    found = []
    for match in FENCE.finditer(text):
        line = text[: match.start()].count("\n") + 1
        if match["setup"] is not None:
            found.append(Block(line, "python" if match["hidden"] else "sh", match["setup"], ""))
        else:
            found.append(Block(line, match["language"], match["text"], match["excuse"] or ""))
    return found


def test_the_reference_has_each_name_once() -> None:
    text = (ROOT / "docs" / "reference" / "python.md").read_text(encoding="utf-8")
    named = re.findall(r"^::: haploop\.(\w+)$", text, re.MULTILINE)
    assert sorted(named) == sorted(haploop.__all__)


class Page:
    """One page's programs: a folder, which `cd` changes, and Python's names."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.names: dict[str, Any] = {}

    def run(self, block: Block, place: str) -> None:
        first, _, rest = block.text.partition("\n")
        named = re.fullmatch(r"# ([\w./-]+\.\w+)", first)
        if named and block.language not in ("sh", ""):
            (self.folder / named[1]).parent.mkdir(parents=True, exist_ok=True)
            (self.folder / named[1]).write_text(rest, encoding="utf-8")
        elif block.language == "python":
            source = "\n" * block.line + block.text
            exec(compile(source, place, "exec"), self.names)
        elif block.language == "sh":
            self._shell(block.text, place)
        if block.language == "toml":
            tomllib.loads(block.text)

    def _shell(self, text: str, place: str) -> None:
        script = f"set -euo pipefail\n{text}\npwd > '{self.folder.parent / 'pwd'}'\n"
        # A session of its own: after the time limit no command goes on by itself.
        with subprocess.Popen(
            ["bash", "-c", script],
            cwd=self.folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        ) as process:
            try:
                said, _ = process.communicate(timeout=_LONGEST)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
                raise
        assert process.returncode == 0, f"{place}: {text}\n{said}"
        self.folder = Path((self.folder.parent / "pwd").read_text(encoding="utf-8").strip())
        os.chdir(self.folder)


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


@pytest.mark.skipif(shutil.which("bash") is None, reason="the blocks are for bash")
@pytest.mark.parametrize("path", [page for page in PAGES if blocks(page.read_text("utf-8"))], ids=name_of)
def test_the_blocks_of_a_page_run(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "page"
    folder.mkdir()
    (folder / "lab.toml").write_text('base = "simulated"\nname = "lab"\n', encoding="utf-8")
    monkeypatch.chdir(folder)
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    mpl.use("agg")
    page = Page(folder)
    for block in blocks(path.read_text(encoding="utf-8")):
        if not block.excuse:
            page.run(block, f"{name_of(path)}:{block.line}")


def test_a_block_that_fails_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "page").mkdir()
    text = "```sh\nfalse\n```\n<!-- not run: x -->\n```sh\nfalse\n```\n```python\nraise KeyError\n```\n"
    first, excused, last = blocks(text)
    assert (first.excuse, excused.excuse, last.line) == ("", "x", 8)
    with pytest.raises(AssertionError, match="page:1"):
        Page(tmp_path / "page").run(first, "page:1")
    with pytest.raises(KeyError):
        Page(tmp_path / "page").run(last, "page:8")
