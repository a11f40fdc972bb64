"""NI's own client for a device server, with the manners of the driver on this computer.

NI's client of a server differs from its client of the driver: a task cannot be closed in a callback (issue
559 of ni/nidaqmx-python), a callback in flight outlives its task, a program whose task is open does not end
while an event is registered, warnings of a start are dropped, and the names of several new channels are
guessed. A program that was written for the driver meets the driver's manners here. It needs no haploop.
"""

from __future__ import annotations

import atexit
import os
import threading
import uuid
import warnings
from collections import Counter, defaultdict
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import grpc
from nidaqmx import errors
from nidaqmx._base_interpreter import BaseEventHandler
from nidaqmx._grpc_interpreter import GrpcStubInterpreter
from nidaqmx.error_codes import DAQmxErrors

_NAME_FILES = ("ConfigureLoggingRequest", "StartNewFileRequest", "SetReadAttributeStringRequest")
_MAKE_TASKS = ("CreateTaskRequest", "LoadTaskRequest", "CreateWatchdogTimerTaskExRequest")
_LONGEST = 30.0
"""s: how long the end of a task waits for a callback that is running."""


_handled: dict[tuple[str, str], int] = {}
_here = threading.local()
settle: Callable[[], None] | None = None
"""Waits until the program has handled the events that have happened; set where time is virtual."""


def handled(task: str, kind: str) -> int | None:
    """Number of events of a `kind` ("done", "samples", "signal") whose callbacks returned; None without."""
    return _handled.get((task, kind))


def in_callback() -> bool:
    """True in the thread of a callback that is running."""
    return bool(getattr(_here, "depth", 0))


def _by_daemon(make: Callable[[], Any]) -> Any:
    """Return what `make` returns; its threads are daemons as its caller is, and let the program end."""
    made: Future[Any] = Future()

    def run() -> None:
        try:
            made.set_result(make())
        except Exception as error:
            made.set_exception(error)

    threading.Thread(target=run, name="nidaqmx registers", daemon=True).start()
    return made.result()


def _heard(stream: Any) -> Any:
    """Return a stream once the server has taken it.

    gRPC forgets one that ends before a thread of the server has begun it, and the process's tasks would stay.
    """
    stream.initial_metadata()
    return stream


def _end(stream: Any, process: int) -> None:
    """End a stream of this process, and not of the one that it was forked from.

    gRPC ends an open one when its own modules are gone, which fails aloud.
    """
    if os.getpid() == process:
        stream.cancel()


class TwinWarning(UserWarning):
    """A program has set a property from which nothing follows on the simulated card."""


class _Handler(BaseEventHandler):  # type: ignore[misc]
    """A registered event that can be ended in its own callback."""

    def __init__(self, inner: Any) -> None:
        self._inner = inner

    def close(self) -> None:
        """End the event; its thread ends by itself where this is called in it."""
        if threading.current_thread() is self._inner._thread:
            self._inner._event_stream.cancel()
        else:
            self._inner.close()


