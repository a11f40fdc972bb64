"""The camera's twin: rendered infra-red images of the finger on the surface, by calls or as a stream."""

from __future__ import annotations

import math
import socket
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import scipy

from ..base.arrays import FloatArray
from ..base.clock import Clock, VirtualClock
from ..base.errors import InstrumentError
from ..instruments.camera.opencv import OpenCvCamera
from ..instruments.camera.role import Camera, Frame
from .plant import OnCamera, Plant
from .transport import Loopback

# Twin of a camera under a surface with rear diffused illumination.
#
# A finger reflects the light of the lamps where it touches: a bright ellipse, blurred by the optics. Figures
# are estimates, after a camera with 320 x 240 pixels at a short distance.

PIXELS_PER_METRE = 5.3e3
_LAMP = 28.0
"""Grey levels at the image's centre without a finger."""
_FINGER = 130.0
"""Grey levels that a finger adds."""
_BLUR = 1.2
"""Standard deviation of the optics' blur (pixels)."""
_NOISE = 2.5
"""Standard deviation of the noise (grey levels)."""
_ASPECT = 1.25
"""Length over width of a contact."""
_DEADLINE = 1.0
"""Longest wait for a frame (s)."""
_FRAMES_WAITING = 4
"""Frames that wait to be read; older ones are lost."""


class CameraTwin(Camera):
    """See `Camera`. Takes frames on the plant's clock; each arrives one period after its exposure."""

    def __init__(self, settings: OpenCvCamera.Settings, plant: Plant) -> None:
        self.identity = "simulated camera"
        self.shape = (settings.rows, settings.columns)
        self.rate_hz = settings.rate_hz
        self._plant = plant
        self._rng = plant.rng("camera")
        rows, columns = np.indices(self.shape, dtype=float)
        self._y, self._x = rows - self.shape[0] / 2 + 0.5, columns - self.shape[1] / 2 + 0.5
        # Lamps at the edges light the surface unevenly, and every camera has pixels of their own.
        self._unevenness = (
            1 + 0.4 * (self._x / self.shape[1] + 0.5) + 0.03 * self._rng.normal(size=self.shape)
        )
        self._first: float | None = None
        self._next = 0

    def start(self) -> None:
        """See `Camera.start`."""
        self._first, self._next = self._plant.clock.now(), 0

    def read(self) -> Frame:
        """See `Camera.read`."""
        if self._first is None:
            raise InstrumentError("The camera is not started: call start() before read().")
        clock = self._plant.clock
        asked = clock.now()
        while True:
            arrives = self.arrives()
            if arrives > asked + _DEADLINE:
                clock.sleep(_DEADLINE)
                raise InstrumentError(f"The camera gave no frame within {_DEADLINE:g} s: check its cable.")
            frame = self.take()
            if frame is not None:
                clock.sleep(arrives - clock.now())
                return frame

    def arrives(self) -> float:
        """Time (s) at which the next frame is there, of those that the camera still keeps."""
        assert self._first is not None
        waiting = math.floor((self._plant.clock.now() - self._first) * self.rate_hz)
        self._next = max(self._next, waiting - _FRAMES_WAITING)
        return self._first + (self._next + 2) / self.rate_hz

    def take(self) -> Frame | None:
        """Take the frame that `arrives` is about, without waiting; None when it is lost."""
        assert self._first is not None
        number, self._next = self._next, self._next + 1
        exposed = self._first + (number + 0.5) / self.rate_hz
        lost = [fault.frame_lost(exposed) for fault in self._plant.faults.at(OnCamera)]  # each is asked
        return None if True in lost else Frame(self._image(exposed), number, exposed)

    def stop(self) -> None:
        """See `Camera.stop`."""
        self._first = None

    def close(self) -> None:
        """See `Camera.close`."""
        self.stop()

    def _image(self, time: float) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
        faults = self._plant.faults.at(OnCamera)
        lamp, blur = _LAMP, _BLUR
        others = 0.0
        for fault in faults:
            lamp, blur = fault.lamp(lamp, time), fault.blur(blur, time)
            others = max(others, fault.other_finger(time))
        area = float(self._plant.contact_area(np.array([time]))[0])
        light = self._ellipse(area, blur, 0.0, 0.0)
        if self._plant.target:
            light = np.maximum(light, self._ellipse(self._plant.target, blur, 0.0, 0.0, aspect=1.0))
        if others:
            light = np.maximum(light, self._ellipse(others, blur, 0.36 * self.shape[1], 0.36 * self.shape[0]))
        image = lamp * self._unevenness + _FINGER * light + _NOISE * self._rng.normal(size=self.shape)
        return np.asarray(np.clip(np.round(image), 0, 255), dtype=np.uint8)

    def _ellipse(self, area: float, blur: float, x: float, y: float, aspect: float = _ASPECT) -> FloatArray:
        """Light (rows, columns), 0 to 1, of a contact of an area (m^2), so many pixels off the centre."""
        if area <= 0:
            return np.zeros(self.shape)
        width = math.sqrt(area / (math.pi * aspect)) * PIXELS_PER_METRE
        length = width * aspect
        inside = 1 - np.hypot((self._x - x) / length, (self._y - y) / width)
        distance = inside * math.sqrt(width * length)
        return np.asarray(scipy.special.ndtr(distance / max(blur, 1e-3)))


# Wire of the camera: a live video stream over HTTP on loopback, which OpenCV opens like a network camera's.
#
# The container is Matroska (RFC 9559), with uncompressed grey frames, each with the time of its exposure, so
# that a lost frame is a gap in the stream's times.
#
# A stream has no requests that say when somebody waits. While it is read, and nothing else in the simulation
# moves time, the camera moves it, frame by frame and no faster than real time. When nobody reads, the
# connection's buffers fill and it waits; what it could not send is lost, as with a real camera.

_SOCKET_BUFFER = 1 << 14
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
        link.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SOCKET_BUFFER)
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
