"""Connections that send nothing: closed, so that they use up neither memory nor the listening socket."""

from __future__ import annotations

import asyncio
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

from .bodies import PATIENCE


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
