"""Contact area of a finger, from bright blobs in images of a surface with rear diffused illumination.

What the camera sees without a finger is subtracted, and followed as the light drifts; the largest bright blob
is the finger, if it looks like one (`blobs`); its area is what lies above half of its own brightness, which
does not depend on how bright that is, nor on a moderate blur.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy

from ...base.arrays import BoolArray, FloatArray
from ...base.clock import Clock
from ...base.errors import DataError
from ...instruments import Camera, Frame, Rig

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


# Bright blobs in an image of a surface, and whether one is the contact of a single fingertip.
#
# A fingertip that touches is an evenly bright spot with a sharp edge, convex, little longer than wide, of at
# most some hundred square millimetres, and whole in the picture. What is not is named by what it looks like:
# a glow has no edge, a palm is large, two fingers that touch are a spot with a waist.

BLURRED = 5.0
"""Standard deviation of an edge's blur (pixels) above which areas are not trusted."""
DIM = 12.0
"""Brightness (grey levels) from which an area is measured."""
_SEEN = 4.0
"""Brightness (grey levels) from which something is seen."""
_DETECTED = 6.0
"""Brightness over the noise of the smoothed image above which a pixel belongs to a blob."""
_SATURATED = 250
"""Grey levels from which a pixel may be saturated."""
_SMALLEST = 60
"""Smallest blob (pixels) that counts."""
_SHAPED = 200
"""Pixels from which a blob's shape is told."""
_LARGEST = 450e-6
"""Largest contact of a thumb (m^2): an estimate; fingertips pressed with 10 N have 150 to 250 mm^2."""
_CONVEX, _LONG = 0.94, 1.9
"""Least share of its convex hull that a fingertip fills, and its greatest length over its width. Two equal
circles that touch fill 0.88 and have 2.2; an ellipse of any size fills 0.98 (simulated)."""
_FAINT = 0.35
"""Brightness of a spot over the finger's, below which it is no finger."""


@dataclass(frozen=True, eq=False)
class Blob:
    """A connected bright spot, in grey levels above the background."""

    pixels: int
    """Those above half of its brightness."""
    blur: float
    """Standard deviation of its edge (pixels)."""
    level: float
    """Its brightness, the 90th percentile."""
    cut: bool
    """True when it reaches the picture's border."""
    convex: float
    """Share of its convex hull that it fills; 1 of a small one."""
    length: float
    """Length over width, of the ellipse with its second moments; 1 of a small one."""
    mask: BoolArray
    """(rows, columns) of the picture."""

    @property
    def glows(self) -> bool:
        """True for light without an edge."""
        return self.blur > BLURRED

    def problem(self, area: float, brightest: float, others: list[Blob]) -> str:
        """Why it is no whole fingertip of an `area` (m^2), as a sentence; empty where it may be one.

        `brightest` are the grey levels of the background that add to its own; `others` lie beside it.
        """
        square_mm, most = area * 1e6, _LARGEST * 1e6
        told = (
            (
                self.level < DIM,
                f"Something on the surface is {self.level:.0f} grey levels bright, and {DIM:g} are needed to "
                "measure it: raise the lamps or the exposure, or wipe the surface.",
            ),
            (
                self.glows,
                f"There is a glow without an edge (blurred over {self.blur:.0f} pixels), no finger: shade "
                "the table from other light, or wipe the surface.",
            ),
            (
                self.level + brightest > _SATURATED,
                "The image is saturated: lower the camera's exposure or the lamps.",
            ),
            (bool(others), self._beside(others)),
            (self.cut, "The finger lies partly outside the picture: press nearer to its middle."),
            (
                area > _LARGEST,
                f"{square_mm:.0f} mm² touch the surface, more than a fingertip ({most:.0f} mm²): a palm, or "
                "a hand. Touch it with one finger.",
            ),
            (
                self.convex < _CONVEX or self.length > _LONG,
                "What touches the surface has not the shape of one fingertip: more than one finger, side by "
                "side, or a finger that lies flat.",
            ),
        )
        return next((sentence for so, sentence in told if so), "")

    def _beside(self, others: list[Blob]) -> str:
        """What the other blobs are, as a sentence; empty without any."""
        if not others:
            return ""
        if any(not one.glows and one.level >= max(_FAINT * self.level, DIM) for one in others):
            return "There is more than one finger on the surface, or a hand: lift the others."
        if any(one.glows for one in others):
            return "There is a glow beside the finger: shade the table from other light."
        faint = max(one.level for one in others)
        return (
            f"There is a faint spot beside the finger ({faint:.0f} grey levels, and {self.level:.0f} of the "
            "finger): wipe the surface."
        )


def blobs(raised: FloatArray, noise: float, smoothed: int) -> list[Blob]:
    """The blobs of an image (rows, columns) in grey levels above the background, largest first.

    `noise` is the standard deviation of a pixel (grey levels) before the image was averaged over squares of
    `smoothed` pixels.
    """
    clear = _DETECTED * noise / smoothed
    labels, _ = scipy.ndimage.label(raised > max(clear, _SEEN))
    found = []
    for number, place in enumerate(scipy.ndimage.find_objects(labels), 1):
        inside = labels[place] == number
        bright = inside & (raised[place] > max(clear, DIM))
        if int(bright.sum()) < _SMALLEST:
            bright = inside
        if int(bright.sum()) < _SMALLEST:
            continue
        values = raised[place][bright]
        level = float(np.percentile(values, 90))
        half = bright & (raised[place] > level / 2)
        pixels = int(half.sum())
        # Of a Gaussian edge, 0.25 to 0.75 of the brightness are 1.35 standard deviations wide.
        ring = int(np.sum((values > 0.25 * level) & (values < 0.75 * level)))
        perimeter = 2 * np.sqrt(np.pi * max(pixels, 1))
        mask = np.zeros(raised.shape, dtype=np.bool_)
        mask[place] = half
        cut = bool(mask[[0, -1]].any() or mask[:, [0, -1]].any())
        mask[place] = inside
        convex, length = _shape(half) if pixels >= _SHAPED else (1.0, 1.0)
        found.append(Blob(pixels, ring / perimeter / 1.35, level, cut, convex, length, mask))
    return sorted(found, key=lambda one: -one.pixels)


def _shape(mask: BoolArray) -> tuple[float, float]:
    """Share of its convex hull that a mask fills, and its length over its width."""
    points = np.argwhere(mask).astype(np.float64)
    narrow, wide = np.sqrt(np.maximum(np.linalg.eigvalsh(np.cov(points.T)), 1e-9))
    if narrow < 1:
        return 1.0, float(wide / narrow)
    hull = scipy.spatial.ConvexHull(points)
    # Of the pixels' centres; a pixel reaches half its side beyond (Steiner's formula).
    whole = hull.volume + hull.area / 2 + 1
    return float(len(points) / whole), float(wide / narrow)
