"""What an operator sees while presses or a study are recorded: count, time left, force and acceleration."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Self

from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from ...acquisition import PressVerdict, StudyProgress
from ...instruments import LiveBlock, Press, Request, Rest, Rig, levels
from ...terminal.progress import say, shown

_BAR = 10
"""Characters of a level's bar."""
_TOP = {"Fz": 5.0, "acceleration z": 1.0}
"""Least full scale of the bars (N; m/s^2); a larger level is the full scale from then on."""
_TOUCHED = 0.5
"""N: a force above this is a finger."""


class Meter:
    """Two lines at the foot of a terminal while presses are recorded; a line for each press elsewhere.

    A context. Sentences printed meanwhile stand above the two lines. Levels are read from a tap of the rig,
    which never holds up a recording.
    """

    def __init__(self, rig: Rig, console: Console | None = None) -> None:
        self._console = console or Console(file=sys.stderr, markup=False, emoji=False)
        # Each is taken from by one thread: the display's, and the one that records.
        self._tap, self._at_rest = rig.tap(), rig.tap(1)
        self._stack, self._display, self._visible = ExitStack(), ExitStack(), False
        self._block: LiveBlock | None = None
        self._asked: Request | None = None
        self._asked_at: int | None = None
        self._zero = self._force = self._shaken = 0.0
        self._doing, self._done, self._of, self._bad = "", 0.0, 0.0, 0
        self._tops = dict(_TOP)
        self._overloaded = False
        self._aside = ""
        """What else is said of the count."""

    def __enter__(self) -> Self:
        self._stack.enter_context(self._tap)
        self._stack.enter_context(self._at_rest)
        self._stack.enter_context(self._display)
        self.show()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def show(self) -> None:
        """Show the two lines, if this is a terminal."""
        if not self._console.is_terminal or self._visible:
            return
        self._visible = True
        live = Live(
            console=self._console,
            get_renderable=self.lines,
            refresh_per_second=10,
            transient=True,
            redirect_stdout=False,
        )
        self._display.enter_context(_no_echo())
        self._display.enter_context(live)
        self._display.enter_context(shown(self._console))

    def hide(self) -> None:
        """Take the two lines away, for a question: what is typed is seen."""
        self._visible = False
        self._display.close()

    def progress(self, doing: str, done: float, of: float, unit: str, /) -> None:
        """Show the number of accepted presses; see `haploop.base.progress.Progress`."""
        if not self._console.is_terminal:
            if doing != self._doing:
                say(self._console, f"{doing}: {done:g} of {of:g} {unit}.")
            elif done > self._done:
                say(self._console, f"{done:g} of {of:g} {unit}.")
        self._doing, self._done, self._of = doing, done, of

    def on_request(self, request: Request) -> None:
        """Count down from a request; see `haploop.record`."""
        self._asked, self._asked_at = request, None
        block = self._at_rest.latest()
        if isinstance(request, Press) and block is not None:
            # Hands are off when a press is asked for.
            self._zero = next((level.mean for level in levels(block) if level.name == "Fz"), 0.0)

    def on_verdict(self, press: PressVerdict) -> None:
        """Say why a press was not accepted, or what is doubtful in it; see `haploop.record`."""
        if not press.accepted:
            self._bad += 1
            say(self._console, rejection_line(press))
        elif press.reason:
            say(self._console, f"Press {press.number} counts, but: {press.reason}")

    def lines(self) -> Group:
        """The two lines as they are now. Called by the display's own thread."""
        blocks = list(iter(lambda: self._tap.take(0), None))
        self._block = blocks[-1] if blocks else self._block
        force, meter = self._levels(blocks)
        bad = f", {self._bad} repeated" if self._bad else ""
        count = f"{self._doing}: {self._done:g} of {self._of:g}{bad}{self._aside}. " if self._doing else ""
        return Group(Text(count + self._state(force), no_wrap=True, overflow="ellipsis"), meter)

    def _state(self, force: float) -> str:
        block, asked = self._block, self._asked
        if asked is not None and self._done == self._of > 0:
            return "Done."
        if asked is None or block is None:
            return "Starting."
        if self._asked_at is None or block.first < self._asked_at:
            self._asked_at = block.first
        passed = (block.end - self._asked_at) / block.run.rate_hz
        if not isinstance(asked, Press):
            return f"Hands off: {max(0.0, asked.duration - passed):.1f} s" if isinstance(asked, Rest) else ""
        if force > _TOUCHED:
            return f"Press {asked.number}: pressing"
        left = asked.patience - passed
        if left > 0:
            return f"Press {asked.number} now: {left:.0f} s"
        minutes, seconds = divmod(max(0, round(asked.wait + left)), 60)
        return f"Waiting for press {asked.number}: {minutes}:{seconds:02d} min left"

    def _levels(self, blocks: Sequence[LiveBlock]) -> tuple[float, Text]:
        """The force now (N), and the line of the largest levels in the blocks since the last look."""
        each = [{level.name: level for level in levels(block)} for block in blocks]
        now = [abs(found["Fz"].mean - self._zero) for found in each if "Fz" in found]
        if each:
            self._force = max(now, default=0.0)
            self._shaken = max((f["acceleration z"].peak for f in each if "acceleration z" in f), default=0.0)
        line = Text(no_wrap=True, overflow="crop")
        line.append(f"Force {self._bar('Fz', self._force)} {self._force:5.1f} N  ")
        line.append(f"Acceleration {self._bar('acceleration z', self._shaken)} {self._shaken:5.1f} m/s²")
        self._overloaded |= any(level.overload for found in each for level in found.values())
        if self._overloaded:
            # It stays, because nobody looks all the time.
            line.append("  OVERLOAD", style="bold red")
        return now[-1] if now else 0.0, line

    def _bar(self, name: str, value: float) -> str:
        self._tops[name] = max(self._tops[name], value)
        full = round(_BAR * value / self._tops[name])
        return "█" * full + "░" * (_BAR - full)


def rejection_line(press: PressVerdict) -> str:
    """One line for the operator about a press that was not accepted."""
    return f"Press {press.number}, attempt {press.attempt}: {press.reason} It is kept and will be repeated."


@contextmanager
def _no_echo() -> Iterator[None]:
    """Hide what is typed at the terminal, which would land on the lines at its foot."""
    restore: Callable[[], None] | None = None
    if sys.platform != "win32" and sys.stdin.isatty():
        import termios  # noqa: PLC0415

        before = termios.tcgetattr(sys.stdin)
        hidden = list(before)
        hidden[3] &= ~termios.ECHO
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, hidden)

        def restore() -> None:
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)

    try:
        yield
    finally:
        if restore is not None:
            restore()


# What an operator sees while a study is recorded.


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
