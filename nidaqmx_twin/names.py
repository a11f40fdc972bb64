"""Names of virtual channels that one call makes, and fields of requests.

NI-DAQmx help, "Channel Name Generation": `Dev1/ai0:7` with "foo" makes foo0 to foo7, "foo31" makes foo31 to
foo38, "foo 123" makes foo123 to foo130, and "a0:3, b" makes a0 to a3 and b0 to b3. Leading zeros are kept
("myChan09", "myChan10": issue 579 of ni/nidaqmx-python).
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from nidaqmx.constants import FillMode
from nidaqmx.errors import DaqError
from nidaqmx.utils import unflatten_channel_string

from .errors import DaqmxError, DAQmxErrors


def names_in(text: str) -> list[str]:
    """Return the names that a list with ranges names ("Dev1/ai0:3, Dev1/ai5"). Raises DaqmxError."""
    try:
        return list(unflatten_channel_string(text))
    except DaqError as error:
        raise DaqmxError(DAQmxErrors(error.error_code), f"{error}".partition("\n\nStatus Code")[0]) from None


def channel_names(assigned: str, count: int) -> list[str] | None:
    """Return the names of `count` channels from the text `assigned`; None when it names nothing.

    The items of a list are used in turn; the last of too few counts on from its trailing number, or from 0;
    those too many are left out (NI's own tests of digital channels). Raises DaqmxError for a name twice.
    """
    given = [name.strip() for name in names_in(assigned)] if assigned.strip() else []
    given = [name for name in given if name]
    if not given:
        return None
    missing = count - len(given)
    names = given[:count] if missing <= 0 else [*given[:-1], *_counted(given[-1], missing + 1)]
    if len({name.lower() for name in names}) < len(names):
        raise DaqmxError(
            DAQmxErrors.CHAN_ALREADY_IN_TASK,
            f"Channel specified already exists in the task: a name stands twice in {', '.join(names)}.",
        )
    return names


def _counted(name: str, count: int) -> list[str]:
    """Return `count` names that count on from the number at the end of `name`, or from 0."""
    base, digits = re.fullmatch(r"(.*?)\s*(\d*)", name, re.DOTALL).groups()  # type: ignore[union-attr]  # always
    first = int(digits or 0)
    return [f"{base}{first + i:0{len(digits)}d}" for i in range(count)]


# Fields of requests, which are given as an enum or as its raw number, and the order of their arrays.


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
