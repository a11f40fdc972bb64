"""Contact area of a finger, from images of a surface with rear diffused illumination.

What the camera sees without a finger is subtracted, and followed as the light drifts; the largest bright blob
is the finger, if it looks like one (`blobs`); its area is what lies above half of its own brightness, which
does not depend on how bright that is, nor on a moderate blur.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy

from ...base.arrays import FloatArray
from ...base.clock import Clock
from ...base.errors import DataError
from ...instruments import Camera, Frame, Rig
from .blobs import BLURRED, DIM, Blob, blobs

_SMOOTHED = 3
"""Side of the square (pixels) over which the image is averaged."""
_EDGE = 4
"""Width of the border (pixels) that shows the light without a finger."""
_MOST_KEPT = 30
"""Frames that a camera may keep while it is not read; a video file always has the next one."""
_FOLLOWED, _ABSORBED = 2.0, 10.0
"""Time (s) in which the background follows a pixel that nothing covers, and one that shows light which is no
finger."""
_GAP = 1.0
"""Longest time (s) between frames that counts."""


@dataclass(frozen=True, eq=False)
class Background:
    """What the camera sees without a finger."""

    mean: FloatArray
    """(rows, columns) grey levels."""
    noise: float
    """Standard deviation of a pixel from frame to frame (grey levels)."""


@dataclass(frozen=True)
class Contact:
    """What one frame shows."""

    number: int
    time: float
    """Middle of the exposure (s of the rig's clock)."""
    area: float
    """m^2; 0 without a finger."""
    pixels: int
    others: int
    """Blobs beside the finger."""
    light: float
    """Change of the light beside the finger since the background was learnt (grey levels)."""
    problem: str
    """Why the area is not to be trusted, as a sentence; empty when it is."""


@dataclass(eq=False)
class _Followed:
    """The background as it is now, and the time (s) up to which it was followed."""

    mean: FloatArray
    time: float | None = None


@dataclass(frozen=True, eq=False)
class ContactMeter:
    """Measures the contact area in frames, one after the other, and follows the background meanwhile."""

    background: Background
    square_metres: float
    """Area of a pixel (m^2)."""
    _now: _Followed = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_now", _Followed(self.background.mean.copy()))

    def measure(self, frame: Frame) -> Contact:
        """Measure one frame. Never raises for what a finger does; see `Contact.problem`."""
        raised, light = _raised(frame, self._now.mean)
        found = blobs(raised, self.background.noise, _SMOOTHED)
        problem = self._light_problem(light)
        if not problem:
            self._follow(frame, found)
        if not found:
            return Contact(frame.number, frame.time, 0.0, 0, 0, light, problem)
        first, others = found[0], found[1:]
        area = first.pixels * self.square_metres
        # Light that has changed makes blobs of its own, and saturates: it is told before them.
        problem = problem or first.problem(area, float(self._now.mean.max()), others)
        return Contact(frame.number, frame.time, area, first.pixels, len(others), light, problem)

    def _follow(self, frame: Frame, found: Sequence[Blob]) -> None:
        """Move the background towards a frame: not where a finger is, slowly where there is other light."""
        now = self._now
        passed = 0.0 if now.time is None else min(max(frame.time - now.time, 0.0), _GAP)
        now.time = frame.time
        if not passed:
            return
        covered = np.zeros(now.mean.shape, dtype=np.bool_)
        rate = np.full(now.mean.shape, 1 - np.exp(-passed / _FOLLOWED))
        for blob in found:
            grown = scipy.ndimage.binary_dilation(blob.mask, iterations=_EDGE)
            covered |= grown
            fingerlike = blob.level >= DIM and not blob.glows
            rate[grown] = 0.0 if fingerlike else 1 - np.exp(-passed / _ABSORBED)
        change = rate * (frame.pixels - now.mean)
        if covered.any() and not covered.all():
            # Below a finger the light drifts as it does around it.
            change[covered & (rate == 0.0)] = float(np.mean(change[~covered]))
        now.mean += change

    def _light_problem(self, light: float) -> str:
        if abs(light) > max(6 * self.background.noise, 10.0):
            return (
                f"The light changed by {light:+.0f} grey levels: shade the table, and learn the "
                "background anew."
            )
        return ""


def drop_old_frames(camera: Camera, clock: Clock) -> None:
    """Read away the frames that a camera kept while nobody read: the next one is taken after this returns.

    A camera gives those at once, and OpenCV gives them the time at which they are read, so that an old finger
    would count as a new one.
    """
    waited = 0
    for _ in range(_MOST_KEPT):
        before = clock.now()
        camera.read()
        # On a busy computer a frame that was kept can take as long as a new one: two in a row hardly do.
        waited = waited + 1 if clock.now() - before > 0.5 / camera.rate_hz else 0
        if waited == 2:
            return


def learn_background(camera: Camera, frames: int = 30) -> Background:
    """Learn what a started camera sees without a finger, from this many frames (two at least).

    Raises DataError: it is saturated or dark, or something moves. Raises InstrumentError.
    """
    seen = np.array([camera.read().pixels for _ in range(frames)], dtype=float)
    mean = seen.mean(axis=0)
    # From successive frames, so that a change of the light is not taken for noise.
    noise = float(np.median(np.abs(np.diff(seen, axis=0)))) / 0.954
    if float(np.percentile(mean, 99)) > 200:
        raise DataError("The image without a finger is too bright: lower the exposure, or shade the table.")
    if noise == 0 and float(mean.max()) == 0:
        raise DataError("The image is black: open the camera's lens, and switch the lamps on.")
    moved = scipy.ndimage.uniform_filter(seen[-1] - seen[0], _SMOOTHED)
    if float(np.abs(moved).max()) > 8 * max(noise, 0.5):
        raise DataError(
            "Something moved while the background was learnt: take hands off the surface, and repeat."
        )
    return Background(mean, max(noise, 0.3))


@dataclass(frozen=True, eq=False)
class SeenSurface:
    """A rig's touch surface, the started camera below it, and the scale of its images."""

    rig: Rig
    camera: Camera
    meter: ContactMeter

    def contact(self) -> Contact:
        """Contact in the next frame. Raises InstrumentError."""
        return self.meter.measure(self.camera.read())

    def skip(self) -> None:
        """Read away the frames that were taken before now. Raises InstrumentError."""
        drop_old_frames(self.camera, self.rig.clock)


def calibrate_meter(frames: Sequence[Frame], background: Background, area: float) -> ContactMeter:
    """Calibrate the area of a pixel from frames of one target of known `area` (m^2).

    Raises DataError: no target or several, out of focus, or frames that differ by more than 1 %.
    """
    found, blurs, cut = [], [], False
    for frame in frames:
        raised, _ = _raised(frame, background.mean)
        spots = [one for one in blobs(raised, background.noise, _SMOOTHED) if one.level >= DIM]
        if len(spots) != 1:
            raise DataError(
                f"There are {len(spots)} bright spots where the target alone should be: put it on the "
                "surface, and take everything else away."
            )
        cut = cut or spots[0].cut
        found.append(spots[0].pixels)
        blurs.append(spots[0].blur)
    if not found:
        raise DataError("There is no frame of the target: take some.")
    if float(np.mean(blurs)) > BLURRED:
        raise DataError(
            f"The target's edge is blurred over {np.mean(blurs):.1f} pixels (standard deviation): "
            "focus the camera "
            "on the surface."
        )
    if float(np.std(found)) > 0.01 * float(np.mean(found)):
        raise DataError(
            "The target's area differs by more than 1 % from frame to frame: leave it alone, and repeat."
        )
    if cut:
        raise DataError("The target lies partly outside the picture: put it in the middle, and repeat.")
    return ContactMeter(background, area / float(np.mean(found)))


def _raised(frame: Frame, background: FloatArray) -> tuple[FloatArray, float]:
    """Brightness above the background (rows, columns), smoothed, and the change of light (grey levels)."""
    if frame.pixels.shape != background.shape:
        raise DataError(
            f"A frame has {frame.pixels.shape} pixels and the background {background.shape}: learn it anew."
        )
    difference = scipy.ndimage.uniform_filter(frame.pixels - background, _SMOOTHED)
    # At the border, because a firm finger may cover half of a small image.
    edge = np.concatenate([difference[:_EDGE].ravel(), difference[-_EDGE:].ravel()])
    sides = np.concatenate([difference[:, :_EDGE].ravel(), difference[:, -_EDGE:].ravel()])
    light = float(np.median(np.concatenate([edge, sides])))
    return difference - light, light
