"""Each command of haploop that a document names exists, with its options: in blocks that do not run, too."""

import re
from collections.abc import Iterator

import click
import pytest

from haploop.commands.cli import cli
from tests.documents.pages import ROOT, blocks, name_of

DOCUMENTS = [
    *ROOT.glob("*.md"),
    *(path for folder in ("docs", "examples", "benchmarks") for path in (ROOT / folder).rglob("*.md")),
]


def commands_in(text: str) -> Iterator[str]:
    """Yield what is written as a command: lines of shell, indented lines, and code within a sentence."""
    for block in blocks(text):
        if block.language == "sh":
            yield from re.findall(r"\bhaploop [a-z][^\n#|&;]*", block.text.replace("\\\n", " "))
    yield from re.findall(r"^ {4}(haploop [a-z][^\n#|&;]*)", text, re.MULTILINE)
    yield from re.findall(r"`(haploop [a-z][^`\n]*)`", text)


def wrong_in(line: str) -> str:
    """Return what of a command does not exist; empty if all of it does."""
    words = line.replace("\\|", "|").split()[1:]
    command: click.Command = cli
    context = click.Context(command)
    while words and isinstance(command, click.Group):
        for name in words[0].split("|"):
            if (found := command.get_command(context, name)) is None:
                return f"no command {name}"
        command, words = found, words[1:]
    known = {option for one in command.params for option in (*one.opts, *one.secondary_opts)}
    for word in words:
        if word == "--":
            break
        if word.startswith("--") and word not in known | {"--help", "--version"}:
            return f"no option {word}"
    return ""


FORMATS = ("haploop recording", "haploop representative", "haploop calibration")
"""What files call themselves (docs/reference/format.md)."""


@pytest.mark.parametrize("document", DOCUMENTS, ids=name_of)
def test_each_command_exists(document):
    lines = set(commands_in(document.read_text(encoding="utf-8"))) - set(FORMATS)
    assert {line: wrong for line in sorted(lines) if (wrong := wrong_in(line))} == {}


def test_what_does_not_exist_is_noticed():
    assert wrong_in("haploop recrod latch") == "no command recrod"
    assert wrong_in("haploop record --button push") == "no option --button"
    assert wrong_in("haploop study run --participant P01") == ""
