"""Commands start at once: nothing heavy is loaded before a command has work to do."""

import json
import os
import shlex
import shutil
import subprocess
import sys
from typing import Any

import click
import pytest
from click.testing import CliRunner

from haploop.commands.cli import cli
from haploop.commands.examples import COURSES, EXAMPLES
from tests.exchange.conftest import files

__all__ = ["files"]

HEAVY = {"scipy", "h5py", "nidaqmx", "numpy", "matplotlib", "pydantic", "grpc", "jinja2", "serial", "pyvisa"}

LOADED = """
import json, sys
from haploop.commands.cli import cli
from haploop.commands.examples import EXAMPLES
try:
    cli.main({args}, standalone_mode=False)
finally:
    print(json.dumps([*sys.modules]), file=sys.stderr)
"""

SLOW = {
    "matplotlib", "scipy.fft", "scipy.interpolate", "scipy.ndimage", "scipy.optimize", "scipy.signal",
    "scipy.special", "scipy.stats",
}  # fmt: skip
"""What takes longest to load; most commands compute nothing with it."""
FILTERS = {"scipy.ndimage", "scipy.special"}
"""What is loaded to find presses."""


def commands(group: click.Group = cli, path: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    """Every command and group, as it is typed."""
    found = []
    for name, command in group.commands.items():
        found.append((*path, name))
        if isinstance(command, click.Group):
            found += commands(command, (*path, name))
    return found


def loaded_by(script: str) -> set[Any]:
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return set(json.loads(done.stderr.splitlines()[-1]))


def test_importing_haploop_loads_nothing_heavy():
    script = "import json, sys, haploop; print(json.dumps([*sys.modules]), file=sys.stderr)"
    assert not loaded_by(script) & (HEAVY | {"click", "rich"})


@pytest.mark.parametrize("args", [["--help"], ["--version"]], ids=" ".join)
def test_help_and_version_load_nothing_heavy(args):
    assert not loaded_by(LOADED.format(args=args)) & HEAVY


@pytest.mark.parametrize("asked", [None, 2])
def test_a_command_computes_in_one_thread_unless_asked_otherwise(asked, monkeypatch):
    for library in ("OMP", "OPENBLAS"):
        monkeypatch.delenv(f"{library}_NUM_THREADS", raising=False)
        if asked:
            monkeypatch.setenv(f"{library}_NUM_THREADS", str(asked))
    script = """
import json, sys
from haploop.__main__ import main
sys.argv[1:] = ["--version"]
try:
    main()
finally:
    import numpy, threadpoolctl
    libraries = threadpoolctl.threadpool_info()
    print(json.dumps([library["num_threads"] for library in libraries]), file=sys.stderr)
"""
    assert loaded_by(script) == {min(asked or 1, os.cpu_count() or 1)}


def test_the_help_of_each_command_loads_nothing_heavy():
    script = """
import json, sys
from haploop.commands.cli import cli
from haploop.commands.examples import EXAMPLES
for path in {paths}:
    try:
        cli.main([*path, "--help"])
    except SystemExit as end:
        assert end.code == 0, path
print(json.dumps([*sys.modules]), file=sys.stderr)
"""
    assert not loaded_by(script.format(paths=commands())) & HEAVY


@pytest.mark.long
@pytest.mark.parametrize(
    ("args", "light"),
    [
        (["schema"], SLOW | {"h5py"}),
        (["log"], SLOW | {"h5py"}),
        (["verify", "{recording}"], SLOW | {"scipy", "nidaqmx", "pyvisa"}),
        (["list", "--in", "{folder}"], SLOW | {"nidaqmx", "pyvisa"}),
        (["show", "{recording}"], (SLOW | {"nidaqmx", "pyvisa"}) - FILTERS),
        (["show", "{calibration}"], SLOW | {"nidaqmx", "pyvisa"}),
        (
            ["record", "push", "-p", "P02", "-n", "1", "--out", "{folder}"],
            # It looks for hum and spikes in what is recorded.
            (SLOW | {"nidaqmx", "grpc", "pyvisa"}) - FILTERS,
        ),
        (
            ["report", "{calibration}", "--out", "{folder}/report.html"],
            (SLOW | {"nidaqmx", "pyvisa"}) - FILTERS - {"matplotlib"},
        ),
        # It finds which patch is where, and steady tones in the noise.
        (["doctor"], (SLOW | {"nidaqmx", "pyvisa"}) - FILTERS - {"scipy.optimize"}),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)
def test_a_command_loads_what_it_works_with(files, tmp_path, args, light):
    recording = shutil.copy(files.recording, tmp_path)
    places = {"recording": recording, "calibration": files.calibration, "folder": tmp_path}
    loaded = loaded_by(LOADED.format(args=[arg.format(**places) for arg in args]))
    assert sorted(loaded & light) == []


def leaves() -> list[tuple[str, ...]]:
    every = commands()
    return [path for path in every if not any(other[: len(path)] == path for other in every if other != path)]


def test_the_help_of_each_command_shows_an_example_and_of_each_group_a_course():
    assert sorted(EXAMPLES) == sorted(" ".join(path) for path in leaves())
    every = {" ".join(path) for path in commands()} - {" ".join(path) for path in leaves()} | {""}
    assert sorted(COURSES) == sorted(every)


@pytest.mark.parametrize("path", [(), *commands()], ids=" ".join)
def test_the_help_of_each_command_reads_well_at_80_columns(path):
    # click leaves two columns of a terminal free.
    result = CliRunner().invoke(cli, [*path, "--help"], terminal_width=78)
    lines = result.output.splitlines()[1:]
    assert result.exit_code == 0 and max(map(len, lines)) <= 80
    assert not [line for line in lines if line.endswith(("...", "-")) or "RANGE" in line or "(this " in line]
    command: click.Command = cli
    for word in path:
        assert isinstance(command, click.Group)
        command = command.commands[word]
    options = [option for option in command.params if isinstance(option, click.Option)]
    assert all(option.hidden or option.help for option in options)


@pytest.mark.parametrize(
    ("path", "example"),
    [(path, EXAMPLES[" ".join(path)]) for path in leaves()]
    + [(tuple(group.split()), line) for group, course in COURSES.items() for line in course],
    ids=lambda value: value if isinstance(value, str) else " ".join(value),
)
def test_an_example_is_a_command_that_can_be_given(path, example):
    """Click takes its arguments and options; what they name is in the examples' own world."""
    words = shlex.split(example.partition(" > ")[0])
    command: click.Command = cli
    for word in path:
        assert isinstance(command, click.Group)
        command = command.commands[word]
    assert example in command.get_help(click.Context(command))
    assert words.pop(0) == "haploop"
    command = cli
    while isinstance(command, click.Group):
        command = command.commands[words.pop(0)]
    with command.make_context("haploop", words):
        pass
