"""NI's library on a line that a tape can listen to or answer: nidaqmx chooses its interpreter in one place.

`nidaqmx` has no public way to be given an interpreter, so that place is replaced, once and only in a program
that uses a tape; calls without a tape go on as before.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import grpc
from nidaqmx import utils
from nidaqmx.errors import (
    DaqError,
    DaqFunctionNotSupportedError,
    DaqNotFoundError,
    DaqNotSupportedError,
    DaqReadError,
    DaqWriteError,
    RpcError,
)

from ..tape import Failure, Proxied, TapedLine

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
