"""Recording along: read each instrument that is not on a DAQ in a thread of its own.

Time is the sample index: the thread that writes the blocks requests a reading when the recording has
reached the sample at which it is due. The same thread writes the answers, so neither the reader of the
DAQ nor the file ever waits for a slow instrument. A virtual clock stands still during a reading, so the
same simulation gives the same recording.
"""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Self

from ...base.clock import Clock
from ...base.errors import ConfigurationError, HaploopError, InstrumentError
from ...instruments import NewFile, Reading, RecordedAlong, Rig
from ...instruments.safety import run_within
from ..recording import Event, Writer, reading_event

_HUNG = 5.0
"""Seconds without an answer after which an instrument counts as hung."""


class SideRecording:
    """All instruments of a rig that are recorded along: a context manager that starts and stops them.

    Entering raises InstrumentError when an instrument does not start, before anything is recorded. A
    later failure is written as an event, and the instrument is read again.
    """

    def __init__(self, rig: Rig, path: Path) -> None:
        self._clock = rig.clock
        self._path = path
        self._pollers = [
            _Poller(role, instrument, rig.file.rate_hz, path.parent)
            for role, instrument in rig.instruments.items()
            if isinstance(instrument, RecordedAlong)
        ]
        self._left = 0

    def __enter__(self) -> Self:
        with ExitStack() as undo:
            for poller in self._pollers:
                undo.callback(poller.stop)
                poller.start(self._path.with_suffix(""), self._clock)
            undo.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        for poller in self._pollers:
            poller.stop()

    def reserve(self, duration: float, block: int) -> int:
        """Largest number of events in `duration` seconds with blocks of `block` samples.

        Events beyond this number are dropped; an event states that.
        """
        self._left = sum(poller.most(duration, block) for poller in self._pollers)
        return self._left

    def follow(self, writer: Writer) -> None:
        """Request the readings now due, and write those that have arrived. Called by the writing thread."""
        for poller in self._pollers:
            poller.ask(writer.written)
        self._clock.hold(self._answered)
        self._write(writer)

    def finish(self, writer: Writer) -> None:
        """Stop every instrument, and write the remaining readings."""
        for poller in self._pollers:
            poller.stop(writer.written)
        self._write(writer)

    def _answered(self) -> None:
        for poller in self._pollers:
            poller.wait()

    def _write(self, writer: Writer) -> None:
        for poller in self._pollers:
            while poller.events:
                event = poller.events.popleft()
                self._left -= 1
                if self._left > 0:
                    writer.note(*event)
                elif self._left == 0:
                    writer.note(event.sample, "along-full", "There was no space for further readings.")


class _Poller:
    """One instrument, and the thread that reads it."""

    def __init__(self, role: str, instrument: RecordedAlong, rate_hz: float, folder: Path) -> None:
        self._instrument, self._folder, self._rate_hz = instrument, folder, rate_hz
        self._role = role
        self._name = f"The {role} ({getattr(instrument, 'identity', role)})"
        if not 0 < instrument.reads_hz < math.inf:
            raise ConfigurationError(
                f"{self._name} is read {instrument.reads_hz} times a second: reads_hz must be more than 0."
            )
        self._period = max(1, math.ceil(rate_hz / instrument.reads_hz))
        self._due = 0
        self._asked: int | None = None
        """Sample index of the pending request; None without one."""
        self._failing = ""
        """What it failed with at the last request."""
        self._hung = self._stopped = False
        self._lock = threading.RLock()
        self._change = threading.Condition(self._lock)
        self._thread = threading.Thread(target=self._run, name=f"haploop-{role}", daemon=True)
        self.events: deque[Event] = deque()
        """Readings: appended by the instrument's thread, taken by the writing thread."""

    def most(self, duration: float, block: int) -> int:
        """Largest number of events in `duration` seconds, with at most one request a block."""
        reads = math.ceil(duration * self._rate_hz / max(self._period, block)) + 2
        return reads * (len(self._instrument.reads) + 1) + len(self._instrument.reads) + 8

    def start(self, stem: Path, clock: Clock) -> None:
        """Start the instrument, then its thread. Raises InstrumentError."""
        try:
            run_within(self._name, lambda: self._instrument.start(stem, clock))
        except Exception as error:
            raise InstrumentError(
                f"{self._name} cannot be recorded along: {_told(error)} Repair it, or take its table out of "
                "the rig file."
            ) from error
        self._thread.start()

    def ask(self, index: int) -> None:
        """Request a reading, if one is due at sample `index` and the last one has arrived."""
        with self._lock:
            if self._asked is None and index >= self._due and not self._stopped:
                self._asked = index
                # Multiples of the period, so that a late request does not delay all later ones.
                self._due = (index // self._period + 1) * self._period
                self._change.notify_all()
            late = self._asked is not None and index - self._asked > _HUNG * self._rate_hz
            if late and not self._hung:
                self._say_hung(index)

    def wait(self) -> None:
        """Wait, at most `_HUNG` s of real time, until no request is pending; never for a hung instrument."""
        with self._lock:
            if not self._hung and not self._change.wait_for(lambda: self._asked is None, _HUNG):
                self._say_hung(self._asked or 0)

    def stop(self, index: int | None = None) -> None:
        """Stop the thread and the instrument, and take what is left. May be called again; never raises.

        A failure becomes an event at sample `index`.
        """
        with self._lock:
            if self._stopped:
                return
            self._stopped = True
            self._change.notify_all()
        if self._thread.ident is not None and not self._hung:
            self._thread.join(_HUNG)
        try:
            run_within(self._name, lambda: self._take(index or 0, self._instrument.stop()))
        except Exception as error:
            self._fail(index or 0, error)

    def _say_hung(self, index: int) -> None:
        self._hung = True
        self.events.append(Event(index, "along-error", f"{self._name} has not answered for {_HUNG:g} s."))

    def _run(self) -> None:
        while True:
            with self._lock:
                self._change.wait_for(lambda: self._asked is not None or self._stopped)
                if self._asked is None:
                    return
                index = self._asked
            try:
                self._take(index, self._instrument.read())
            except BaseException as error:  # no driver may end the recording, even by sys.exit
                if _told(error) != self._failing:
                    self._fail(index, error)
                self._failing = _told(error)
            else:
                self._failing = ""
            with self._lock:
                self._asked, self._hung = None, False
                self._change.notify_all()

    def _take(self, index: int, reads: Sequence[Reading | NewFile]) -> None:
        for read in reads:
            self.events.append(reading_event(index, self._role, read, self._folder))

    def _fail(self, index: int, error: BaseException) -> None:
        self.events.append(Event(index, "along-error", f"{self._name}: {_told(error)}"))


def _told(error: BaseException) -> str:
    """Message of an error on one line; other errors than haploop's own get their type in front."""
    told = " ".join(str(error).split())
    return told if isinstance(error, HaploopError | TimeoutError) else f"{type(error).__name__}: {told}."
