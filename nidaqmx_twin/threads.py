"""The port at which a server listens, threads for its calls, and calls in the caller's own thread."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future
from contextlib import suppress
from functools import partial
from queue import SimpleQueue
from types import SimpleNamespace
from typing import Any, NoReturn

import grpc

HOST = "127.0.0.1"


class Threads(Executor):
    """Runs each call in a thread, of which there are as many as calls at a time.

    Those of the standard library's executor end before the rig of the same program is closed at its end.
    """

    def __init__(self) -> None:
        self._calls: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._idle = threading.Semaphore(0)
        self._threads: list[threading.Thread] = []

    def submit(self, call: Callable[..., Any], /, *args: Any, **named: Any) -> Future[Any]:
        """See `Executor.submit`."""
        future: Future[Any] = Future()

        def run() -> None:
            try:
                future.set_result(call(*args, **named))
            except BaseException as error:
                future.set_exception(error)

        self._calls.put(run)
        if not self._idle.acquire(blocking=False):
            thread = threading.Thread(target=self._serve, name="NI wire", daemon=True)
            # At a program's end none can be started (Python 3.12): then one that there is will run the call.
            with suppress(RuntimeError):
                thread.start()
                self._threads.append(thread)
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """See `Executor.shutdown`: every call that was submitted is run first."""
        for _ in self._threads:
            self._calls.put(None)
        for thread in self._threads:
            thread.join()

    def _serve(self) -> None:
        while (run := self._calls.get()) is not None:
            run()
            self._idle.release()


class Listener:
    """A port at which gRPC serves. Raises RuntimeError for one that is in use."""

    def __init__(self, port: int) -> None:
        self._pool = Threads()
        options = [
            ("grpc.so_reuseport", 0),
            ("grpc.max_receive_message_length", -1),
            ("grpc.max_send_message_length", -1),
        ]
        self._server = grpc.server(self._pool, options=options)
        self.port = int(self._server.add_insecure_port(f"{HOST}:{port}"))

    def start(self, service: Any) -> None:
        """Serve by a handler of gRPC."""
        self._server.add_generic_rpc_handlers((service,))
        self._server.start()

    def close(self) -> None:
        """Stop listening."""
        self._server.stop(grace=0.2).wait()
        self._pool.shutdown()


# A channel of gRPC that calls the server's handlers in the caller's own thread, and needs no gRPC.
#
# It is several times as fast, and leaves a program free to fork, which one with a server of gRPC is not (grpc
# issue 17093). It has what nidaqmx's client uses of a channel.

Metadata = Sequence[tuple[str, str | bytes]]


class DirectChannel:
    """See the module. `service` gives the handler of a method."""

    def __init__(self, service: Callable[[Any], Any]) -> None:
        self._service = service
        self._calls: dict[str, _Unary | _Streaming] = {}
        """By method: every task makes a client of all 451."""

    def unary_unary(
        self, method: str, request_serializer: Any = None, response_deserializer: Any = None, **_: Any
    ) -> Any:
        """Return what calls `method`."""
        if method not in self._calls:
            find = partial(self._service, SimpleNamespace(method=method))
            self._calls[method] = _Unary(find, request_serializer, response_deserializer)
        return self._calls[method]

    def unary_stream(self, method: str, request_serializer: Any = None, *_: Any, **__: Any) -> Any:
        """Return what opens the stream `method`."""
        if method not in self._calls:
            find = partial(self._service, SimpleNamespace(method=method))
            self._calls[method] = _Streaming(find, request_serializer)
        return self._calls[method]


class _Unary:
    """One method; its handler is made at the first call."""

    def __init__(self, find: Callable[[], Any], serialize: Any, deserialize: Any) -> None:
        self._find, self._serialize, self._deserialize = find, serialize, deserialize
        self._handler: Any = None

    def __call__(self, request: Any, timeout: float | None = None, metadata: Any = None) -> Any:
        return self.with_call(request, timeout, metadata)[0]

    def with_call(self, request: Any, timeout: float | None = None, metadata: Any = None) -> tuple[Any, Any]:
        context, handler = _Context(metadata or ()), self._handler or self._find()
        self._handler = handler
        # As bytes on the way, so that neither side keeps what the other one changes.
        asked = handler.request_deserializer(self._serialize(request))
        answer = handler.unary_unary(asked, context)
        return self._deserialize(handler.response_serializer(answer)), context


class _Streaming:
    """One method whose replies are a stream."""

    def __init__(self, find: Callable[[], Any], serialize: Any) -> None:
        self._find, self._serialize = find, serialize

    def __call__(self, request: Any, timeout: float | None = None, metadata: Any = None) -> _Stream:
        handler = self._find()
        return _Stream(
            handler, handler.request_deserializer(self._serialize(request)), _Context(metadata or ())
        )


class _Stream:
    """Replies of a stream, made in the thread that asks for them. Raises grpc.RpcError when it is refused."""

    def __init__(self, handler: Any, request: Any, context: _Context) -> None:
        self._replies, self._context = handler.unary_stream(request, context), context

    def __iter__(self) -> Iterator[Any]:
        return iter(self._replies)

    def initial_metadata(self) -> list[SimpleNamespace]:
        return _entries(())

    def done(self) -> bool:
        return not self._context.is_active()

    def exception(self) -> None:
        """None: what is refused has no stream."""

    def cancel(self) -> None:
        self._context.end()


class _Context:
    """What handlers use of gRPC's context, and clients of a call."""

    def __init__(self, metadata: Metadata) -> None:
        self._sent, self._trailing = _entries(metadata), _entries(())
        self._at_end: list[Callable[[], object]] = []
        self._active = True

    def invocation_metadata(self) -> list[SimpleNamespace]:
        return self._sent

    def trailing_metadata(self) -> list[SimpleNamespace]:
        return self._trailing

    def set_trailing_metadata(self, metadata: Metadata) -> None:
        self._trailing = _entries(metadata)

    def is_active(self) -> bool:
        return self._active

    def add_callback(self, act: Callable[[], object]) -> bool:
        self._at_end.append(act)
        return self._active

    def send_initial_metadata(self, metadata: Metadata) -> None:
        """Nothing: who has the stream knows that the call is served."""

    def end(self) -> None:
        self._active = False
        for act in self._at_end:
            act()

    def abort(self, code: Any, details: str) -> NoReturn:
        raise _RefusedError(code, details, self._trailing)


class _RefusedError(grpc.RpcError):  # type: ignore[misc]
    """As gRPC's error of a call that the server has refused."""

    def __init__(self, code: Any, details: str, trailing: list[SimpleNamespace]) -> None:
        super().__init__(details)
        self._code, self._details, self._trailing = code, details, trailing

    def code(self) -> Any:
        return self._code

    def details(self) -> str:
        return self._details

    def trailing_metadata(self) -> list[SimpleNamespace]:
        return self._trailing


def _entries(metadata: Metadata) -> list[SimpleNamespace]:
    return [SimpleNamespace(key=key, value=value) for key, value in metadata]
