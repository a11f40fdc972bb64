"""The outputs of one NI card or chassis: one task, which reserves them from the first zero to the last.

A task that was committed explicitly keeps its resources when it is stopped and when its timing is changed,
and an output keeps its last value meanwhile (NI-DAQmx Key Concepts, "Transitioning the State Backwards"). So
the same task writes zero on demand, plays on a sample clock and writes zero again, and no other program can
write to the outputs in between (-50103).

A reset of the card takes them from it all the same, unseen where the task changes its state just then: it
reserves them again by itself. A reset takes the inputs of the card too, which are reserved before such a
change, and have to be so still after it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from typing import Any, Protocol

import numpy as np
from nidaqmx.constants import SampleTimingType, TaskMode
from nidaqmx.errors import DaqError
from nidaqmx.stream_writers import AnalogMultiChannelWriter

from ...base.arrays import FloatArray
from ...base.clock import RealClock
from ...base.errors import HaploopError, InstrumentError, TakenError
from .ni_sentences import refused
from .ni_settings import Output

_IN_USE = -50103
_TRIES = 10
"""Attempts to reserve the outputs, which another program's single write holds for an instant."""
_PAUSE = 0.01
"""Time between them (s)."""


class Tasks(Protocol):
    """What makes tasks of NI's library."""

    def task(self, purpose: str) -> Any:
        """Create a task, a context that clears it."""

    def talking_to(self, device: str) -> AbstractContextManager[None]:
        """Turn any error of NI's library into one sentence about `device`."""


class Cards(Tasks, Protocol):
    """What the outputs ask of the cards that they are on."""

    def add_output(self, task: Any, output: Output) -> None:
        """Give a task an output."""

    def read_back(self, home: str) -> Mapping[str, float]:
        """Volts on the outputs of a card or chassis, by name, as far as they can be read now."""


def _never() -> bool:
    return False


def reservable(daq: Tasks, home: str, add: Callable[[Any], object]) -> bool:
    """True when a second task can reserve the channels that `add` gives it: the first has lost them."""
    try:
        with daq.talking_to(home), daq.task(f"{home} reserved") as second:
            add(second)
            second.control(TaskMode.TASK_RESERVE)
    except HaploopError as error:
        if getattr(error.__cause__, "error_code", 0) == _IN_USE:
            return False
        raise
    return True


class NiOutputs:
    """The outputs of `home`, by name; errors are InstrumentErrors about it."""

    def __init__(self, daq: Cards, home: str, outputs: Mapping[str, Output]) -> None:
        self._daq, self._home, self._outputs = daq, home, outputs
        self._task: Any = None
        self._plays = False
        self._was_reset: Callable[[], bool] = _never

    def rest(self) -> None:
        """Stop what plays, write zero, and keep the outputs reserved. Idempotent.

        Raises InstrumentError where another program holds an output, and TakenError where one has taken an
        output that rested or played here: it is read first, and then at zero again.
        """
        taken, stood = False, ""
        if self._task is not None:
            taken = not self._plays
            try:
                if taken or not self._lost():
                    self._write_zero()
                    if taken or not self._was_reset():
                        return
                    raise TakenError(self._taken(""))
                taken = True
            except HaploopError as error:
                if not isinstance(error.__cause__, DaqError):  # the server is gone
                    raise
                taken |= isinstance(error, TakenError) or error.__cause__.error_code == _IN_USE
                taken = taken or self._was_reset()
            if taken:
                read = self._daq.read_back(self._home)
                stood = ", ".join(f"{name!r} read {volts:.3g} V then" for name, volts in read.items())
            self._drop()
        for left in reversed(range(_TRIES)):
            try:
                self._reserve()
                break
            except HaploopError as error:
                self._drop()
                if left and getattr(error.__cause__, "error_code", 0) == _IN_USE:
                    RealClock().sleep(_PAUSE)
                    continue
                if not taken:
                    raise
                raise TakenError(f"{self._taken(stood)} {error}") from error
        if taken:
            raise TakenError(self._taken(stood))

    def play(
        self, waveforms: Mapping[str, FloatArray], rate_hz: float, clock: str, was_reset: Callable[[], bool]
    ) -> Any:
        """Load waveforms ((samples,) V, all of one length) and arm them: sample 0 at `clock`'s first edge.

        An output without a waveform plays zero. `was_reset` says whether the card was reset since before the
        call. Returns the task, which is the caller's until `rest`. Raises TakenError for a reset.
        """
        if self._plays:
            raise refused(self._home, _IN_USE, "")
        self.rest()
        length = len(next(iter(waveforms.values())))
        silence = np.zeros(length)
        rows = np.array([waveforms.get(name, silence) for name in self._outputs], np.float64)
        task, self._plays = self._task, True
        with self._daq.talking_to(self._home):
            task.stop()
            # The master's own card too: two dividers of one timebase need not give the same rate.
            task.timing.cfg_samp_clk_timing(rate_hz, clock, samps_per_chan=length)
            task.control(TaskMode.TASK_COMMIT)
            taken = AnalogMultiChannelWriter(task.out_stream, auto_start=False).write_many_sample(rows)
            if taken != length:
                raise InstrumentError(
                    f"{self._home} took {taken} of a waveform's {length} samples; nothing was played."
                )
            task.start()
        self._was_reset = was_reset
        if was_reset():
            raise TakenError(self._taken(""))
        return task

    def let_go(self) -> None:
        """Free the outputs, which keep their value."""
        task, self._task, self._plays = self._task, None, False
        if task is not None:
            with self._daq.talking_to(self._home):
                task.close()

    def _drop(self) -> None:
        """As `let_go`, for a task that may be broken or cleared already."""
        with suppress(HaploopError):
            self.let_go()

    def _lost(self) -> bool:
        """True when what plays has been aborted: a second task can reserve the outputs.

        A reset of the card leaves the task, which says that it is done, and would start again.
        """
        with self._daq.talking_to(self._home):
            if not self._task.is_task_done():
                return False
        return reservable(self._daq, self._home, self._add)

    def _add(self, task: Any) -> None:
        for output in self._outputs.values():
            self._daq.add_output(task, output)

    def _taken(self, stood: str) -> str:
        return (
            f"Another program has taken the outputs of {self._home} from this one"
            f"{', and ' * bool(stood)}{stood}: see what else uses the card."
        )

    def _reserve(self) -> None:
        with self._daq.talking_to(self._home):
            self._task = self._daq.task(f"{self._home} output")
            self._add(self._task)
            self._task.control(TaskMode.TASK_COMMIT)
            self._task.start()
        self._write_zero()

    def _write_zero(self) -> None:
        task = self._task
        with self._daq.talking_to(self._home):
            if self._plays:
                # A task in error says so again when it is stopped; the stream has raised that error.
                with suppress(HaploopError), self._daq.talking_to(self._home):
                    task.stop()
                task.timing.samp_timing_type = SampleTimingType.ON_DEMAND
                task.start()
                self._plays = False
            zeros: float | Sequence[float] = [0.0] * len(self._outputs) if len(self._outputs) > 1 else 0.0
            taken = task.write(zeros, auto_start=False)
        if taken != 1:
            raise InstrumentError(f"{self._home} did not say that its outputs took zero: try again.")
