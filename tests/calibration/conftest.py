from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from haploop.acquisition import Representative
from haploop.calibration import Calibration, Check, Drive, calibrate, drive_for
from haploop.calibration.drive import check
from haploop.instruments import Capture, Rig
from haploop.mocks.pytest_plugin import Rigs


@dataclass(frozen=True)
class Calibrated:
    rig: Rig
    calibration: Calibration


@pytest.fixture(scope="session")
def calibrated(rigs: Rigs, request: pytest.FixtureRequest) -> Iterator[Calibrated]:
    """One calibration for all tests: it takes a minute of the table's time."""
    with rigs.open(request.node) as rig:
        yield Calibrated(rig, calibrate(rig))


@pytest.fixture(scope="session")
def drive(calibrated: Calibrated) -> Drive:
    """The drive of `make_press()`, modulated: it takes seconds of the processor's time."""
    return drive_for(make_press(), calibrated.calibration, calibrated.rig.limits)


@pytest.fixture
def press() -> Representative:
    return make_press()


def make_press(
    partials: tuple[tuple[float, float, float], ...] = ((235, 10, 0.010), (120, 3, 0.014)), at: float = 0.3
) -> Representative:
    """A snap that rings in partials of (Hz, m/s^2, decay in s)."""
    t = np.arange(round(0.6 * 5000)) / 5000
    since = np.maximum(t - at, 0)
    shape = sum(a * np.exp(-since / decay) * np.sin(2 * np.pi * f * since) for f, a, decay in partials)
    rest = np.zeros(len(t))
    return Representative(
        button="push", rate_hz=5000.0, acceleration=np.asarray(shape), force=rest, spread=rest, members=1,
        activation=np.asarray(t > at, dtype=np.float64), activation_index=round(at * 5000),
        bandwidth_hz=500.0, sources=(("P01-push.h5", "0" * 64),), left_out=(), method="made for a test",
        simulated=True,
    )  # fmt: skip


Checked = Callable[..., Check]


@pytest.fixture
def checked(calibrated: Calibrated, drive: Drive, monkeypatch: pytest.MonkeyPatch) -> Checked:
    """Three plays of `drive`, or of another, whose captures are changed on their way: see `tamper`."""

    def checking(other: Drive = drive, *, plays: int = 3, most: int | None = None, **change: Any) -> Check:
        tamper(calibrated.rig, monkeypatch, **change)
        return check(calibrated.rig, other, plays=plays, **({} if most is None else {"most": most}))

    return checking


def tamper(rig: Rig, monkeypatch: pytest.MonkeyPatch, **change: Callable[[np.ndarray], Any]) -> None:
    """From now on, what the rig captures of a channel is changed on its way: drive=..., laser=..."""

    def changed(excite: Callable[..., Capture], *args: Any, **more: Any) -> Capture:
        capture = excite(*args, **more)
        volts = capture.volts.copy()
        for name in change.keys() & set(capture.channels):
            row = capture.channels.index(name)
            volts[row] = change[name](volts[row])
        return replace(capture, volts=volts)

    for name in ("excite", "excite_each"):
        monkeypatch.setattr(rig, name, partial(changed, getattr(rig, name)))
