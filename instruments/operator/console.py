"""The operator at a terminal: prompts on standard error, answers from standard input."""

from __future__ import annotations

import sys
from typing import Self

from pydantic import BaseModel, ConfigDict

from haploop.instruments.clock import Clock
from haploop.instruments.errors import InstrumentError
from haploop.instruments.operator.role import Operator, Request

__all__ = ["Console"]


class Console(Operator):
    """See `Operator`."""

    class Settings(BaseModel):
        """The `[operator]` table of a rig file; a console has no settings."""

        model_config = ConfigDict(frozen=True, extra="forbid")

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
        print(request, file=sys.stderr, flush=True)

    def rejects(self) -> bool:
        """See `Operator.rejects`: True when the operator has typed r and Enter."""
        return _typed().strip().lower() == "r"

    def confirm(self, request: Request) -> bool:
        """See `Operator.confirm`. Raises InstrumentError when standard input has ended."""
        print(f"{request} [Y/n] ", end="", file=sys.stderr, flush=True)
        answer = sys.stdin.readline()
        if not answer:
            raise InstrumentError(f"Nobody is at the console to answer: {request}")
        return answer.strip().lower() in ("", "y", "yes")


if sys.platform == "win32":
    import msvcrt

    def _typed() -> str:
        """Return a line that has been typed; "" without one. Does not wait."""
        return sys.stdin.readline() if sys.stdin.isatty() and msvcrt.kbhit() else ""

else:
    import select

    def _typed() -> str:
        """Return a line that has been typed; "" without one. Does not wait."""
        # A pipe or a file cannot watch presses, and its lines are the answers to later questions.
        if not sys.stdin.isatty() or not select.select([sys.stdin], [], [], 0)[0]:
            return ""
        return sys.stdin.readline()
