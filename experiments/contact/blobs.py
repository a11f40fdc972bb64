"""Bright blobs in an image of a surface, and whether one is the contact of a single fingertip.

A fingertip that touches is an evenly bright spot with a sharp edge, convex, little longer than wide, of at
most some hundred square millimetres, and whole in the picture. What is not is named by what it looks like: a
glow has no edge, a palm is large, two fingers that touch are a spot with a waist.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from ...base.arrays import BoolArray, FloatArray

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
