"""Values that a notebook shows with a table and a small picture."""

from __future__ import annotations

from typing import cast

from . import entry_points

__all__ = ["NOTEBOOK", "InNotebook"]

NOTEBOOK = "haploop.notebook"
"""Group of the entry point that makes the HTML: tables and pictures are not this room's affair."""


class InNotebook:
    """A value that a notebook shows by the function `html` of the group `haploop.notebook`."""

    def _repr_html_(self) -> str:
        return cast(str, entry_points.load(NOTEBOOK, "html")(self))
