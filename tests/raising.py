"""What is refused, in one line."""

from __future__ import annotations

from typing import Any

import pytest


def raises(kind: Any, says: str, call: Any, *args: Any, **words: Any) -> None:
    """Call what raises an error of a kind; `says` is a pattern in its words, or empty."""
    with pytest.raises(kind, match=says or None):
        call(*args, **words)
