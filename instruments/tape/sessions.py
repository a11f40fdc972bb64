"""The tape of this program's session, for all rigs that are opened in a context.

Also a tape without serial numbers and names, to be sent to somebody.
"""

from __future__ import annotations

import json
import re
import warnings
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any

from ...base.errors import ConfigurationError, DataError
from .player import Player
from .recorder import Recorder
from .tape_file import TapeLines, TapeWriter

_current: ContextVar[Recorder | Player | None] = ContextVar("haploop_session", default=None)


def current() -> Recorder | Player | None:
    """What rigs that are opened now are recorded by, or played from."""
    return _current.get()


@contextmanager
def recorded(path: str | Path) -> Iterator[Recorder]:
    """Record every call between rigs that are opened in this context and their devices, into a new file.

    A program's own calls, of nidaqmx or pyserial, pass it by: without any call of a rig it warns, and leaves
    no file. Raises ConfigurationError when the file exists or cannot be written, and DataError at its end
    when the tape could not be written to its end.
    """
    with recording_of(path) as recorder:
        yield recorder
    if not recorder.calls:
        # The third frame is the caller's: contextlib's lies between.
        warnings.warn(
            f"Nothing was recorded, and {path} was not written: no call passed through a rig of haploop. "
            "Open one inside recorded(...). The calls of a program that uses nidaqmx by itself are recorded "
            "on simulated cards: `haploop twin ni --device Dev1=PCIe-6363 --tape FILE.tape -- COMMAND`.",
            stacklevel=3,
        )


@contextmanager
def recording_of(path: str | Path) -> Iterator[Recorder]:
    """As `recorded`, and says nothing when nothing was recorded."""
    with Recorder(Path(path)) as recorder, _entered(recorder):
        yield recorder


@contextmanager
def played(path: str | Path) -> Iterator[Player]:
    """Play a tape to all rigs that are opened in this context with `simulate="tape:FILE"`.

    One rig alone needs no such context. Raises ConfigurationError, DataError; TapeError for a difference.
    """
    with Player(Path(path)) as player, _entered(player):
        yield player


@contextmanager
def _entered(deck: Recorder | Player) -> Iterator[None]:
    if _current.get() is not None:
        raise ConfigurationError("One tape is in use already: end it first.")
    token = _current.set(deck)
    try:
        yield
    finally:
        _current.reset(token)


_NI_SERIAL = 0x632
"""NI's attribute for a device's serial number."""
_KEYS = re.compile(r'\\*"(?:serialNumber|logicalName|serial)\\*":\s*\\*"([^"\\]+)\\*"')
"""Where hubs and rig files name a serial number, or what a person has called a device."""
_SHORTEST = 4
"""A shorter text is left: it stands in too many others (characters)."""


def mask(source: str | Path, target: str | Path, hidden: Collection[str] = ()) -> int:
    """Copy a tape without the serial numbers in it, and without the texts in `hidden`.

    Each is replaced, wherever it stands, by a text of the same form, so that the copy can be played.
    The folder of a rig's log is left out. Returns the number of texts that were replaced.
    Raises ConfigurationError for a file that exists, DataError for a tape that was changed.
    """
    found = TapeLines.of(Path(source))
    texts = dict.fromkeys([*hidden, *(text for line in found.lines for text in _serials(line))])
    wanted = [text for text in texts if len(text) >= _SHORTEST or text in hidden]
    instead = {text: _stand_in(text, number) for number, text in enumerate(wanted, 1)}
    try:
        writer = TapeWriter(Path(target))
    except OSError as error:
        raise ConfigurationError(f"{target} cannot be written: {(error.strerror or '').lower()}.") from None
    numbers: dict[int, int] = {}
    try:
        for line in (found.head, *found.lines):
            said = {key: value for key, value in line.items() if key != "hash"}
            if _is_ni_serial(said):
                said["got"] = numbers.setdefault(said["got"], len(numbers) + 1)
            if said.get("is") == "rig":
                said["rig"] = json.dumps({**json.loads(said["rig"]), "state": None})
            writer.write(_replaced(said, instead))
        if found.whole:
            writer.write({"is": "end", "lines": len(found.lines) + 1})
        writer.close()
    except OSError as error:
        raise DataError(f"{target} cannot be written: {(error.strerror or '').lower()}.") from None
    return len(instead)


def _is_ni_serial(line: Mapping[str, Any]) -> bool:
    asked = line.get("do") == "get_device_attribute_uint32" and line["with"][1:] == [_NI_SERIAL]
    return asked and isinstance(line.get("got"), int)


def _serials(line: Mapping[str, Any]) -> Iterator[str]:
    """Serial numbers and given names that a line tells."""
    for text in _texts(line):
        yield from _KEYS.findall(text)
    answer = line.get("got")
    if _is_ni_serial(line):
        yield f"{answer:X}"  # as identities tell it
    if line.get("do") == "receive" and isinstance(answer, dict):
        words = str(answer.get("b", "")).strip().split(",")
        if len(words) == 4 and words[2].strip():  # *IDN?: maker, model, serial number, firmware
            yield words[2].strip()


def _texts(said: Any) -> Iterator[str]:
    if isinstance(said, str):
        yield said
    elif isinstance(said, list):
        for part in said:
            yield from _texts(part)
    elif isinstance(said, dict) and "a" not in said:
        for part in said.values():
            yield from _texts(part)


def _replaced(said: Any, instead: Mapping[str, str]) -> Any:
    if isinstance(said, str):
        for text, other in instead.items():
            said = said.replace(text, other)
        return said
    if isinstance(said, list):
        return [_replaced(part, instead) for part in said]
    if isinstance(said, dict) and "a" not in said:
        return {key: _replaced(part, instead) for key, part in said.items()}
    return said


def _stand_in(text: str, number: int) -> str:
    """Another text of the same form: digits count, letters are X where there are digits, and count elsewhere.

    What stands before the last hyphen of a serial number names the product, and stays.
    """
    kept, hyphen, own = text.rpartition("-")
    counts = str.isdigit if any(map(str.isdigit, own)) else str.isalpha
    made = []
    for sign in reversed(own):
        if counts(sign):
            base, first = (10, "0") if sign.isdigit() else (26, "A")
            number, digit = divmod(number, base)
            made.append(chr(ord(first) + digit))
        else:
            made.append("X" if sign.isalpha() else sign)
    return kept + hyphen + "".join(reversed(made))
