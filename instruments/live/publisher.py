"""Publish a rig's blocks, encoded as frames, to other programs of the same user, on a loopback socket.

A thread accepts connections, and each connection has a thread and a tap of its own. A client that reads
slowly, stops or dies delays only its own thread, and its tap drops blocks; a recording shares only the tap's
queue with it. The socket's port and the token that a client must send are in a file of the rig's state folder
that only its owner can read.
"""

from __future__ import annotations

import hmac
import json
import os
import secrets
import select
import socket
import struct
import threading
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ...base.clock import RealClock
from ...base.errors import DataError, InstrumentError
from ...base.files import os_error_text, private_files, whole_file
from ...base.threads import Closing, Flag
from ..sensors import Sensors
from ..vibrometer import QUANTITIES, Quantity
from .tap import Feed, LiveBlock, Run

# Frames: the byte encoding of live blocks. Pure: no socket, no clock.
#
# A frame is a magic number, the lengths of its two parts, a JSON header, and the volts as little-endian
# float64, channel by channel. Other bytes, and frames larger than any block, raise DataError.

_PREFIX = struct.Struct("<4sIQ")
_MAGIC = b"HLV1"
_LARGEST_HEADER = 1 << 20
_LARGEST_VOLTS = 1 << 30

PREFIX = _PREFIX.size
"""Length of a frame's prefix (bytes), for `lengths_of`."""
TOKEN = 64
"""Length of the token that a client sends before it receives any frame (bytes)."""


def frame_of(block: LiveBlock, dropped: int) -> tuple[bytes, memoryview]:
    """Encode prefix and header, and the volts, not copied. `dropped` blocks are missing before this one."""
    run = block.run
    header = {
        "rig": run.rig,
        "simulated": run.simulated,
        "number": run.number,
        "doing": run.doing,
        "about": run.about,
        "channels": run.channels,
        "rate_hz": run.rate_hz,
        "sensors": run.sensors.model_dump(mode="json"),
        "laser": run.laser,
        "first": block.first,
        "samples": block.end - block.first,
        "overload": [bool(flag) for flag in block.overload],
        "dropped": dropped,
    }
    text = json.dumps(header).encode()
    volts = np.ascontiguousarray(block.volts, dtype="<f8")
    return _PREFIX.pack(_MAGIC, len(text), volts.nbytes) + text, volts.reshape(-1).view(np.uint8).data


def lengths_of(prefix: bytes) -> tuple[int, int]:
    """Lengths of the header and of the volts (bytes). Raises DataError."""
    magic, header, volts = _PREFIX.unpack(prefix)
    if magic != _MAGIC or header > _LARGEST_HEADER or volts > _LARGEST_VOLTS:
        raise DataError(_foreign("its prefix is not one of haploop's"))
    return header, volts


def header_of(text: bytes) -> tuple[dict[str, Any], Run]:
    """Decode the header of a frame, and the run that it describes. Raises DataError."""
    try:
        header = json.loads(text)
        laser = header["laser"]
        run = Run(
            str(header["rig"]),
            bool(header["simulated"]),
            str(header["doing"]),
            str(header["about"]),
            tuple(str(name) for name in header["channels"]),
            float(header["rate_hz"]),
            Sensors.model_validate(header["sensors"]),
            None if laser is None else _laser(laser),
            int(header["number"]),
        )
        for key in ("first", "samples", "dropped"):
            if int(header[key]) < 0:
                raise ValueError(key)
        if len(header["overload"]) != len(run.channels) or not 0 < run.rate_hz < float("inf"):
            raise ValueError("overload")
    except (ArithmeticError, LookupError, StopIteration, TypeError, ValueError, RecursionError) as error:
        raise DataError(_foreign(f"its header cannot be read ({type(error).__name__})")) from None
    return header, run


def _laser(told: Any) -> tuple[str, float, Quantity]:
    """Raises ValueError, or another error of a wrong shape."""
    channel, scale, name = told
    return str(channel), float(scale), next(q for q in QUANTITIES if q == name)


def volts_of(header: dict[str, Any], run: Run, volts: bytes | npt.NDArray[np.uint8]) -> LiveBlock:
    """Decode the block of a frame. Raises DataError when the number of volts is not the header's."""
    shape = (len(run.channels), int(header["samples"]))
    size = len(volts)
    if size != 8 * shape[0] * shape[1]:
        raise DataError(_foreign(f"it has {size} bytes of volts for {shape[0]} x {shape[1]} samples"))
    array = np.frombuffer(volts, dtype="<f8").reshape(shape).astype(np.float64, copy=False)
    return LiveBlock(run, int(header["first"]), array, np.array(header["overload"], dtype=np.bool_))


def _foreign(why: str) -> str:
    return (
        f"What the live address sent is no block ({why}): use the same version of haploop in both programs."
    )


ADDRESS_FILES = "live-*.json"
"""Names of the address files in a state folder."""

