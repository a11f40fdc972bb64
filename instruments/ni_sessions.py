"""NI-DAQmx tasks of this computer's driver, or of a device server that outlives its clients.

The driver clears the tasks of a program that ends, however it ends. A device server keeps them, and
their cards reserved with them (-50103). So tasks on a server have names, by which the next program on
the same computer finds and clears what a killed one has left: the rig's lock says that it has ended.
"""

from __future__ import annotations

import socket
from collections.abc import Iterable
from contextlib import suppress
from typing import Any

import grpc
import nidaqmx
from nidaqmx import GrpcSessionOptions
from nidaqmx.errors import Error as NiError
from nidaqmx.grpc_session_options import SessionInitializationBehavior
from nidaqmx.system import System

__all__ = ["Sessions"]


class Sessions:
    """Makes tasks on the device server at the other end of `channel`, or here when it is None."""

    def __init__(self, channel: grpc.Channel | None) -> None:
        self._channel = channel

    def system(self) -> System:
        """What knows the devices."""
        return System.local() if self._channel is None else System.remote(self._options(""))

    def task(self, purpose: str) -> Any:
        """A new task; a context that clears it. Of one purpose there is one task at a time."""
        if self._channel is None:
            return nidaqmx.Task()
        name = _name(purpose)
        return nidaqmx.Task(
            name, grpc_options=self._options(name, SessionInitializationBehavior.INITIALIZE_SERVER_SESSION)
        )

    def clear_left(self, purposes: Iterable[str]) -> None:
        """Clear the tasks of these purposes that another program has left on the server."""
        if self._channel is None:
            return
        for name in map(_name, purposes):
            # Refused where there is none, as there should be.
            with suppress(NiError):
                behaviour = SessionInitializationBehavior.ATTACH_TO_SERVER_SESSION
                nidaqmx.Task(name, grpc_options=self._options(name, behaviour)).close()

    def close(self) -> None:
        """Let go of the server. May be called again."""
        if self._channel is not None:
            self._channel.close()

    def _options(
        self, name: str, behaviour: SessionInitializationBehavior = SessionInitializationBehavior.AUTO
    ) -> GrpcSessionOptions:
        return GrpcSessionOptions(self._channel, name, initialization_behavior=behaviour)


def _name(purpose: str) -> str:
    # Another computer's tasks are its own: its lock is not seen here.
    return f"haploop on {socket.gethostname()}: {purpose}"
