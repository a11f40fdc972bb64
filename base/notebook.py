"""Values that a notebook shows with a table and a small picture."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, cast

from . import entry_points

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NOTEBOOK = "haploop.notebook"
"""Group of the entry point that makes the HTML: tables and pictures are not this room's affair."""


class InNotebook:
    """A value that a notebook shows and plots, by functions of the group `haploop.notebook`."""

    def _repr_html_(self) -> str:
        return cast(str, entry_points.load(NOTEBOOK, "html")(self))

    def plot(self, columns: Literal[1, 2] = 2) -> Figure:
        """Draw it as reports do, in the width of one or two columns: a matplotlib Figure.

        Raises DataError for what has no figure.
        """
        return cast("Figure", entry_points.load(NOTEBOOK, "plot")(self, columns))
