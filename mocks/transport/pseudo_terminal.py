"""A device file in front of a wire over TCP, for a program that opens a serial port by its path."""

from __future__ import annotations

import os
import select
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from ...base.errors import ConfigurationError
from ...base.threads import Flag

_LOOK = 0.1
"""Interval of looks for the end (s)."""


@contextmanager
def pseudo_terminal(host: str, port: int) -> Iterator[str]:
    """Serve a wire at a device file; yield its path. Raises ConfigurationError on Windows, which has none."""
    if os.name == "nt":
        raise ConfigurationError(
            "Windows has no pseudo-terminals: open the socket:// address, or run the program by this command."
        )
    import tty  # noqa: PLC0415

    ours, theirs = os.openpty()
    tty.setraw(theirs)
    ended = Flag()
    with socket.create_connection((host, port)) as link:
        thread = threading.Thread(target=_copy, args=(ours, link, ended), daemon=True)
        thread.start()
        try:
            # `theirs` stays open here: without anybody at it, reading `ours` fails.
            yield os.ttyname(theirs)
        finally:
            ended.set()
            thread.join()
            os.close(theirs)
            os.close(ours)


def _copy(terminal: int, link: socket.socket, ended: Flag) -> None:
    """Copy bytes in both directions."""
    both: list[int | socket.socket] = [terminal, link]
    with suppress(OSError):
        while not ended.is_set():
            ready, _, _ = select.select(both, [], [], _LOOK)
            if terminal in ready:
                link.sendall(os.read(terminal, 1 << 16))
            if link in ready:
                answer = link.recv(1 << 16)
                if not answer:
                    return
                os.write(terminal, answer)
