"""NI-DAQmx tasks on this computer's driver, or on a device server that outlives its clients.

The driver clears the tasks of a program that ends, however it ends. A device server keeps them, and
their cards reserved with them (-50103). So tasks on a server have names, by which the next program on
the same computer finds and clears those of a killed one: the rig's lock proves that it has ended.
"""

from __future__ import annotations

import logging
import socket
from collections.abc import Callable, Iterable
from contextlib import suppress
from typing import Any, Self

import grpc
import nidaqmx
from nidaqmx import GrpcSessionOptions, utils
from nidaqmx.error_codes import DAQmxErrors
from nidaqmx.errors import (
    DaqError,
    DaqFunctionNotSupportedError,
    DaqNotFoundError,
    DaqNotSupportedError,
    DaqReadError,
    DaqWriteError,
    RpcError,
)
from nidaqmx.errors import Error as NiError
from nidaqmx.grpc_session_options import SessionInitializationBehavior
from nidaqmx.system import System

from ...base.clock import RealClock
from ...base.errors import InstrumentError
from ...base.signals import uninterrupted
from ..tape import Failure, Proxied, TapedLine, taped_line

# NI's library on a line that a tape can listen to or answer: nidaqmx chooses its interpreter in one place.
#
# `nidaqmx` has no public way to be given an interpreter, so that place is replaced, once and only in a
# program that uses a tape; calls without a tape go on as before.

_FAILURES = (
    Failure(DaqReadError, lambda e: (str(e), int(e.error_code), int(e.samps_per_chan_read))),
    Failure(DaqWriteError, lambda e: (str(e), int(e.error_code), int(e.samps_per_chan_written))),
    Failure(DaqError, lambda e: (str(e), int(e.error_code))),
    Failure(
        RpcError,
        lambda e: (e.rpc_code.name, str(e)),
        lambda code, said: RpcError(getattr(grpc.StatusCode, code, grpc.StatusCode.UNKNOWN), said),
    ),
    Failure(NotImplementedError),  # which the library catches
    Failure(DaqNotFoundError),
    Failure(DaqNotSupportedError),
    Failure(DaqFunctionNotSupportedError),
)


class _Chosen:
    """In place of gRPC options: an interpreter that is there already."""

    session_name = ""

    def __init__(self, interpreter: Any) -> None:
        self.interpreter = interpreter


def interpreter_on(line: TapedLine, options: Callable[[], Any], hidden: dict[str, str]) -> Any:
    """What is to be given to nidaqmx as gRPC options, to call through `line`.

    `options` makes the real ones, None for the driver on this computer; a player makes none.
    """
    _install()
    made: list[Any] = []
    # It is no answer: a recorder would keep one for each task of a night.
    line.call("interpreter", lambda: made.append(_before(options())), failures=_FAILURES)
    real = made[0] if made else None
    return _Chosen(
        Proxied(line, real, failures=_FAILURES, hidden=hidden, fills=lambda name: name.startswith("read_"))
    )


_before = utils._select_interpreter


def _install() -> None:
    """Let nidaqmx take an interpreter that was chosen. May be called again."""
    global _before  # noqa: PLW0603
    if utils._select_interpreter is _select:
        return
    _before = utils._select_interpreter
    utils._select_interpreter = _select


def _select(grpc_options: Any = None, interpreter: Any = None) -> Any:
    if isinstance(grpc_options, _Chosen):
        return grpc_options.interpreter
    return _before(grpc_options, interpreter)


# grpc prints a traceback for an answer that it cannot parse, besides raising the error caught here.
logging.getLogger("grpc").addHandler(logging.NullHandler())

_CONNECT = 10.0
"""Time for a device server to answer (s)."""
_LOOK = 0.25
"""Longest time between two looks of grpc for a server, and a little more (s)."""
_SLICE = 0.1
"""Longest delay of Ctrl-C meanwhile (s)."""
_SILENCE = 15.0
"""Time for a device server to answer a call, beyond what the call itself waits (s)."""


class _Deadline(grpc.UnaryUnaryClientInterceptor):  # type: ignore[misc]
    """Sets a deadline on each call: nidaqmx sets none, and would wait for ever for a silent server.

    A call that waits for samples, or for the end of a task, says how long: the server has that time and the
    usual one for its answer.

    Ctrl-C comes after the call: within, it leaves grpc's lock locked, and every later call hangs.
    """

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds

    def intercept_unary_unary(self, continuation: Any, details: Any, request: Any) -> Any:
        waits = getattr(request, "timeout", 0.0) or getattr(request, "time_to_wait", 0.0)
        seconds = self._seconds + max(0.0, waits if isinstance(waits, float) else 0.0)
        with uninterrupted():
            return continuation(details._replace(timeout=seconds), request)


class _Version(grpc.UnaryUnaryClientInterceptor):  # type: ignore[misc]
    """Asks for the driver's version once: nidaqmx asks in three calls for each task."""

    def __init__(self) -> None:
        self._known: dict[bytes, Any] = {}

    def intercept_unary_unary(self, continuation: Any, details: Any, request: Any) -> Any:
        if not str(details.method).endswith("/GetSystemInfoAttributeUInt32"):
            return continuation(details, request)
        key = request.SerializeToString()
        if key not in self._known:
            outcome = continuation(details, request)
            if outcome.code() is not grpc.StatusCode.OK:
                return outcome
            self._known[key] = outcome
        return self._known[key]


