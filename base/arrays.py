"""Array types shared by all packages; the docstring of each use states the axes."""

from __future__ import annotations

from typing import Any, get_args, get_origin

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]


def scalar_of(hint: Any) -> type[np.generic] | None:
    """The scalar type in the hint of an array, as np.float64; None for the hint of anything else."""
    if get_origin(hint) is not get_origin(FloatArray):
        return None
    inner = get_args(hint)[-1]
    # Up to numpy 2.4 NDArray[x] is ndarray[shape, dtype[x]]; from 2.5 on it is an alias that holds x.
    scalar: type[np.generic] = (get_args(inner) or (inner,))[0]
    return scalar
