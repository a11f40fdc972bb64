"""Promises of the camera role."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pytest

from ...base.errors import InstrumentError
from ..camera import Camera
from .suite import Conformance, refused


class CameraConformance(Conformance):
    """Give a fixture `camera`: a driver that has just been opened, and that gives ten frames at least.

    A fault in `faults` must make `read` raise, or leave a gap in the frames' numbers.
    """

    optional: ClassVar = {"restarts": "it can be started again after it was stopped"}

    def test_says_what_it_is(self, camera: Camera) -> None:
        """Identity, shape and rate are told before it is started."""
        assert camera.identity.strip() and "\n" not in camera.identity
        rows, columns = camera.shape
        assert rows >= 16 and columns >= 16 and np.isfinite(camera.rate_hz) and camera.rate_hz > 0

    def test_frames_are_grey_numbered_and_timed(self, camera: Camera) -> None:
        """Numbers and times rise; frames have the shape that was told, and 8 bits."""
        self.in_time(camera.start)
        frames = [self.in_time(camera.read) for _ in range(5)]
        for frame in frames:
            assert frame.pixels.shape == camera.shape and frame.pixels.dtype == np.uint8
        numbers = np.array([frame.number for frame in frames])
        times = np.array([frame.time for frame in frames])
        assert numbers[0] >= 0 and (np.diff(numbers) >= 1).all()
        spacing = np.diff(times) / np.diff(numbers) * camera.rate_hz
        assert 0.5 < float(np.median(spacing)) < 2, spacing

    def test_no_frame_is_given_twice(self, camera: Camera) -> None:
        """Each frame is an array of its own: what was read is not overwritten by the next read."""
        self.in_time(camera.start)
        first = self.in_time(camera.read)
        kept = first.pixels.copy()
        self.in_time(camera.read)
        assert np.array_equal(first.pixels, kept)

    def test_refuses_to_read_before_it_is_started(self, camera: Camera) -> None:
        """`read` after `stop` raises."""
        self.in_time(camera.start)
        self.in_time(camera.stop)
        with refused(InstrumentError):
            self.in_time(camera.read)

    def test_stops_and_closes_more_than_once(self, camera: Camera) -> None:
        """`stop` and `close` are idempotent, and in any order."""
        for action in (camera.stop, camera.start, camera.stop, camera.stop, camera.close, camera.close):
            self.in_time(action)

    @pytest.mark.requires("restarts")
    def test_starts_again(self, camera: Camera) -> None:
        """After `stop`, `start` begins anew."""
        for _ in range(2):
            self.in_time(camera.start)
            self.in_time(camera.read)
            self.in_time(camera.stop)

    def test_notices_a_fault(self, camera: Camera, kind: str) -> None:
        """A lost frame is a gap in the numbers, and no frame at all is an error in time."""
        self.in_time(camera.start)
        first = self.in_time(camera.read).number
        with self.fault(kind) as fault:
            try:
                numbers = [first, *(self.in_time(camera.read).number for _ in range(4))]
            except InstrumentError:
                assert fault.fired
                return
        assert fault.fired
        assert max(np.diff(numbers)) > 1, numbers