class _Calls(grpc.Channel):  # type: ignore[misc]
    """A channel that makes the callable of each method once: nidaqmx makes all 448 again for each task."""

    def __init__(self, channel: grpc.Channel) -> None:
        self._channel = channel
        self._made: dict[str, Any] = {}

    def unary_unary(self, method: str, *how: Any, **more: Any) -> Any:
        if method not in self._made:
            self._made[method] = self._channel.unary_unary(method, *how, **more)
        return self._made[method]

    def unary_stream(self, *how: Any, **more: Any) -> Any:
        return self._channel.unary_stream(*how, **more)

    def stream_unary(self, *how: Any, **more: Any) -> Any:
        return self._channel.stream_unary(*how, **more)

    def stream_stream(self, *how: Any, **more: Any) -> Any:
        return self._channel.stream_stream(*how, **more)

    def subscribe(self, *how: Any, **more: Any) -> None:
        self._channel.subscribe(*how, **more)

    def unsubscribe(self, *how: Any, **more: Any) -> None:
        self._channel.unsubscribe(*how, **more)

    def close(self) -> None:
        self._channel.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Sessions:
    """Makes tasks on the device server at the other end of `channel`, or here when it is None."""

    def __init__(self, channel: grpc.Channel | None, line: TapedLine | None = None) -> None:
        self._channel, self._line = channel, line or TapedLine(None, "")
        self._at_server = channel is not None

    @classmethod
    def at(cls, server: str | None) -> Self:
        """Use the device server at host:port, or this computer. Raises InstrumentError without an answer."""
        line = taped_line()
        channel = line.call("connect", lambda: cls._connected(server), failures=(Failure(InstrumentError),))
        made = cls(None if line.playing else channel, line)
        made._at_server = channel is not None
        return made

    @staticmethod
    def _connected(server: str | None) -> grpc.Channel | None:
        if server is None:
            return None
        plain, channel = _connecting(server, _SILENCE)
        ready: Any = None
        try:
            with uninterrupted():
                ready = grpc.channel_ready_future(plain)
            if not any(_is_ready(ready) for _ in range(round(_CONNECT / _SLICE))):
                raise InstrumentError(
                    f"No NI device server answers at {server}: start it, or correct server in [daq]."
                )
        except BaseException:
            # Ctrl-C too: a channel that is still connecting keeps Python from ending.
            with uninterrupted():
                if ready is not None:
                    ready.cancel()
                    # The thread that looks for it ends first: for a closed channel it prints a traceback.
                    RealClock().sleep(_LOOK)
                channel.close()
            raise
        return channel

    @classmethod
    def asking(cls, server: str | None, patience: float) -> Self:
        """As `at`, but a call fails at once where nobody answers; `patience` is the time to answer it (s)."""
        return cls(None if server is None else _connecting(server, patience)[1])

    def system(self) -> System:
        """The system, which lists the devices."""
        return System.local() if self._is_local else System.remote(self._options(""))

    def task(self, purpose: str) -> Any:
        """Create a task, a context that clears it. Each purpose has one task at a time."""
        if not self._at_server:
            return nidaqmx.Task() if self._is_local else nidaqmx.Task(grpc_options=self._options(""))
        try:
            return self._new(_name(purpose))
        except DaqError as error:
            if error.error_type is not DAQmxErrors.DUPLICATE_TASK:
                raise
        # The answer to an earlier call was lost, and with it the handle of the created task.
        self.clear_left([purpose])
        return self._new(_name(purpose))

    def clear_left(self, purposes: Iterable[str]) -> None:
        """Clear the tasks of these purposes that another program has left on the server."""
        if not self._at_server:
            return
        for name in map(_name, purposes):
            # Refused where none is left, which is the normal case.
            with suppress(NiError):
                behaviour = SessionInitializationBehavior.ATTACH_TO_SERVER_SESSION
                nidaqmx.Task(name, grpc_options=self._options(name, behaviour)).close()

    def close(self) -> None:
        """Disconnect from the server. May be called again."""
        if self._channel is not None:
            self._channel.close()

    def _new(self, name: str) -> Any:
        behaviour = SessionInitializationBehavior.INITIALIZE_SERVER_SESSION
        return nidaqmx.Task(name, grpc_options=self._options(name, behaviour))

    def _options(
        self, name: str, behaviour: SessionInitializationBehavior = SessionInitializationBehavior.AUTO
    ) -> Any:
        def options() -> GrpcSessionOptions | None:
            if self._channel is None:
                return None
            return GrpcSessionOptions(self._channel, name, initialization_behavior=behaviour)

        if not self._line.taped:
            return options()
        return interpreter_on(self._line, options, {_name(""): "haploop: "})

    @property
    def _is_local(self) -> bool:
        """True for NI's driver on this computer, without a tape."""
        return not self._at_server and not self._line.taped


def _connecting(server: str, patience: float) -> tuple[grpc.Channel, grpc.Channel]:
    """A channel to a server, plain and as nidaqmx uses it: `patience` is the time for each answer (s)."""
    plain = grpc.insecure_channel(
        server, options=[("grpc.max_receive_message_length", -1), ("grpc.enable_http_proxy", 0)]
    )
    return plain, _Calls(grpc.intercept_channel(plain, _Version(), _Deadline(patience)))


def _is_ready(ready: Any) -> bool:
    """Wait for a slice of time until a channel is ready."""
    with uninterrupted():
        try:
            ready.result(timeout=_SLICE)
        except grpc.FutureTimeoutError:
            return False
        return True


def _name(purpose: str) -> str:
    # Tasks of another computer are left alone: its lock is not visible here.
    return f"haploop on {socket.gethostname()}: {purpose}"
