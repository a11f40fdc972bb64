"""Arguments and answers as JSON: numbers, text, bytes, arrays, and handles of objects that have no text."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Mapping
from dataclasses import asdict, dataclass, is_dataclass
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Handle:
    """Stands for an object that a device's library gave: a task, a capture."""

    number: int


class Handles:
    """Numbers objects in the order in which they are first seen; keeps them, so that no number is reused."""

    def __init__(self) -> None:
        self._numbers: dict[int, int] = {}
        self._kept: list[object] = []

    def number(self, thing: object) -> int:
        """Number of an object, or of what it stands for."""
        if isinstance(thing, Handle):
            return thing.number
        if id(thing) not in self._numbers:
            self._numbers[id(thing)] = len(self._kept)
            self._kept.append(thing)
        return self._numbers[id(thing)]


def as_json(value: Any, handles: Handles, hidden: Mapping[str, str]) -> Any:
    """A value as JSON; texts in `hidden` are replaced."""
    if isinstance(value, Enum | np.generic):
        value = value.value if isinstance(value, Enum) else value.item()
    if isinstance(value, str):
        for text, instead in hidden.items():
            value = value.replace(text, instead)
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, list):
        return [as_json(part, handles, hidden) for part in value]
    return _told(value, handles, hidden)


def _told(value: Any, handles: Handles, hidden: Mapping[str, str]) -> dict[str, Any]:
    told: dict[str, Any]
    match value:
        case bytes() | bytearray():
            told = {"b": as_json(bytes(value).decode("latin-1"), handles, hidden)}
        case np.ndarray():
            told = {"a": [value.dtype.str, list(value.shape), text_of(value)]}
        case tuple():
            told = {"t": [as_json(part, handles, hidden) for part in value]}
        case dict():
            told = {"d": {str(key): as_json(part, handles, hidden) for key, part in value.items()}}
        case _ if is_dataclass(value) and not isinstance(value, type | Handle):
            told = {"d": {type(value).__name__: as_json(asdict(value), handles, hidden)}}
        case _:
            told = {"o": handles.number(value)}
    return told


def from_json(told: Any) -> Any:
    """The value of what `as_json` gave; a `Handle` for an object. Raises ValueError for anything else."""
    if isinstance(told, list):
        return [from_json(part) for part in told]
    if not isinstance(told, dict):
        return told
    value: Any
    match told:
        case {"b": str(text)}:
            value = text.encode("latin-1")
        case {"a": [str(kind), list(shape), str(text)]}:
            value = array_of(kind, shape, text)
        case {"t": list(parts)}:
            value = tuple(from_json(part) for part in parts)
        case {"d": dict(parts)}:
            value = {key: from_json(part) for key, part in parts.items()}
        case {"o": int(number)}:
            value = Handle(number)
        case _:
            raise ValueError(f"no value is told by {str(told)[:60]}")
    return value


def text_of(array: NDArray[Any]) -> str:
    """An array's bytes as text, sorted by their place in a value: like bytes beside each other pack well."""
    whole = np.ascontiguousarray(array)
    sorted_bytes = whole.view(np.uint8).reshape(-1, whole.itemsize).T if whole.size else whole
    return base64.b64encode(sorted_bytes.tobytes()).decode("ascii")


def array_of(kind: str, shape: list[Any], text: str) -> NDArray[Any]:
    """The array of what `text_of` gave. Raises ValueError for another text."""
    dtype = np.dtype(kind)
    if dtype.hasobject:
        raise ValueError("an array holds no objects")
    try:
        packed = np.frombuffer(base64.b64decode(text, validate=True), np.uint8)
        whole = packed.reshape(dtype.itemsize, -1).T.copy() if packed.size else packed
        return whole.reshape(-1).view(dtype).reshape([int(length) for length in shape])
    except (binascii.Error, TypeError, OverflowError) as error:
        raise ValueError(f"no array is told by its text ({error})") from None
