"""Run the console: worker, application and socket, until Ctrl-C; connections that send nothing are closed."""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from ...base.errors import ConfigurationError
from ...instruments import RigFile
from ...instruments.driver import Mode
from ...terminal.progress import note
from ..data_folder import DataFolder
from ..worker import WorkerLink, free_tape, serving, start_worker
from .application import application
from .follower import Follower, LiveScope
from .security import LARGEST, PATIENCE, Access


class ImpatientProtocol(H11Protocol):
    """HTTP that closes a connection on which no request was made for up to twice `PATIENCE`.

    uvicorn itself limits only the time between an answer and the next request's first byte.
    """

    _looked_at: Any = None
    _look: asyncio.TimerHandle | None = None

    def connection_made(self, transport: Any) -> None:
        """See `asyncio.Protocol`."""
        super().connection_made(transport)
        self._look = self.loop.call_later(PATIENCE, self._close_if_silent)

    def connection_lost(self, exc: Exception | None) -> None:
        """See `asyncio.Protocol`."""
        if self._look is not None:
            self._look.cancel()
        super().connection_lost(exc)

    def _close_if_silent(self) -> None:
        if self.transport.is_closing() or self.transport.get_protocol() is not self:
            return  # a WebSocket's now, which has a deadline of its own
        cycle = self.cycle
        answered = cycle is None or cycle.response_complete
        if answered and (cycle is None or cycle is self._looked_at):
            self.transport.close()
            return
        self._looked_at = cycle if answered else None
        self._look = self.loop.call_later(PATIENCE, self._close_if_silent)


def serve_console(
    rig: str,
    file: RigFile,
    simulate: Mode | None,
    data: DataFolder,
    address: str,
    port: int,
    ready: Callable[[Access], object],
    virtual_time: bool = False,
    tape: Path | None = None,
) -> None:
    """Serve the console of a rig until a stop signal, and call `ready` when its address can be opened.

    A stop signal reaches the safe state and ends the worker; beside another server of the rig, it stops what
    was begun here only. A server that is killed leaves the worker running, and the next one takes it over.
    The worker's sessions are recorded on `tape`, those of one that follows it on a numbered tape beside it.
    Raises ConfigurationError for an address or port that cannot be used, and what `serving` and
    `start_worker` raise.
    """

    def worker() -> WorkerLink:
        return start_worker(rig, file, simulate, data, virtual_time, free_tape(tape))

    with _bound(address, port) as listener, ExitStack() as stack:
        access = Access(address, listener.getsockname()[1])
        # Before the worker is found, so that no other server ends it in between.
        elsewhere = stack.enter_context(serving(file, simulate))
        scope = LiveScope(file, simulate)
        follower = Follower(worker(), worker, scope)
        try:
            config = uvicorn.Config(
                application(access, follower, scope, data),
                log_level="error",
                access_log=False,
                http=ImpatientProtocol,
                ws="websockets-sansio",
                ws_max_size=LARGEST,
                timeout_graceful_shutdown=1,
            )
            logging.getLogger("uvicorn.error").addFilter(_of_a_fault)
            ready(access)
            uvicorn.Server(config).run(sockets=[listener])
        finally:
            # Not marked any more: of two that end at once, one at least sees no other.
            stack.close()
            if follower.leave(elsewhere()):
                note(
                    "The console's worker goes on, because another `haploop serve` of this rig runs. "
                    "`haploop serve --stop` ends it."
                )


def _of_a_fault(record: logging.LogRecord) -> bool:
    """Whether a line of the log is one of a fault: not of pages that a stop leaves without their answer."""
    cut = record.exc_info is not None and isinstance(record.exc_info[1], asyncio.CancelledError)
    return not cut and "graceful shutdown exceeded" not in record.getMessage()


def _bound(address: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    try:
        return socket.create_server((address, port), family=family)
    except OSError as error:
        raise ConfigurationError(
            f"The console cannot listen on {address}, port {port} ({error.strerror or error}): choose "
            "another with --port, or 0 for a free one."
        ) from None
