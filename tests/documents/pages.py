"""The blocks of the documents are run: each page is a program, from its first block to its last.

A page runs in an empty folder, as for somebody who copies its blocks. In a block of shell a line that is
a command of haploop and nothing else runs in this process, as starting one takes a second, and other lines by
bash; Python runs in one namespace a page. A block that begins with a file's name in a comment is written into
that file, and TOML without one is parsed. Comments that the site does not show:

    <!-- not run: REASON -->      before a block, which is then skipped; "needs MODULE": only without it
    <!-- smaller:                 edits (sed -i) of a file that the page has written, up to -->: fewer
                                  presses, another address. What a block needs stands in the page.

The pages are shared by several modules, because one worker of pytest-xdist runs a whole module.
"""

import importlib.util
import os
import re
import shlex
import signal
import subprocess
import sys
import tomllib
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
import pytest
from click.testing import CliRunner

from haploop.commands.cli import cli

ROOT = Path(__file__).parents[2]

SHARES = {
    "how-to a-l": ("docs/how-to/[a-l]*.md",),
    "how-to m-z": ("docs/how-to/[m-z]*.md",),
    "others": ("README.md", "docs/*.md", "docs/[!h]*/*.md", "docs/reference/python/*.md"),
}
"""Pages of each test module, as patterns from the repository's root."""
_LONGEST = 240.0
"""Seconds after which a block is given up."""


class Block(NamedTuple):
    line: int
    language: str
    text: str
    excuse: str


FENCE = re.compile(
    r"(?:^<!-- not run: (?P<excuse>.+?) -->\n)?^```(?P<language>\w*)\n(?P<text>.*?)^```$"
    r"|^<!-- smaller:\n(?P<edits>(?:sed -i [^\n;&|]*\n)+)-->$",
    re.MULTILINE | re.DOTALL,
)
_COMMAND = re.compile(r"haploop [^|&;<>$`()\[\]{}~?]*")
"""A line of shell that starts a command of haploop, and asks nothing else of the shell but `*` and quotes."""


def blocks(text: str) -> list[Block]:
    found = []
    for match in FENCE.finditer(text):
        line = text[: match.start()].count("\n") + 1
        if match["edits"] is not None:
            found.append(Block(line, "sh", match["edits"], ""))
        else:
            found.append(Block(line, match["language"], match["text"], match["excuse"] or ""))
    return found


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
        lines = text.replace("\\\n", " ").splitlines()
        for command, some in groupby(lines, lambda line: _COMMAND.fullmatch(line) is not None):
            for piece in some if command else ("\n".join(some),):
                code, said = self._haploop(piece) if command else self._bash(piece)
                assert code == 0, f"{place}: {piece}\n{said}"

    def _haploop(self, line: str) -> tuple[int, str]:
        words = shlex.split(line, comments=True)[1:]
        result = CliRunner().invoke(cli, [name for word in words for name in self._matching(word)])
        assert result.exception is None or isinstance(result.exception, SystemExit)
        return result.exit_code, result.output

    def _matching(self, word: str) -> list[str]:
        """What a shell makes of a word with `*`, if files match it."""
        found = [str(path.relative_to(self.folder)) for path in self.folder.glob(word)] if "*" in word else []
        return sorted(found) or [word]

    def _bash(self, text: str) -> tuple[int, str]:
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
        if process.returncode == 0:
            self.folder = Path((self.folder.parent / "pwd").read_text(encoding="utf-8").strip())
            os.chdir(self.folder)
        return process.returncode, said


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def pages_of(*patterns: str) -> list[Path]:
    """The pages with blocks that match a pattern, from the repository's root."""
    found = sorted(path for pattern in patterns for path in ROOT.glob(pattern))
    return [path for path in found if blocks(path.read_text(encoding="utf-8"))]


def run_blocks(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run a page from its first block to its last."""
    folder = tmp_path / "page"
    folder.mkdir()
    monkeypatch.chdir(folder)
    monkeypatch.syspath_prepend(str(folder))
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    mpl.use("agg")
    page = Page(folder)
    for block in blocks(path.read_text(encoding="utf-8")):
        needs = re.fullmatch(r"needs (\w+)", block.excuse)
        if not block.excuse or (needs and importlib.util.find_spec(needs[1])):
            page.run(block, f"{name_of(path)}:{block.line}")
