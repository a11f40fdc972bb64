"""Fixtures: a command in this process, and one demo for all tests, because it takes half a minute."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result
from filelock import FileLock

from haploop.commands.cli import cli

Says = str | tuple[str, ...]
"""Parts of what stands in the errors, wherever its lines are broken."""


class Run:
    """The command line in this process; nothing may escape as an exception."""

    def __call__(
        self, command: object = "", *args: object, ends: int | None = None, says: Says = (), typed: str = ""
    ) -> Result:
        """Run `command`, which is split at its spaces, with more arguments, which are taken as they are.

        It ends with the exit code `ends`, which is 2 where its errors are to say something.
        """
        words = [*str(command).split(), *(str(arg) for arg in args)]
        result = CliRunner().invoke(cli, words, input=typed or None)
        assert result.exception is None or isinstance(result.exception, SystemExit)
        assert "Traceback" not in result.output
        if says and ends is None:
            ends = 2
        assert ends in (None, result.exit_code), result.output
        told = result.stderr + " ".join(result.stderr.split())
        for part in (says,) if isinstance(says, str) else says:
            assert part in told, result.stderr
        return result

    def json(self, command: object, *args: object, ends: int | None = 0) -> Any:
        """Return what the command prints with --json."""
        return json.loads(self(command, *args, "--json", ends=ends).stdout)


@dataclass(frozen=True)
class Ended:
    """How a command ended."""

    exit_code: int
    stdout: str
    stderr: str


@dataclass(frozen=True)
class Demo:
    folder: Path
    result: Ended
    summary: dict[str, Any]


@pytest.fixture(autouse=True)
def no_columns(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a pipe from a shell: xdist sets COLUMNS for its workers."""
    monkeypatch.delenv("COLUMNS", raising=False)


@pytest.fixture
def run() -> Run:
    return Run()


@pytest.fixture(scope="session")
def demo(common: Path, mode: str) -> Demo:
    """Read only. The worker that needs it first makes it, and the others wait for that."""
    folder, told = common / "demo", common / "demo.json"
    with FileLock(common / "demo.lock"):
        if not told.exists():
            simulate = mode if mode in ("twin", "wire") else "twin"
            result = CliRunner().invoke(cli, ["demo", "--json", "--out", str(folder), "--simulate", simulate])
            assert result.exit_code in (0, 1, 4), result.output
            told.write_text(json.dumps([result.exit_code, result.stdout, result.stderr]), encoding="utf-8")
    ended = Ended(*json.loads(told.read_text(encoding="utf-8")))
    return Demo(folder, ended, json.loads(ended.stdout))
