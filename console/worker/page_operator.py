"""The operator at the console's pages: requests go to the board, answers come as commands."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import asdict

from ...base.errors import InstrumentError
from ...base.threads import Flag
from ...instruments import Operator
from ...instruments.operator import (
    Aim,
    Cable,
    ConfirmSettings,
    LiftFinger,
    Place,
    Press,
    Remove,
    Request,
    Rest,
    RestFinger,
    TakeTarget,
    Target,
    Uncable,
)
from .board import Board

_POLL = 0.1
"""Seconds of one wait for an answer: on Windows an unlimited wait ignores STOP."""


class PageOperator(Operator):
    """One job's operator. On a simulated rig `person` is the simulated one, who acts on the plant.

    `nobody` says when no page has been there for so long that a question will not be answered.
    """

    def __init__(self, board: Board, person: Operator | None, nobody: Flag) -> None:
        self._board, self._person, self._nobody = board, person, nobody
        self._number = 0
        self._answer: tuple[int, bool] | None = None
        self._answered = Flag()
        self._reject = False
        self._notes: deque[str] = deque()
        self._waiting: Request | None = None
        """A press that waits for a key on the page."""
        self._begins = False
        """Whether hands are off before the first press of a session."""

    def tell(self, request: Request) -> None:
        """See `Operator.tell`."""
        self._show(request, asks=False)
        if isinstance(request, Press):
            self._board.set(paused=False)
        self._begins = isinstance(request, Rest)
        if self._person is None:
            return
        if isinstance(request, Press) and not self._board["auto"]:
            self._waiting = request
        else:
            self._person.tell(request)

    def confirm(self, request: Request) -> bool:
        """See `Operator.confirm`. Raises InstrumentError when no page is there to answer."""
        if (
            self._person is not None
            and self._board["auto"]
            and isinstance(
                request,
                Aim
                | Cable
                | ConfirmSettings
                | LiftFinger
                | Place
                | Remove
                | Rest
                | RestFinger
                | TakeTarget
                | Target
                | Uncable,
            )
        ):
            self._show(request, asks=False)
            return self._person.confirm(request)
        self._answered.clear()
        number = self._show(request, asks=True)
        while not (self._answered.wait(_POLL) and self._answer is not None and self._answer[0] == number):
            if self._nobody.is_set():
                raise InstrumentError(f"Nobody is at the console to answer: {request}")
        yes = self._answer[1]
        self._board.set(request=None)
        return yes and (self._person is None or self._person.confirm(request))

    def rejects(self) -> bool:
        """See `Operator.rejects`."""
        rejected, self._reject = self._reject, False
        return rejected

    def paused(self) -> bool:
        """See `Operator.paused`. With "Wait for Next before each press", the first one waits too."""
        if self._begins and self._board["step"]:
            self._board.set(paused=True)
        self._begins = False
        return bool(self._board["paused"])

    def notes(self) -> Sequence[str]:
        """See `Operator.notes`."""
        return [self._notes.popleft() for _ in range(len(self._notes))]

    # Commands of the pages

    def answer(self, number: int, yes: bool) -> bool:
        """Answer the request of this number; False when another one is asked, or none."""
        request = self._board["request"]
        if request is None or request["number"] != number or not request["asks"]:
            return False
        self._answer = (number, yes)
        self._answered.set()
        return True

    def reject(self) -> None:
        """Reject the preceding press."""
        self._reject = True

    def note(self, text: str) -> None:
        """Write a note into the recording."""
        self._notes.append(text)

    def press(self, looking: bool = False) -> bool:
        """Let the simulated participant press now; False when no press is waited for, nor `looking`."""
        request, self._waiting = self._waiting, None
        if looking:
            request = Press("push", "P01", 1, 1)
        if request is None or self._person is None:
            return False
        self._person.tell(request)
        return True

    def _show(self, request: Request, asks: bool) -> int:
        self._number += 1
        shown = {
            "number": self._number,
            "kind": type(request).__name__,
            "text": str(request),
            "asks": asks,
            **{name: value for name, value in asdict(request).items() if name not in ("words", "number")},
        }
        if isinstance(request, Press):
            shown["press"] = request.number
        self._board.set(request=shown)
        return self._number
