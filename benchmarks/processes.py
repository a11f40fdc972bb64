"""Processor time and memory of programs, in rounds in which every one has its turn."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from statistics import median

__all__ = ["Cost", "haploop", "in_rounds", "spread"]


@dataclass(frozen=True)
class Cost:
    """What one run of a program took."""

    cpu: float
    """s, of the user and of the system, with its own children."""
    memory: float
    """MB at most."""


def in_rounds(
    programs: Mapping[str, Sequence[str]], rounds: int, folder: Path, at_once: int = 1
) -> dict[str, list[Cost]]:
    """Run every program once a round, in `folder`, and return what each took. Not on Windows.

    `at_once` of them run at the same time. An argument `NEW` becomes a path that does not exist. Raises
    CalledProcessError when a program fails.
    """
    found: dict[str, list[Cost]] = {name: [] for name in programs}
    environment = {**os.environ, "HAPLOOP_STATE": str(folder / "state"), "HAPLOOP_LIVE": "off"}
    environment |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}

    def cost(command: Sequence[str]) -> Cost:
        new = tempfile.mktemp(dir=folder)
        words = [word.replace("NEW", new) for word in command]
        with (
            tempfile.TemporaryFile() as said,
            subprocess.Popen(
                words, cwd=folder, env=environment, stdout=subprocess.DEVNULL, stderr=said
            ) as process,
        ):
            _, status, used = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            if process.returncode not in (0, 1):  # 1: done, and out of tolerance
                said.seek(0)
                raise subprocess.CalledProcessError(process.returncode, words, stderr=said.read())
        return _cost(used)

    with ThreadPoolExecutor(at_once) as pool:
        for _ in range(rounds):
            for name, used in zip(programs, pool.map(cost, programs.values()), strict=True):
                found[name].append(used)
    return found


def _cost(used: resource.struct_rusage) -> Cost:
    unit = 1 if sys.platform == "darwin" else 1024
    return Cost(used.ru_utime + used.ru_stime, used.ru_maxrss * unit / 1e6)


def haploop(arguments: str) -> list[str]:
    """Return the words of a command of haploop."""
    return [sys.executable, "-m", "haploop", *arguments.split()]


def spread(values: Sequence[float], digits: int = 2) -> str:
    """Median and range, as text."""
    return f"{median(values):.{digits}f} ({min(values):.{digits}f} to {max(values):.{digits}f})"
