"""Contact area of a finger, from images of a surface with rear diffused illumination.

What the camera sees without a finger is subtracted; the largest bright blob is the finger; its area is what
lies above half of its own brightness, which does not depend on how bright that is, nor on a moderate blur.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from ...instruments import Camera, DataError, Frame, Rig
from ...instruments.arrays import FloatArray
from ...instruments.clock import Clock

_SATURATED = 250
_DETECTED = 6.0
"""Brightness over the noise of the smoothed image above which a pixel belongs to a finger."""
_SMOOTHED = 3
"""Side of the square (pixels) over which the image is averaged."""
_EDGE = 4
"""Width of the border (pixels) that shows the light without a finger."""
_SMALLEST = 60
"""Smallest blob (pixels) that counts as a finger."""
_MOST_KEPT = 30
"""Frames that a camera may keep while it is not read; a video file always has the next one."""
_BLURRED = 5.0
"""Standard deviation of the blur (pixels) above which areas are not trusted."""


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


@dataclass(frozen=True, eq=False)
class ContactMeter:
    """Measures the contact area in frames."""

    background: Background
    square_metres: float
    """Area of a pixel (m^2)."""

    def measure(self, frame: Frame) -> Contact:
        """Measure one frame. Never raises for what a finger does; see `Contact.problem`."""
        raised, light = _raised(frame, self.background)
        blobs = _blobs(raised, self.background)
        problem = self._light_problem(light)
        if not blobs:
            return Contact(frame.number, frame.time, 0.0, 0, 0, light, problem)
        pixels, _, level = blobs[0]
        # Light that has changed makes blobs of its own, and saturates: it is told before them.
        if not problem and len(blobs) > 1:
            problem = "There is more than one finger on the surface, or a hand: lift the others."
        elif not problem and level + float(self.background.mean.max()) > _SATURATED:
            problem = "The image is saturated: lower the camera's exposure or the lamps."
        area = pixels * self.square_metres
        return Contact(frame.number, frame.time, area, pixels, len(blobs) - 1, light, problem)

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
    found, blurs = [], []
    for frame in frames:
        raised, _ = _raised(frame, background)
        blobs = _blobs(raised, background)
        if len(blobs) != 1:
            raise DataError(
                f"There are {len(blobs)} bright spots where the target alone should be: put it on the "
                "surface, and "
                "take everything else away."
            )
        found.append(blobs[0][0])
        blurs.append(blobs[0][1])
    if not found:
        raise DataError("There is no frame of the target: take some.")
    if float(np.mean(blurs)) > _BLURRED:
        raise DataError(
            f"The target's edge is blurred over {np.mean(blurs):.1f} pixels (standard deviation): "
            "focus the camera "
            "on the surface."
        )
    if float(np.std(found)) > 0.01 * float(np.mean(found)):
        raise DataError(
            "The target's area differs by more than 1 % from frame to frame: leave it alone, and repeat."
        )
    return ContactMeter(background, area / float(np.mean(found)))


def _raised(frame: Frame, background: Background) -> tuple[FloatArray, float]:
    """Brightness above the background (rows, columns), smoothed, and the change of light (grey levels)."""
    if frame.pixels.shape != background.mean.shape:
        raise DataError(
            f"A frame has {frame.pixels.shape} pixels and the background {background.mean.shape}: "
            "learn it anew."
        )
    difference = scipy.ndimage.uniform_filter(frame.pixels - background.mean, _SMOOTHED)
    # At the border, because a firm finger may cover half of a small image.
    edge = np.concatenate([difference[:_EDGE].ravel(), difference[-_EDGE:].ravel()])
    sides = np.concatenate([difference[:, :_EDGE].ravel(), difference[:, -_EDGE:].ravel()])
    light = float(np.median(np.concatenate([edge, sides])))
    return difference - light, light


def _blobs(raised: FloatArray, background: Background) -> list[tuple[int, float, float]]:
    """Pixels above half brightness, blur of the edge (pixels), and brightness of each blob, largest first."""
    least = max(_DETECTED * background.noise / _SMOOTHED, 12.0)
    labels, _ = scipy.ndimage.label(raised > least)
    found = []
    for number, place in enumerate(scipy.ndimage.find_objects(labels), 1):
        inside = labels[place] == number
        if int(inside.sum()) < _SMALLEST:
            continue
        values = raised[place][inside]
        level = float(np.percentile(values, 90))
        pixels = int(np.sum(values > level / 2))
        # Of a Gaussian edge, 0.25 to 0.75 of the brightness are 1.35 standard deviations wide.
        ring = int(np.sum((values > 0.25 * level) & (values < 0.75 * level)))
        perimeter = 2 * np.sqrt(np.pi * max(pixels, 1))
        found.append((pixels, ring / perimeter / 1.35, level))
    return sorted(found, reverse=True)
