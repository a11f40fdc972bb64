"""Driver for cameras, video files and streams that OpenCV opens: `pip install "haploop[camera]"`.

Tried with video files and a stream, not with a camera. OpenCV reports no frame counter: a frame that was lost
is inferred from the stream's own times, or without those from the time between two frames. For a file the
numbers are exact.
"""

from __future__ import annotations

import math
from collections import deque
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from pydantic import Field

from ...base.bounded import Fraction, Number, Strict
from ...base.clock import Clock
from ...base.entry_points import optional
from ...base.errors import InstrumentError
from ..driver import one_name
from ..tape import Proxied, TapedLine, taped_line
from .role import Camera, Frame

_OPENED_IN, _READ_IN = 5000, 1000
"""Longest waits for a stream and for one of its frames (ms). For a camera OpenCV has its own."""
_ARRIVALS = 600
"""Frames of which the earliest arrival tells how the stream's times lie on the rig's clock."""


class OpenCvCamera(Camera):
    """See `Camera`."""

    taped = True

    class Settings(Strict):
        """The `[camera]` table of a rig file."""

        source: Number | str
        """Number of a camera, a video file, or the address of a stream."""
        rows: Annotated[int, Field(strict=True, ge=16, le=4096)] = 240
        columns: Annotated[int, Field(strict=True, ge=16, le=4096)] = 320
        rate_hz: Annotated[float, Field(strict=True, gt=0, le=1000)] = 60.0
        """Frames per second that are asked for; the camera must give it within 5 %."""
        delay: Fraction = 0.0
        """s from the middle of the exposure to the arrival of the frame."""

    def __init__(self, settings: Settings, clock: Clock, library: Any) -> None:
        self._settings, self._clock, self._library = settings, clock, library
        self._capture: Any = None
        self._number = -1
        self._last = self._stamp = -math.inf
        self._offsets: deque[float] = deque(maxlen=_ARRIVALS)
        self._file = isinstance(settings.source, str) and "://" not in settings.source
        self.shape = (settings.rows, settings.columns)
        self.rate_hz = settings.rate_hz
        self.identity = f"OpenCV {library.__version__}, {settings.source}"
        self._open()

    @staticmethod
    def hardware(settings: Settings) -> tuple[str, ...]:
        """See `Driver.hardware`."""
        return (f"camera {one_name(str(settings.source))}",)

    @classmethod
    def open(cls, settings: Settings, clock: Clock) -> Self:
        """Open the camera. Raises ConfigurationError without OpenCV, InstrumentError without a camera."""
        line = taped_line()
        library = None if line.playing else optional("cv2", "camera", "The driver opencv")
        return cls(settings, clock, _Taped(line, library) if line.taped else library)

    def start(self) -> None:
        """See `Camera.start`. A video file begins again."""
        self.stop()
        self._open()
        self._number, self._last, self._stamp = -1, -math.inf, -math.inf
        self._offsets.clear()

    def read(self) -> Frame:
        """See `Camera.read`."""
        if self._capture is None or not self._capture.isOpened():
            raise InstrumentError(f"{self.identity} is not started: call start() before read().")
        before = self._clock.now()
        whole, image = self._capture.read()
        now = self._clock.now()
        if not whole or image is None:
            what = "has no further frame" if self._file else f"gave no frame within {now - before:.2f} s"
            raise InstrumentError(f"{self.identity} {what}: check its cable, or begin again.")
        pixels = np.asarray(image if image.ndim == 2 else image.mean(axis=2).round(), dtype=np.uint8)
        if pixels.shape != self.shape:
            raise InstrumentError(
                f"{self.identity} gave a frame of {pixels.shape[0]} x {pixels.shape[1]}, not of "
                f"{self.shape[0]} x "
                f"{self.shape[1]} rows and columns: change 'rows' and 'columns' in [camera]."
            )
        if self._file:
            self._number += 1
            return Frame(pixels, self._number, self._number / self.rate_hz)
        return Frame(pixels, *self._placed(now))

    def _placed(self, now: float) -> tuple[int, float]:
        """Number and time of the frame that was read at `now` (s).

        A frame that is read late has a stamp of its own all the same: the earliest arrival of the last frames
        tells when its stamp was on the rig's clock. Without stamps that rise, the arrival is what is known.
        """
        stamp = float(self._capture.get(self._library.CAP_PROP_POS_MSEC)) / 1000
        stamped = stamp > self._stamp
        since = stamp - self._stamp if stamped else now - self._last
        self._number += max(1, round(since * self.rate_hz)) if math.isfinite(since) else 1
        self._last, self._stamp = now, stamp
        if not stamped:
            self._offsets.clear()
        self._offsets.append(now - stamp)
        return self._number, stamp + min(self._offsets) - self._settings.delay

    def stop(self) -> None:
        """See `Camera.stop`."""
        if self._capture is not None:
            self._capture.release()
            self._capture = None

    def close(self) -> None:
        """See `Camera.close`."""
        self.stop()

    def _open(self) -> None:
        library, settings = self._library, self._settings
        # A tape has the frames, and needs no file.
        needed = self._file and not getattr(library, "playing", False)
        if needed and not Path(str(settings.source)).is_file():
            raise InstrumentError(f"There is no video file {settings.source}: check 'source' in [camera].")
        if isinstance(settings.source, str) and not self._file:
            limits = [library.CAP_PROP_OPEN_TIMEOUT_MSEC, _OPENED_IN]
            limits += [library.CAP_PROP_READ_TIMEOUT_MSEC, _READ_IN]
            self._capture = library.VideoCapture(settings.source, library.CAP_FFMPEG, limits)
        else:
            self._capture = library.VideoCapture(settings.source)
        if not self._capture.isOpened():
            self._capture = None
            raise InstrumentError(
                f"OpenCV opens no camera {settings.source!r}: check 'source' in [camera], that no other "
                "program uses the camera, and that this user may open it."
            )
        if isinstance(settings.source, int):
            self._capture.set(library.CAP_PROP_FRAME_HEIGHT, settings.rows)
            self._capture.set(library.CAP_PROP_FRAME_WIDTH, settings.columns)
            self._capture.set(library.CAP_PROP_FPS, settings.rate_hz)
        rate = float(self._capture.get(library.CAP_PROP_FPS))
        if rate > 0 and abs(rate / settings.rate_hz - 1) > 0.05:
            self.stop()
            raise InstrumentError(
                f"{self.identity} gives {rate:g} frames/s, not {settings.rate_hz:g}: change 'rate_hz' "
                "in [camera]."
            )


class _Taped:
    """OpenCV on a line that a tape listens to or answers: the part of it that the driver uses."""

    def __init__(self, line: TapedLine, library: Any) -> None:
        self._line, self._library = line, library
        self.playing = line.playing

    def __getattr__(self, name: str) -> Any:
        """A constant."""
        return self._line.call(name, lambda: getattr(self._library, name))

    def VideoCapture(self, *opened: Any) -> Any:  # noqa: N802  as OpenCV calls it
        """Open a camera, file or stream."""
        made = self._line.call("VideoCapture", lambda: self._library.VideoCapture(*opened), *opened)
        return Proxied(self._line, made, one_of_many=True)
