"""Rows of tables of tests, of which a plain run takes some."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def thinned(rows: Iterable[Any], every: int) -> list[Any]:
    """All rows; only the first of each `every` runs without `--long`, as what is dear and alike in all."""
    return [row if number % every == 0 else _long(row) for number, row in enumerate(rows)]


def _long(row: Any) -> Any:
    if hasattr(row, "marks"):
        return pytest.param(*row.values, marks=[*row.marks, pytest.mark.long], id=row.id)
    return pytest.param(*(row if isinstance(row, tuple) else (row,)), marks=pytest.mark.long)
