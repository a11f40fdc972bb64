"""The port at which a server listens, and threads for the calls that it serves."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Executor, Future
from contextlib import suppress
from queue import SimpleQueue
from typing import Any

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
