"""Ask a person at the terminal, for commands that write files from answers."""

from __future__ import annotations

import sys
from collections.abc import Callable

import click

from . import front as haploop


def asker(instead: str) -> Callable[[str, str], str]:
    """Return what asks a question, with the answer that Enter gives.

    Where nobody is there to answer, it raises ConfigurationError with `instead`: what to give to be asked
    nothing.
    """

    def ask(question: str, default: str) -> str:
        try:
            return str(click.prompt(question, default=default, show_default=bool(default), err=True))
        except click.Abort:  # Ctrl-C, or the end of what was written into it
            if sys.stdin.isatty():
                raise
            asked = question.splitlines()[0]
            raise haploop.ConfigurationError(f"Nobody is there to answer {asked!r}: {instead}.") from None

    return ask