class DriverInterpreter(GrpcStubInterpreter):  # type: ignore[misc]
    """See the module."""

    def __init__(self, grpc_options: Any, keys: Mapping[str, str], lives: str | None = None) -> None:
        """`lives` is the server's stream for a process of its own, whose names of tasks are its own too."""
        self._keys, self._pid = keys, os.getpid()
        self._process: list[tuple[str, str]] = []
        if lives is not None:
            process = uuid.uuid4().hex
            self._process = [(keys["process"], process)]
            wait = grpc_options.grpc_channel.unary_stream(lives)
            self._lives = _by_daemon(lambda: _heard(wait(process.encode())))
            atexit.register(_end, self._lives, os.getpid())
        self._state = threading.Condition()
        self._running: Counter[tuple[str, int]] = Counter()
        """Callbacks that run now, by task and thread."""
        self._registered: defaultdict[str, set[object]] = defaultdict(set)
        """Callbacks of tasks that are not closed, by task."""
        self._created = threading.local()
        super().__init__(grpc_options)

    def _invoke(self, func: Any, request: Any, metadata: Any = None) -> Any:
        if self._is_parents():
            raise errors.DaqError(
                "Task specified is invalid or does not exist: it is that of this forked process's parent. "
                "Make tasks of its own.",
                DAQmxErrors.INVALID_TASK.value,
            )
        if type(request).__name__ in _MAKE_TASKS:
            metadata = [*(metadata or ()), *self._process]
        if type(request).__name__ in _NAME_FILES:
            metadata = [*(metadata or ()), (self._keys["folder"], os.fsencode(Path.cwd()))]
        if in_callback():
            metadata = [*(metadata or ()), (self._keys["in_callback"], "1")]
        if not hasattr(func, "with_call"):
            return super()._invoke(func, request, metadata)
        try:
            response, call = func.with_call(request, metadata=metadata)
        except grpc.RpcError as error:
            if error.code() == grpc.StatusCode.ALREADY_EXISTS:
                raise errors.DaqError(error.details(), DAQmxErrors.DUPLICATE_TASK.value) from None
            if error.code() == grpc.StatusCode.UNIMPLEMENTED:
                raise errors.DaqFunctionNotSupportedError(error.details()) from None
            self._handle_rpc_error(error)
            raise
        told = {entry.key: entry.value for entry in call.trailing_metadata() or ()}
        if (names := told.get(self._keys["created"])) is not None:
            self._created.names = names.decode()
        if (ignored := told.get(self._keys["ignored"])) is not None:
            warnings.warn(
                TwinWarning(f"kept, and without effect on this twin: {ignored.decode()}"), stacklevel=5
            )
        return response

    def _is_parents(self) -> bool:
        """True in a forked child: its parent's connection has no threads, and may be locked for ever."""
        return os.getpid() != self._pid

    def internal_get_last_created_chan(self) -> str:
        """Return the names of the channels that this thread's last call made."""
        return str(self._created.names)

    def start_task(self, task: Any) -> None:
        """Start a task, and warn of what the driver warns of."""
        from nidaqmx._stubs import nidaqmx_pb2 as pb  # noqa: PLC0415

        response = self._invoke(self._client.StartTask, pb.StartTaskRequest(task=task))
        self._check_for_error_from_response(response.status)

    def clear_task(self, task: Any) -> None:
        """Clear a task once its callbacks in other threads have returned; a forked child, none of its
        parent's.
        """
        own = threading.get_ident()
        if self._is_parents():
            return
        if settle is not None and not in_callback():
            settle()

        def returned() -> bool:
            return not any(
                n for (name, thread), n in self._running.items() if name == task.name and thread != own
            )

        with self._state:
            self._registered.pop(task.name, None)
            self._state.wait_for(returned, _LONGEST)
        super().clear_task(task)

    def stop_task(self, task: Any) -> None:
        """Stop a task, once the events until now are handled where time is virtual."""
        if settle is not None and not in_callback() and not self._is_parents():
            settle()
        super().stop_task(task)

    def register_done_event(self, task: Any, options: int, callback_function: Any, callback_data: Any) -> Any:
        """See NI's."""
        watched = self._watched(task, "done", callback_function)
        register = super().register_done_event
        return _Handler(_by_daemon(lambda: register(task, options, watched, callback_data)))

    def register_every_n_samples_event(
        self, task: Any, type_: int, n_samples: int, options: int, callback_function: Any, callback_data: Any
    ) -> Any:
        """See NI's."""
        watched = self._watched(task, "samples", callback_function)
        register = super().register_every_n_samples_event
        return _Handler(_by_daemon(lambda: register(task, type_, n_samples, options, watched, callback_data)))

    def register_signal_event(
        self, task: Any, signal_id: int, options: int, callback_function: Any, callback_data: Any
    ) -> Any:
        """See NI's."""
        watched = self._watched(task, "signal", callback_function)
        register = super().register_signal_event
        return _Handler(_by_daemon(lambda: register(task, signal_id, options, watched, callback_data)))

    def _watched(self, task: Any, kind: str, callback: Callable[..., Any]) -> Callable[..., Any]:
        """Return `callback`, known to run while it does, and not called for a closed task."""
        key, own = task.name, object()
        with self._state:
            self._registered[key].add(own)
        _handled[key, kind] = 0

        def run(*given: Any) -> Any:
            mine = (key, threading.get_ident())
            with self._state:
                closed = own not in self._registered.get(key, ())
                self._running[mine] += not closed
            _here.depth = getattr(_here, "depth", 0) + 1
            try:
                return 0 if closed else callback(*given)
            finally:
                _here.depth -= 1
                with self._state:
                    self._running[mine] -= not closed
                    _handled[key, kind] += 1
                    self._state.notify_all()

        return run
