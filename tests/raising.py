"""What is refused, in one line."""

from collections.abc import Callable
from typing import Any

import pytest


def raises(kind: Any, says: str, call: Any, *args: Any, **words: Any) -> str:
    """The words of an error of a kind, which the call raises; `says` is a pattern in them, or empty."""
    with pytest.raises(kind, match=says or None) as raised:
        call(*args, **words)
    try:
        return str(raised.value)
    finally:
        # Its traceback holds this frame: so it would live, with what it holds open, until a collection.
        del raised


def raising(error: BaseException) -> Callable[..., Any]:
    """A function that raises the error, whatever it is called with."""

    def call(*_: object, **__: object) -> Any:
        raise error

    return call
