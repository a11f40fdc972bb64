"""The camera's twin and OpenCV's driver keep the role's promises; frames that are lost are noticed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from haploop.base.clock import VirtualClock
from haploop.base.errors import ConfigurationError, InstrumentError
from haploop.instruments import Camera, load_rig_file
from haploop.instruments.camera.opencv import OpenCvCamera
from haploop.instruments.conformance import CameraConformance, Fired
from haploop.mocks.camera import CameraTwin, wire
from haploop.mocks.plant import Faults, OnCamera, Plant
from tests.raising import raises

SETTINGS = OpenCvCamera.Settings(source=0, rows=48, columns=64)


class Lost(OnCamera):
    """Loses two frames, or more."""

    def __init__(self, frames: int = 2) -> None:
        self.at, self._frames = [], frames

    def frame_lost(self, time: float) -> bool:
        self.at.append(time)
        return self.fired <= self._frames


class TestTwin(CameraConformance):
    capabilities = ("restarts",)
    faults: ClassVar = ("lost",)

    @pytest.fixture
    def camera(self) -> Iterator[Camera]:
        self.plant = Plant(load_rig_file("simulated"), VirtualClock())
        camera = CameraTwin(SETTINGS, self.plant)
        yield camera
        camera.close()

    @contextmanager
    def fault(self, kind: str) -> Iterator[Fired]:
        fault = Lost(2 if kind == "lost" else 10**9)
        self.plant.faults = Faults([fault])
        yield fault


def video(path: Path, frames: int = 20, rows: int = 48, columns: int = 64) -> Path:
    """A video file whose frames brighten by 5 grey levels each."""
    cv2 = pytest.importorskip("cv2")
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 60.0, (columns, rows))
    for number in range(frames):
        writer.write(np.full((rows, columns, 3), 5 * number, dtype=np.uint8))
    writer.release()
    return path


class TestOpenCv(CameraConformance):
    capabilities = ("restarts",)

    @pytest.fixture
    def camera(self, tmp_path: Path) -> Iterator[Camera]:
        source = str(video(tmp_path / "finger.avi"))
        camera = OpenCvCamera.open(SETTINGS.model_copy(update={"source": source}), VirtualClock())
        yield camera
        camera.close()


class TestWire(TestTwin):
    """OpenCV reads the simulated camera's live stream."""

    faults: ClassVar = ("lost", "silent")

    @pytest.fixture
    def camera(self) -> Iterator[Camera]:
        pytest.importorskip("cv2")
        self.plant = Plant(load_rig_file("simulated"), VirtualClock())
        with wire(SETTINGS, self.plant) as address:
            camera = OpenCvCamera.open(SETTINGS.model_copy(update=address), self.plant.clock)
            yield camera
            camera.close()


def opened(source: Path, **settings: Any) -> OpenCvCamera:
    asked = SETTINGS.model_copy(update={"source": str(source), **settings})
    return OpenCvCamera.open(asked, VirtualClock())


def test_a_video_is_read_frame_by_frame_to_its_end(tmp_path):
    camera = opened(video(tmp_path / "finger.avi"))
    camera.start()
    frames = [camera.read() for _ in range(20)]
    assert [frame.number for frame in frames] == list(range(20))
    assert [round(float(frame.pixels.mean()) / 5) for frame in frames] == list(range(20))
    assert frames[6].time == pytest.approx(0.1)
    raises(InstrumentError, "no further frame", camera.read)


def test_what_is_no_camera_is_refused_in_one_sentence(tmp_path):
    pytest.importorskip("cv2")
    (tmp_path / "text.avi").write_text("no video", encoding="utf-8")
    for says, use in (
        ("no video file", lambda: opened(tmp_path / "none.avi")),
        ("opens no camera", lambda: opened(tmp_path / "text.avi")),
        ("60 frames/s, not 120", lambda: opened(video(tmp_path / "slow.avi"), rate_hz=120.0)),
        ("32 x 64, not of 48 x 64", opened(video(tmp_path / "small.avi", rows=32)).read),
    ):
        raises(InstrumentError, says, use)


def test_without_opencv_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "cv2", None)
    with pytest.raises(ConfigurationError, match=r'pip install "haploop\[camera\]"'):
        OpenCvCamera.open(SETTINGS, VirtualClock())


class Feed:
    """OpenCV's VideoCapture of a camera that loses a frame now and then; each read takes its time."""

    CAP_PROP_FPS = CAP_PROP_POS_MSEC = CAP_PROP_FRAME_HEIGHT = CAP_PROP_FRAME_WIDTH = 0
    __version__ = "of a test"

    def __init__(self, clock: VirtualClock, intervals: list[float]) -> None:
        self._clock, self._intervals = clock, intervals

    def VideoCapture(self, _source: int) -> Feed:  # noqa: N802  as OpenCV calls it
        return self

    def isOpened(self) -> bool:  # noqa: N802
        return True

    def get(self, _what: int) -> float:
        return 0.0

    def set(self, _what: int, _value: float) -> None: ...

    def release(self) -> None: ...

    def read(self) -> tuple[bool, Any]:
        self._clock.sleep(self._intervals.pop(0))
        return True, np.zeros((48, 64), dtype=np.uint8)


def test_a_camera_s_lost_frame_is_told_by_the_time_between_two():
    clock = VirtualClock()
    period = 1 / 60
    feed = Feed(clock, [period, period, 3.1 * period, 0.9 * period, 2 * period])
    camera = OpenCvCamera(SETTINGS, clock, feed)
    camera.start()
    assert [camera.read().number for _ in range(5)] == [0, 1, 4, 5, 7]
