"""Fixtures: a command in this process, and one demo for all tests, because it takes half a minute."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result
from filelock import FileLock

from haploop.commands.cli import cli

Run = Callable[..., Result]


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
    """Runs the command line in this process; nothing may escape as an exception."""

    def runner(*args: object) -> Result:
        result = CliRunner().invoke(cli, [str(arg) for arg in args])
        assert result.exception is None or isinstance(result.exception, SystemExit)
        assert "Traceback" not in result.output
        return result

    return runner


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
