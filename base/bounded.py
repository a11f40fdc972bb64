"""Settings that are checked: tables without unknown keys, and numbers within bounds, where NaN, infinity,
`true` and text are refused.

A quantity of a rig, in SI units, is between a millionth of a picofarad and a terahertz in size. What lies
beyond is a slip, and would overflow when it is squared.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

_LARGEST, _SMALLEST = 1e12, 1e-18


def _not_tiny(value: float) -> float:
    if value < _SMALLEST:
        raise ValueError(f"{value:g} is smaller than anything at a rig: correct its unit")
    return value


Finite = Annotated[float, Field(strict=True, ge=-_LARGEST, le=_LARGEST, allow_inf_nan=False)]
Positive = Annotated[
    float, Field(strict=True, gt=0, le=_LARGEST, allow_inf_nan=False), AfterValidator(_not_tiny)
]
NotNegative = Annotated[float, Field(strict=True, ge=0, le=_LARGEST, allow_inf_nan=False)]
Negative = Annotated[float, Field(strict=True, lt=0, ge=-_LARGEST, allow_inf_nan=False)]
NotPositive = Annotated[float, Field(strict=True, le=0, ge=-_LARGEST, allow_inf_nan=False)]
Fraction = Annotated[float, Field(strict=True, ge=0, le=1)]
"""From 0 to 1, both included."""
Proportion = Annotated[float, Field(strict=True, gt=0, lt=1)]
"""Between 0 and 1, neither included."""
Count = Annotated[int, Field(strict=True, ge=1, le=1_000_000)]
Baud = Annotated[int, Field(strict=True, ge=300, le=12_000_000)]
"""From the slowest line in use to full-speed USB (bits/s)."""
Number = Annotated[int, Field(strict=True, ge=0, le=10_000)]
"""Of a device or a grid point, from 0."""
Seed = Annotated[int, Field(strict=True, ge=0, lt=1 << 53)]  # a browser rounds a larger one
Timeout = Annotated[float, Field(strict=True, gt=0, le=60)]
"""Time for an instrument to answer (s)."""


class Strict(BaseModel):
    """A table of a file: it cannot be changed, and a key that it does not know is refused."""

    model_config = ConfigDict(frozen=True, extra="forbid")
