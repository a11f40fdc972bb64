"""Wire of the camera: a live video stream over HTTP on loopback, which OpenCV opens like a network camera's.

The container is Matroska (RFC 9559), with uncompressed grey frames, each with the time of its exposure, so
that a lost frame is a gap in the stream's times.

A stream has no requests that say when somebody waits. While it is read, and nothing else in the simulation
moves time, the camera moves it, frame by frame and no faster than real time. When nobody reads, the
connection's buffers fill and it waits; what it could not send is lost, as with a real camera.
"""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager

from ...base.clock import Clock
from ...instruments.camera.opencv import OpenCvCamera
from ..clock import VirtualClock
from ..plant import Plant
from ..transport import Loopback
from .twin import CameraTwin

_BUFFER = 1 << 14
"""Bytes that wait in the server; the client's own buffer keeps some frames more."""
_MICROSECOND = 1000
"""Unit of the stream's times (ns)."""
_UNKNOWN = b"\x01" + 7 * b"\xff"
"""Size of an element that goes on until the stream ends."""


class CameraStream(Loopback):
    """Serves a camera twin's frames to one client at a time; who connects last gets them."""

    def __init__(self, camera: CameraTwin, clock: Clock, port: int = 0) -> None:
        self._camera, self._clock = camera, clock
        self._link: socket.socket | None = None
        super().__init__(self._stream, port)
        self.url = f"http://{self.address}/camera.mkv"

    def _stream(self, link: socket.socket) -> None:
        link.recv(1 << 12)
        link.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _BUFFER)
        camera = self._camera
        self._link = link
        begun = self._clock.now()
        camera.start()
        link.sendall(b"HTTP/1.0 200 OK\r\nContent-Type: video/x-matroska\r\n\r\n" + _head(camera))
        while not self.closing.is_set():
            arrives = camera.arrives()
            if self._clock.now() < arrives:
                self.closing.wait(min(arrives - self._clock.now(), 1 / camera.rate_hz))
                if isinstance(self._clock, VirtualClock):
                    self._clock.sleep_until(arrives)
            if self._link is not link:
                return
            frame = camera.take()
            if frame is not None:
                link.sendall(
                    _cluster(round(1e9 * (frame.time - begun) / _MICROSECOND), frame.pixels.tobytes())
                )


def _head(camera: CameraTwin) -> bytes:
    """EBML header, and the beginning of a segment with one track of grey pictures."""
    rows, columns = camera.shape
    header = _element(
        "1a45dfa3",
        _number("4286", 1) + _number("42f7", 1) + _number("42f2", 4) + _number("42f3", 8),
        _element("4282", b"matroska") + _number("4287", 4) + _number("4285", 2),
    )
    info = _element("1549a966", _number("2ad7b1", _MICROSECOND), _element("4d80", b"haploop"))
    picture = _element("e0", _number("b0", columns) + _number("ba", rows), _element("2eb524", b"Y800"))
    track = _element(
        "ae",
        _number("d7", 1) + _number("73c5", 1) + _number("83", 1),
        _number("23e383", round(1e9 / camera.rate_hz)) + _element("86", b"V_UNCOMPRESSED") + picture,
    )
    return header + bytes.fromhex("18538067") + _UNKNOWN + info + _element("1654ae6b", track)


def _cluster(stamp: int, pixels: bytes) -> bytes:
    """One picture with its time, as a key frame."""
    return _element("1f43b675", _number("e7", stamp), _element("a3", b"\x81\x00\x00\x80" + pixels))


def _element(name: str, *content: bytes) -> bytes:
    data = b"".join(content)
    return bytes.fromhex(name) + (len(data) | 1 << 56).to_bytes(8, "big") + data


def _number(name: str, value: int) -> bytes:
    return _element(name, value.to_bytes(8, "big"))


@contextmanager
def wire(settings: OpenCvCamera.Settings, plant: Plant) -> Iterator[dict[str, object]]:
    """Serve the stream; yield the settings that point the driver at it."""
    with CameraStream(CameraTwin(settings, plant), plant.clock) as stream:
        # A frame arrives one period after its exposure, of which the time is the middle.
        yield {"source": stream.url, "delay": 1.5 / settings.rate_hz}
