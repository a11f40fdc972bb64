"""Ratings of a rig file beyond those of the product that it names: they state where they are from."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

RatingSource = Annotated[str, Field(min_length=5, max_length=200, pattern=r"\S")] | None
"""Where a figure beyond the product's own is from: a data sheet of another version, or who measured it."""


def require_source(product: str, key: str, value: float, own: float, source: str | None) -> None:
    """Refuse a figure that is not the product's own without its source. Raises ValueError."""
    if source is None:
        raise ValueError(
            f"{key} = {value:g} is not what the {product} has ({own:g}): correct it, or say where it is from "
            "in rating_source"
        )
