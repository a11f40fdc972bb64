"""Event streams on the system's clock: every N samples, done, and signals."""

from __future__ import annotations

import dataclasses
import queue
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from nidaqmx._stubs import nidaqmx_pb2 as pb
from nidaqmx.constants import EveryNSamplesEventType, Signal

from ..base.clock import VirtualClock
from .errors import DaqmxError, DAQmxErrors
from .names import field
from .signalling import GLIMPSE
from .system import NiSystem
from .tasks import Task

_POLL = 0.02
"""Longest interval (s of real time) between checks of the clock while an event is expected."""
_PATIENT, _HASTY = 10_000, 50
"""Looks, 1 ms of real time apart, for a program to have handled an event on a virtual clock: on however busy
a machine, and after one that did not return in that time."""


@dataclass
class _Listener:
    """One registered event of one task."""

    task: Task
    kind: str
    every: int
    reply: Callable[[], Any]
    stream: queue.SimpleQueue[Any] = dataclasses.field(default_factory=queue.SimpleQueue)
    acquisition: int = 0
    sent: int = 0
    total: int = 0
    """Events since it was registered."""
    stuck: bool = False
    """True after an event that its program did not handle in time."""


class Events:
    """All registered events, and the thread that fires them."""

    def __init__(self, system: NiSystem, count: Callable[[str, str], int | None] | None = None) -> None:
        """`count` tells how many events of a task and kind a program has handled; None if it is not known."""
        self._system = system
        self._count = count or (lambda _task, _kind: None)
        self._listeners: dict[tuple[str, str], _Listener] = {}
        self._closing = False
        self._thread = threading.Thread(target=self._run, name="NI wire events", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End every stream."""
        with self._system.lock:
            self._closing = True
            for listener in self._listeners.values():
                listener.stream.put(None)
            self._listeners.clear()
            self._system.changed.notify_all()
        self._thread.join()

    def forget(self, task: Task) -> None:
        """End the streams of a task that is cleared."""
        for key in [key for key, listener in self._listeners.items() if listener.task is task]:
            self._listeners.pop(key).stream.put(None)

    def clear_tasks(self, process: str | None = None) -> None:
        """Clear all tasks, or those of a process, and end their streams. With the system's lock held."""
        for task in [t for t in self._system.tasks.values() if process in (None, t.process)]:
            self.forget(task)
            self._system.clear_task(task)

    def advance(self, until: float, in_callback: bool = False) -> None:
        """Move a virtual clock to `until` (s), and stop at each event until its program has handled it."""
        with self._system.lock:
            while self._system.clock.now() < until:
                self.move(until, in_callback)

    def move(self, until: float, in_callback: bool = False) -> None:
        """Move a virtual clock to `until`, or to the next event before it (s), which is then handled.

        With the system's lock held. A callback that waits does not wait for itself to return.
        """
        clock = self._system.clock
        assert isinstance(clock, VirtualClock)
        due = [when for each in self._listeners.values() if (when := self._due(each)) is not None]
        clock.sleep_until(min([until, *(max(when, clock.now() + 1e-9) for when in due)]))
        self._system.notice()
        for each in self._listeners.values():
            self._fire(each)
        self._system.changed.notify_all()
        if not in_callback:
            self.settle()

    def settle(self) -> None:
        """Wait until programs have handled the events that have happened. With the system's lock held.

        One that does not return in time, say because it waits for this thread, is not waited for again before
        it has.
        """
        for each in list(self._listeners.values()):
            looks = _HASTY if each.stuck else _PATIENT
            while not (done := self._handled(each)) and looks:
                self._system.changed.wait(1e-3)
                looks -= 1
            each.stuck = not done

    def _handled(self, listener: _Listener) -> bool:
        count = self._count(listener.task.session, listener.kind)
        return listener.stream.empty() if count is None else count >= listener.total

    def _due(self, listener: _Listener) -> float | None:
        """Time of the next event, or of the next look at the signals that decide on it (s), or None."""
        task = listener.task
        if not task.running or not task.timed:
            return None
        if task.waits():
            return self._system.clock.now() + GLIMPSE
        if listener.kind == "done":
            return None if task.total is None else task.ready(task.total)
        sent = listener.sent if listener.acquisition == task.starts else 0
        return task.ready((sent + 1) * max(1, listener.every))

    # Calls, with the system's lock held

    def register(self, name: str, request: Any) -> _Listener:
        """Register the event of the call `name`. Raises DaqmxError."""
        task = self._system.task(request.task.name)
        _refuse_running(task, DAQmxErrors.CANNOT_REGISTER_DA_QMX_SOFTWARE_EVENT_WHILE_TASK_IS_RUNNING)
        if name == "RegisterDoneEvent":
            return self._add(
                _Listener(
                    task,
                    "done",
                    0,
                    lambda: pb.RegisterDoneEventResponse(status=task.failure.code if task.failure else 0),
                ),
                DAQmxErrors.DONE_EVENT_ALREADY_REGISTERED,
            )
        if name == "RegisterSignalEvent":
            signal = field(request, "signal_id")
            _refuse_signal(task, signal)
            return self._add(
                _Listener(task, "signal", 1, lambda: pb.RegisterSignalEventResponse(signal_id=signal)),
                DAQmxErrors.SIGNAL_EVENT_ALREADY_REGISTERED,
            )
        type_ = field(request, "every_n_samples_event_type")
        acquired = type_ == EveryNSamplesEventType.ACQUIRED_INTO_BUFFER.value
        if acquired != task.is_input:
            raise DaqmxError(
                DAQmxErrors.EVERY_N_SAMPLES_ACQ_INTO_BUFFER_EVENT_NOT_SUPPORTED_BY_DEVICE
                if acquired
                else DAQmxErrors.EVERY_N_SAMPS_TRANSFERRED_FROM_BUFFER_EVENT_NOT_SUPPORTED_BY_DEVICE,
                f"This every N samples event is not supported by the channels of {task.name!r}.",
            )

        if not request.n_samples:
            raise DaqmxError(
                DAQmxErrors.EVERY_N_SAMPS_EVENT_INTERVAL_ZERO_NOT_SUPPORTED,
                "An every N samples event needs an interval of at least 1 sample.",
            )

        def reply() -> Any:
            return pb.RegisterEveryNSamplesEventResponse(
                every_n_samples_event_type_raw=type_, n_samples=request.n_samples
            )

        listener = self._add(
            _Listener(task, "samples", request.n_samples, reply),
            DAQmxErrors.EVERY_N_SAMPS_ACQ_INTO_BUFFER_EVENT_ALREADY_REGISTERED
            if acquired
            else DAQmxErrors.EVERY_N_SAMPS_TRANSFERRED_FROM_BUFFER_EVENT_ALREADY_REGISTERED,
        )
        task.every = request.n_samples
        return listener

    def unregister(self, name: str, request: Any) -> None:
        """Remove a registration, if there is one."""
        kind = {
            "UnregisterDoneEvent": "done",
            "UnregisterSignalEvent": "signal",
            "UnregisterEveryNSamplesEvent": "samples",
        }[name]
        if (request.task.name, kind) not in self._listeners:
            return
        listener = self._listeners[request.task.name, kind]
        _refuse_running(
            listener.task, DAQmxErrors.CANNOT_UNREGISTER_DA_QMX_SOFTWARE_EVENT_WHILE_TASK_IS_RUNNING
        )
        del self._listeners[request.task.name, kind]
        listener.task.heard -= 1
        if kind == "samples":
            listener.task.every = 0
        listener.stream.put(None)

    def stream(self, listener: _Listener) -> Iterator[Any]:
        """Yield a reply for each event, until `end` is called or it is unregistered."""
        yield from iter(listener.stream.get, None)
        with self._system.lock:
            key = (listener.task.session, listener.kind)
            if self._listeners.get(key) is listener:
                del self._listeners[key]
                listener.task.heard -= 1

    @staticmethod
    def end(listener: _Listener) -> None:
        """End the stream of a client that is gone."""
        listener.stream.put(None)

    def _add(self, listener: _Listener, taken: DAQmxErrors) -> _Listener:
        key = (listener.task.session, listener.kind)
        if key in self._listeners:
            raise DaqmxError(taken, f"This event is already registered for {listener.task.name!r}.")
        listener.acquisition = listener.task.starts
        self._listeners[key] = listener
        listener.task.heard += 1
        self._system.changed.notify_all()
        return listener

    # Firing

    def _run(self) -> None:
        with self._system.lock:
            while not self._closing:
                expected = False
                self._system.notice()
                for listener in self._listeners.values():
                    expected |= self._fire(listener)
                self._system.changed.wait(_POLL if expected else None)

    def _fire(self, listener: _Listener) -> bool:
        """Send the events since the last call; return True while the acquisition will give more."""
        task = listener.task
        if not task.running or not task.timed:
            return False
        if listener.acquisition != task.starts:
            listener.acquisition, listener.sent = task.starts, 0
        now = self._system.clock.now()
        done = task.done(now)
        happened = int(done) if listener.kind == "done" else task.count(now) // max(1, listener.every)
        for _ in range(happened - listener.sent):
            listener.stream.put(listener.reply())
            listener.total += 1
        listener.sent = max(listener.sent, happened)
        return not done


def _refuse_running(task: Task, code: DAQmxErrors) -> None:
    if task.running:
        raise DaqmxError(
            code,
            f"An event cannot be registered or unregistered while its task is running: {task.name!r}. "
            "Do so before the start.",
        )


def _refuse_signal(task: Task, signal: int) -> None:
    """Refuse the signals that a task does not have, and those that are not simulated as events."""
    served = {
        Signal.SAMPLE_CLOCK.value: task.channels and task.kind not in ("co", "ci"),
        Signal.SAMPLE_COMPLETE.value: task.channels and task.kind == "ai",
        Signal.CHANGE_DETECTION_EVENT.value: task.channels and task.kind == "di",
        Signal.COUNTER_OUTPUT_EVENT.value: task.channels and task.kind in ("co", "ci"),
    }
    if not served.get(signal):
        raise DaqmxError(
            DAQmxErrors.DA_QMX_SIGNAL_EVENT_TYPE_NOT_SUPPORTED_BY_CHAN_TYPES_OR_DEVICES_IN_TASK,
            f"DAQmx signal event type is not supported by the channel types or devices in the task "
            f"{task.name!r}: {signal}.",
        )
