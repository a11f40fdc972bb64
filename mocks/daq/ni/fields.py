"""Fields of requests, which are given as an enum or as its raw number."""

from __future__ import annotations

from typing import Any

__all__ = ["field"]


def field(request: Any, name: str) -> Any:
    """Return a field of a request, given as the enum or as its raw number."""
    raw = f"{name}_raw"
    fields = request.DESCRIPTOR.fields_by_name
    if raw in fields and getattr(request, raw):
        return getattr(request, raw)
    return getattr(request, name) if name in fields else None