WAITING_FILES = "waiting-*.txt"
"""Names of files that hold the name of a rig, of viewers that wait for it to be published."""
_GREETING = 2.0
"""Time for waiting viewers to connect (s)."""
_MOST_CLIENTS = 8
_IDLE = 0.25
"""Interval at which a connection without blocks is tested for a client that has gone (s)."""
_TOKEN_DEADLINE = 2.0
"""Time for a client to send its token (s)."""
_CAPACITY = 64
"""Most blocks that wait for one client."""


class Publisher(Closing):
    """Publishes a feed while its context lasts. Raises InstrumentError when it cannot begin."""

    def __init__(self, feed: Feed, rig: str, folder: Path) -> None:
        self._feed, self._rig = feed, rig
        self._closing = Flag()
        self._token = secrets.token_hex(TOKEN // 2)
        self._clients: set[socket.socket] = set()
        self._changing = threading.Lock()
        self.path = folder / f"live-{os.getpid()}-{secrets.token_hex(4)}.json"
        """The address file."""
        try:
            self._listener = socket.create_server(("127.0.0.1", 0), backlog=_MOST_CLIENTS)
        except OSError as error:
            raise InstrumentError(
                f"No live view: a loopback socket cannot be opened ({os_error_text(error)})."
            ) from None
        self.port: int = self._listener.getsockname()[1]
        try:
            said = {"rig": rig, "pid": os.getpid(), "port": self.port, "token": self._token}
            with private_files(), whole_file(self.path) as part:
                part.write_text(json.dumps(said), encoding="utf-8")
        except OSError as error:
            self._listener.close()
            raise InstrumentError(
                f"No live view: {self.path} cannot be written ({os_error_text(error)})."
            ) from None
        self._thread = threading.Thread(target=self._accept, name="haploop-live", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End every connection and remove the address file. May be called again."""
        if self._closing.is_set():
            return
        self._closing.set()
        with suppress(OSError):
            self.path.unlink()
        # Connecting ends the wait in `accept`; closing the listener does not do so on every system.
        with suppress(OSError):
            socket.create_connection(("127.0.0.1", self.port), timeout=0.1).close()
        self._thread.join(1.0)
        self._listener.close()
        with self._changing:
            for link in self._clients:
                with suppress(OSError):
                    link.shutdown(socket.SHUT_RDWR)

    def greet(self) -> None:
        """Wait, for 2 s at most, until viewers that were waiting for this rig are connected.

        A simulated rig measures faster than a viewer connects, which would miss the beginning.
        """
        clock = RealClock()
        until = clock.now() + _GREETING
        waiting = [path for path in self.path.parent.glob(WAITING_FILES) if self._is_meant(path)]
        while any(path.exists() for path in waiting) or self._feed.tapped < len(waiting):
            if clock.now() > until:
                for path in waiting:  # of a program that was killed
                    with suppress(OSError):
                        path.unlink(missing_ok=True)
                return
            clock.sleep(0.01)

    def _is_meant(self, path: Path) -> bool:
        try:
            return path.read_text(encoding="utf-8") == self._rig
        except (OSError, ValueError):
            return False

    def _accept(self) -> None:
        while not self._closing.is_set():
            try:
                link, _ = self._listener.accept()
            except OSError:
                # For example out of file descriptors: the wait keeps the loop from spinning.
                self._closing.wait(_IDLE)
                continue
            with self._changing:
                full = len(self._clients) >= _MOST_CLIENTS or self._closing.is_set()
                if not full:
                    self._clients.add(link)
            if full:
                link.close()
                continue
            try:
                threading.Thread(
                    target=self._serve, args=(link,), name="haploop-live-client", daemon=True
                ).start()
            except RuntimeError:  # no thread can be started
                self._forget(link)

    def _serve(self, link: socket.socket) -> None:
        """Send one client its blocks until either end closes."""
        try:
            if self._admitted(link):
                self._send(link)
        except OSError:
            pass  # the client has gone
        finally:
            self._forget(link)

    def _admitted(self, link: socket.socket) -> bool:
        clock = RealClock()
        deadline = clock.now() + _TOKEN_DEADLINE
        given = b""
        while len(given) < TOKEN:
            left = deadline - clock.now()
            if left <= 0:
                return False
            link.settimeout(left)
            part = link.recv(TOKEN - len(given))
            if not part:
                return False
            given += part
        return hmac.compare_digest(given, self._token.encode())

    def _send(self, link: socket.socket) -> None:
        link.settimeout(None)
        sent_drops = 0
        with self._feed.tap(_CAPACITY) as tap:
            while not self._closing.is_set():
                block = tap.take(_IDLE)
                if block is None:
                    # End when the client has gone or has sent more than its token.
                    if tap.closed or select.select([link], [], [], 0)[0]:
                        return
                    continue
                dropped = max(sent_drops, tap.dropped)
                head, volts = frame_of(block, dropped - sent_drops)
                sent_drops = dropped
                link.sendall(head)
                link.sendall(volts)

    def _forget(self, link: socket.socket) -> None:
        with self._changing:
            self._clients.discard(link)
        link.close()
