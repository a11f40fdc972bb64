"""Commands start at once: nothing heavy is loaded before a command has work to do."""

from __future__ import annotations

import json
import subprocess
import sys

import click
import pytest

from haploop.cli import cli

HEAVY = {"scipy", "h5py", "nidaqmx", "numpy", "matplotlib", "pydantic", "grpc", "jinja2", "serial", "pyvisa"}

LOADED = """
import json, sys
from haploop.cli import cli
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
for path in {paths}:
    try:
        cli.main([*path, "--help"])
    except SystemExit as end:
        assert end.code == 0, path
print(json.dumps(sorted({{name.partition(".")[0] for name in sys.modules}})), file=sys.stderr)
"""
    assert not loaded_by(script.format(paths=commands())) & HEAVY
