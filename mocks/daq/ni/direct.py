"""A channel of gRPC that calls the server's handlers in the caller's own thread, which is faster.

It has what nidaqmx's client uses of a channel. Streams of events go by the real channel.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from types import SimpleNamespace
from typing import Any, NoReturn

import grpc

Metadata = Sequence[tuple[str, str | bytes]]


class DirectChannel:
    """See the module. `service` gives the handler of a method; `channel` is the real one."""

    def __init__(self, service: Callable[[Any], Any], channel: Any) -> None:
        self._service, self._channel = service, channel
        self._calls: dict[str, _Direct] = {}
        """By method: every task makes a client of all 451."""

    def unary_unary(
        self, method: str, request_serializer: Any = None, response_deserializer: Any = None, **_: Any
    ) -> Any:
        """Return what calls `method`."""
        if method not in self._calls:
            find = partial(self._service, SimpleNamespace(method=method))
            self._calls[method] = _Direct(find, request_serializer, response_deserializer)
        return self._calls[method]

    def unary_stream(self, method: str, *how: Any, **more: Any) -> Any:
        """Return what calls `method`, by gRPC."""
        return self._channel.unary_stream(method, *how, **more)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._channel, name)


class _Direct:
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


class _Context:
    """What handlers use of gRPC's context, and clients of a call."""

    def __init__(self, metadata: Metadata) -> None:
        self._sent, self._trailing = _entries(metadata), _entries(())

    def invocation_metadata(self) -> list[SimpleNamespace]:
        return self._sent

    def trailing_metadata(self) -> list[SimpleNamespace]:
        return self._trailing

    def set_trailing_metadata(self, metadata: Metadata) -> None:
        self._trailing = _entries(metadata)

    def is_active(self) -> bool:
        return True

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
