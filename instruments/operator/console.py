"""The operator at a terminal: prompts on standard error, answers from standard input."""

from __future__ import annotations

import shutil
import sys
import textwrap
from typing import Self

from ...base.bounded import Strict
from ...base.clock import Clock
from .role import Consent, Operator, Request, UnansweredError


class Console(Operator):
    """See `Operator`."""

    class Settings(Strict):
        """The `[operator]` table of a rig file; a console has no settings."""

    @staticmethod
    def hardware(settings: Settings) -> tuple[str, ...]:
        """See `Driver.hardware`: a person may answer to two rigs."""
        return ()

    @classmethod
    def open(cls, settings: Settings, clock: Clock) -> Self:
        """Return a console; there is nothing to connect to."""
        return cls()

    def tell(self, request: Request) -> None:
        """See `Operator.tell`."""
        print(_lines(f"{request}"), file=sys.stderr, flush=True)

    def rejects(self) -> bool:
        """See `Operator.rejects`: True when the operator has typed r and Enter."""
        return "r" in _typed().strip().lower().split()

    def confirm(self, request: Request) -> bool:
        """See `Operator.confirm`. Raises UnansweredError when standard input has ended.

        Enter alone is yes, but for consent, which is asked until somebody says yes or no.
        """
        if not isinstance(request, Consent):
            return _answer(request, "[Y/n]") in ("", *_YES)
        while (answer := _answer(request, "[y/n]")) not in (*_YES, *_NO):
            pass
        return answer in _YES


_YES, _NO = ("y", "yes"), ("n", "no")


def _answer(request: Request, choice: str) -> str:
    if _in_notebook():
        # Standard input of a notebook's process is empty; `input` asks in the cell.
        return input(f"{request} {choice} ").strip().lower()
    print(_lines(f"{request} {choice}"), end=" ", file=sys.stderr, flush=True)
    answer = sys.stdin.readline()
    if not answer:
        raise UnansweredError(f"Nobody is at the console to answer: {request}")
    return answer.strip().lower()


def _in_notebook() -> bool:
    """True in a cell of a notebook: IPython with a kernel, whose front end answers `input`."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    return shell is not None and hasattr(shell, "kernel")


def _lines(sentence: str) -> str:
    """Break a sentence between words at the terminal's width; leave it whole for a file or a pipe."""
    if not sys.stderr.isatty():
        return sentence
    width = shutil.get_terminal_size().columns - 1
    return textwrap.fill(sentence, width, break_long_words=False, break_on_hyphens=False)


if sys.platform == "win32":
    import msvcrt

    def _typed() -> str:
        """Return the keys that have been typed; "" without any. Does not wait."""
        found = ""
        while sys.stdin.isatty() and msvcrt.kbhit():
            found += msvcrt.getwch()
        return found

else:
    import select

    def _typed() -> str:
        """Return a line that has been typed; "" without one. Does not wait."""
        # A pipe or a file cannot watch presses, and its lines are the answers to later questions.
        if not sys.stdin.isatty() or not select.select([sys.stdin], [], [], 0)[0]:
            return ""
        return sys.stdin.readline()
