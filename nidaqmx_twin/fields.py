"""Fields of requests, which are given as an enum or as its raw number, and the order of their arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
from nidaqmx.constants import FillMode


def field(request: Any, name: str) -> Any:
    """Return a field of a request, given as the enum or as its raw number."""
    raw = f"{name}_raw"
    fields = request.DESCRIPTOR.fields_by_name
    if raw in fields and getattr(request, raw):
        return getattr(request, raw)
    return getattr(request, name) if name in fields else None


def is_by_scan(request: Any, name: str) -> bool:
    """Return True when an array holds sample after sample, of all channels each."""
    return bool(field(request, name) == FillMode.GROUP_BY_SCAN_NUMBER.value)


def flattened(rows: Any, request: Any, name: str = "fill_mode") -> Any:
    """Return (channels, samples) as one row, in the order that field `name` asks for."""
    return np.ascontiguousarray(rows.T if is_by_scan(request, name) else rows).ravel()
