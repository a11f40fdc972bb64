"""A process that is ready to begin something again and again, so that each beginning can be killed."""

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self

__all__ = ["Victims", "serve"]


def serve(begin: Callable[[str], None]) -> None:
    """For each line of standard input, `begin(line)` in a process of its own, whose number is printed.

    What is imported, and loaded, before this is so only once: a kill then costs what it kills.
    """
    for line in sys.stdin:
        child = os.fork()
        if child == 0:
            begin(line.strip())
            os._exit(0)
        print(child, flush=True)
        _, status = os.waitpid(child, 0)
        print(os.waitstatus_to_exitcode(status), flush=True)


class Victims:
    """Runs a program that calls `serve`; a context."""

    def __init__(self, program: str) -> None:
        self._server = subprocess.Popen(
            [sys.executable, "-c", program],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=Path.cwd(),
        )  # fmt: skip

    def begin(self, word: str) -> int:
        """Begin, and return the number of the process."""
        self._server.stdin.write(word + "\n")
        self._server.stdin.flush()
        return int(self._line())

    def kill(self, victim: int) -> int:
        """Kill it, and return how it ended: -9, or 0 when it was done before."""
        with contextlib.suppress(ProcessLookupError):
            os.kill(victim, signal.SIGKILL)
        return int(self._line())

    def end(self) -> int:
        """Wait until it has ended by itself; how it ended."""
        return int(self._line())

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._server.stdin.close()
        self._server.stdout.close()
        self._server.wait(60)

    def _line(self) -> str:
        return self._server.stdout.readline()
