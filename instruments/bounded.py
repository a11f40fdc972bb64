"""Numbers of settings that are checked against bounds; NaN and infinity are refused in each."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Negative = Annotated[float, Field(lt=0, allow_inf_nan=False)]
Fraction = Annotated[float, Field(ge=0, le=1)]
"""From 0 to 1, both included."""
Proportion = Annotated[float, Field(gt=0, lt=1)]
"""Between 0 and 1, neither included."""
Seed = Annotated[int, Field(ge=0)]
Timeout = Annotated[float, Field(gt=0, le=60)]
"""Time for an instrument to answer (s)."""
