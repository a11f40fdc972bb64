"""STOP: from a page, or another thread, to the safe state.

Three ways lead there, each without the page's server. The main thread is interrupted, as by Ctrl-C, and
leaves the rig's context. If it has not come within `_GRACE` s (a driver's call hangs, say), another thread
reaches the safe state by itself. If no job runs, the rig is opened, made safe and closed. If the whole
process hangs, nobody renews the relay box's dead-man time, and the box opens.
"""

from __future__ import annotations

import _thread
import math
import signal
import sys
import threading
from collections.abc import Callable
from typing import Any

from ...base.clock import RealClock
from ...base.errors import ConfigurationError
from ...base.wording import capital
from ...instruments import Rig
from .board import Board

_GRACE = 1.0
"""s from STOP until the safe state is reached by another thread."""
_CONFIRMED = 20.0
"""s that an answer to STOP waits for the safe state: longer than all deadlines on the way."""
_UNOPENED = 5.0
"""s from STOP until it is said that a rig which is still being opened is not confirmed safe."""


class Stopping:
    """Leads each STOP to the safe state, and says on the board what came of it. For any thread.

    `job` gives the number of the running job, 0 without one, and its rig, once that is open; `reach` asks
    for a job that opens the rig and makes it safe. `changing` is held while `job` changes.
    """

    def __init__(
        self,
        board: Board,
        changing: threading.Lock,
        job: Callable[[], tuple[int, Rig | None]],
        reach: Callable[[], object],
        at_rest: str,
    ) -> None:
        """`at_rest` is the rig's safe state, as a clause."""
        self._safe = f"{capital(at_rest)}, read back."
        self._board, self._changing, self._job, self._reach = board, changing, job, reach
        self._clock = RealClock()
        self._late = False
        """Whether a deadline, and not the rig, said of the last STOP that it is unconfirmed."""
        self._interrupted = -math.inf
        """Time of the last interrupt of a job."""

    def stop(self) -> dict[str, Any]:
        """Reach the safe state, and return what came of it: {state, sentence, number}."""
        with self._changing:
            (number, rig), stop = self._job(), self._board["stop"]
            reaching = stop["state"] == "reaching"
            asked = stop["number"] + (not reaching)
            self._late = False
            self._say(asked, "reaching", "Reaching the safe state ...")
            # A second press waits for the first one's result: it must not interrupt a file that is being
            # finished. While the rig is still being opened, there is none.
            now = self._clock.now()
            if number and (not reaching or (rig is None and now - self._interrupted > _GRACE)):
                self._interrupted = now
                _interrupt_main()
        if not reaching and number:
            threading.Thread(target=self._otherwise, args=(number, asked), daemon=True).start()
        elif not reaching:
            self._reach()
        until = self._clock.now() + _CONFIRMED
        while self._board["stop"]["state"] == "reaching" and self._clock.now() < until:
            self._clock.sleep(0.02)
        self._give_up(asked, f"The safe state was not confirmed within {_CONFIRMED:g} s")
        return dict(self._board["stop"])

    def refuse_after(self, stops: int) -> None:
        """Refuse a job that was asked for before the last STOP, after `stops` of them: it would begin now."""
        if self._board["stop"]["number"] != stops:
            raise ConfigurationError("STOP came before this began, so it was not begun: start it again.")

    def job_ended(self, state: str, sentence: str, left_safe: bool) -> bool:
        """Say what the end of a job means for STOP, and return whether the safe state is still to be reached.

        `left_safe` says whether the job opened the rig and left it in the safe state. The caller holds
        `changing`.
        """
        stop = self._board["stop"]
        waits = stop["state"] == "reaching" or self._late
        if state == "unconfirmed":
            self._say(stop["number"], "unconfirmed", sentence)
            waits = False
        elif waits and left_safe:
            self._say(stop["number"], "safe", self._safe)
            waits = False
        self._late &= waits
        return bool(waits)

    def _otherwise(self, number: int, asked: int) -> None:
        """Reach the safe state from this thread, if the main thread has not left job `number` in time."""
        begun = self._clock.now()
        while (rig := self._job()[1]) is None or self._clock.now() < begun + _GRACE:
            if self._job()[0] != number or self._board["stop"]["number"] != asked:
                return
            if self._clock.now() > begun + _UNOPENED:
                self._give_up(asked, f"The rig has not been opened within {_UNOPENED:g} s", number)
            self._clock.sleep(0.05)
        if self._job()[0] != number:
            return
        try:
            rig.make_safe()
        except Exception as error:
            self._say(asked, "unconfirmed", str(error))
        else:
            self._say(asked, "safe", f"{self._safe} The job has not ended yet; it may be finishing its file.")

    def _give_up(self, asked: int, why: str, number: int | None = None) -> None:
        """Say that STOP number `asked` is not confirmed, if it is not, and job `number` runs still."""
        with self._changing:
            stop = self._board["stop"]
            waits = (stop["state"], stop["number"]) == ("reaching", asked)
            if waits and number in (None, self._job()[0]):
                self._late = True
                self._say(asked, "unconfirmed", f"{why}: switch the amplifier off by hand.")

    def _say(self, asked: int, state: str, sentence: str) -> None:
        self._board.set(stop={"state": state, "sentence": sentence, "number": asked})


def _interrupt_main() -> None:
    """Interrupt the main thread as Ctrl-C does: also in a blocking system call, outside Windows."""
    main = threading.main_thread().ident
    if sys.platform == "win32" or main is None:
        _thread.interrupt_main(signal.SIGINT)
    else:
        signal.pthread_kill(main, signal.SIGINT)
