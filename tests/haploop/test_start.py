"""Commands start at once: nothing heavy is loaded before a command has work to do."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys

import click
import pytest

from haploop.cli import cli
from haploop.commands.examples import EXAMPLES

HEAVY = {"scipy", "h5py", "nidaqmx", "numpy", "matplotlib", "pydantic", "grpc", "jinja2", "serial", "pyvisa"}

LOADED = """
import json, sys
from haploop.cli import cli
from haploop.commands.examples import EXAMPLES
try:
    cli.main({args}, standalone_mode=False)
finally:
    print(json.dumps(sorted({{name.partition(".")[0] for name in sys.modules}})), file=sys.stderr)
"""


def commands(group: click.Group = cli, path: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    """Every command and group, as it is typed."""
    found = []
    for name, command in group.commands.items():
        found.append((*path, name))
        if isinstance(command, click.Group):
            found += commands(command, (*path, name))
    return found


def loaded_by(script: str) -> set[str]:
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return set(json.loads(done.stderr.splitlines()[-1]))


def test_importing_haploop_loads_nothing_heavy() -> None:
    script = "import json, sys, haploop; print(json.dumps([*sys.modules]), file=sys.stderr)"
    assert not loaded_by(script) & (HEAVY | {"click", "rich"})


@pytest.mark.parametrize("args", [["--help"], ["--version"]], ids=" ".join)
def test_help_and_version_load_nothing_heavy(args: list[str]) -> None:
    assert not loaded_by(LOADED.format(args=args)) & HEAVY


def test_the_help_of_each_command_loads_nothing_heavy() -> None:
    script = """
import json, sys
from haploop.cli import cli
from haploop.commands.examples import EXAMPLES
for path in {paths}:
    try:
        cli.main([*path, "--help"])
    except SystemExit as end:
        assert end.code == 0, path
print(json.dumps(sorted({{name.partition(".")[0] for name in sys.modules}})), file=sys.stderr)
"""
    assert not loaded_by(script.format(paths=commands())) & HEAVY


def leaves() -> list[tuple[str, ...]]:
    every = commands()
    return [path for path in every if not any(other[: len(path)] == path for other in every if other != path)]


def test_the_help_of_each_command_shows_an_example() -> None:
    assert sorted(EXAMPLES) == sorted(" ".join(path) for path in leaves())


@pytest.mark.parametrize("path", leaves(), ids=" ".join)
def test_an_example_is_a_command_that_can_be_given(path: tuple[str, ...]) -> None:
    """Click takes its arguments and options; what they name is in the examples' own world."""
    name = " ".join(path)
    words = shlex.split(EXAMPLES[name].partition(" > ")[0])
    assert words[: len(path) + 1] == ["haploop", *path]
    command: click.Command = cli
    for word in path:
        assert isinstance(command, click.Group)
        command = command.commands[word]
    with command.make_context(name, words[len(path) + 1 :]) as context:
        assert command.epilog and EXAMPLES[name] in command.get_help(context)
