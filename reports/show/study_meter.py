"""What an operator sees while a study is recorded."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Self

from rich.console import Console
from rich.text import Text

from ...acquisition import PressVerdict, StudyProgress
from ...instruments import Request, Rig
from ...terminal.progress import say
from .meter import Meter, rejection_line


class StudyMeter(Meter):
    """The meter of a study: shown while presses are recorded, and away while the operator is asked.

    Each button gets a line when it is done, and each press that is repeated.
    """

    def __init__(self, rig: Rig, entries: Sequence[StudyProgress], console: Console | None = None) -> None:
        super().__init__(rig, console)
        self._before = sum(len(one.accepted) for one in entries)
        self._all = sum(one.of for one in entries)
        self._sessions: dict[str, tuple[float, float]] = {}

    def __enter__(self) -> Self:
        super().__enter__()
        self.hide()  # the first thing is a question
        return self

    def on_request(self, request: Request) -> None:
        """See `Meter.on_request`."""
        super().on_request(request)
        self.show()

    def progress(self, doing: str, done: float, of: float, unit: str, /) -> None:
        """Show the progress of a session; see `run_study`."""
        if doing != self._doing:
            self._bad = 0
        self._doing, self._done, self._of = doing, done, of
        first, _ = self._sessions.get(doing, (done, done))
        self._sessions[doing] = first, done
        whole = self._before + sum(now - first for first, now in self._sessions.values())
        self._aside = f"; {whole:g} of {self._all} in all"
        if done == of:
            self.hide()
            again = f", {self._bad} not accepted and repeated" if self._bad else ""
            say(self._console, Text(f"{doing}: {done:g} of {of:g} {unit}{again}.", style="green"))

    def on_study_verdict(self, participant: str, button: str, press: PressVerdict) -> None:
        """Say why a press was not accepted; see `run_study`."""
        if not press.accepted:
            self._bad += 1
            say(self._console, Text(f"{participant}, {button}: {rejection_line(press)}", style="yellow"))
