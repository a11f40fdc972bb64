"""How far apart two colours are: with three kinds of colour blindness, without, and on a grey printer."""

import numpy as np
from matplotlib.colors import to_rgb
from numpy.typing import NDArray

__all__ = ["LEAST", "VISIONS", "lab", "nearest"]

# G. M. Machado, M. M. Oliveira, L. A. F. Fernandes: A physiologically-based model for simulation of color
# vision deficiency. IEEE Trans. Visualization and Computer Graphics 15, 1291 (2009): severity 1, linear sRGB.
VISIONS = {
    "normal": np.eye(3),
    "protanopia": np.array(
        [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]]
    ),
    "deuteranopia": np.array(
        [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
    ),
    "tritanopia": np.array(
        [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]]
    ),
    "grey": np.tile([0.2126, 0.7152, 0.0722], (3, 1)),
}
LEAST = 15.0
"""Least difference (CIE 1976, delta E*ab) that tells two thin lines apart; on areas, 2.3 is just noticed."""

_XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)
_WHITE = _XYZ.sum(axis=1)


def lab(colour: object, vision: str) -> NDArray[np.float64]:
    """CIE L*, a*, b* (D65) of a matplotlib colour as somebody of this vision sees it."""
    value = np.array(to_rgb(colour))
    linear = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    seen = np.clip(VISIONS[vision] @ linear, 0, 1)
    part = _XYZ @ seen / _WHITE
    f = np.where(part > 0.008856, np.cbrt(part), 7.787 * part + 16 / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def nearest(one: object, other: object) -> tuple[float, str]:
    """The least difference of two colours over all visions, and the vision that sees it."""
    return min((float(np.linalg.norm(lab(one, name) - lab(other, name))), name) for name in VISIONS)
