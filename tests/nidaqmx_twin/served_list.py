"""The page of what the twin serves of nidaqmx: `python -m tests.nidaqmx_twin.served_list` writes it anew."""

import textwrap
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path
from typing import Any

from nidaqmx._stubs import nidaqmx_pb2 as pb

from haploop.nidaqmx_twin.attributes import ATTRIBUTE_CALL
from haploop.nidaqmx_twin.calls import CALLS
from haploop.nidaqmx_twin.counter_calls import COUNTER_FACTS
from haploop.nidaqmx_twin.facts import CHANNEL_FACTS, DEVICE_FACTS, SYSTEM_FACTS
from haploop.nidaqmx_twin.properties import acts, default_value
from haploop.nidaqmx_twin.state_facts import CHANNEL_STATE, TASK_STATE

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "nidaqmx-served.md"
_HEAD = """# What the NI twin serves of nidaqmx

The properties and calls of nidaqmx 1.7, generated; a test compares this page with the installed nidaqmx.

*Served*: the twin computes it, or acts on it. *Refused*: a property is -200197 until a program sets it (and
is then kept), a call is `DaqFunctionNotSupportedError`. *Kept*: a program can set it and read it back, and
nothing follows from it; a task that starts with one at another value than its default warns and names it
(`TwinWarning`). "All others" are those of nidaqmx that are not named. Names are those of NI's C interface.
"""
SERVED, KEPT, REFUSED = "served", "kept", "refused"
_TITLES = {SERVED: "Served", REFUSED: "Refused", KEPT: "Kept"}
_FACTS: dict[str, Any] = {
    "Chan": {**CHANNEL_STATE, **COUNTER_FACTS},
    "Device": DEVICE_FACTS,
    "SystemInfo": SYSTEM_FACTS,
    "PhysicalChan": CHANNEL_FACTS,
    **TASK_STATE,
}
_WHOLE = ("Scale", "PersistedScale", "PersistedTask", "PersistedChan", "CalInfo", "Watchdog")
"""Kinds that are served in whole."""
_NOTHING = ("TristateOutputTerm",)
"""Calls that succeed and do nothing."""


def property_status(kind: str, type_: str, name: str) -> str:
    """Return SERVED, KEPT or REFUSED for a property of a `kind`, in the type of calls `type_`."""
    if kind in _WHOLE or name in _FACTS.get(kind, {}) or acts(kind, name) or "_TEDS_" in name:
        return SERVED
    return REFUSED if default_value(kind, type_, name) is None else KEPT


def call_status(name: str) -> str:
    """Return SERVED, KEPT (succeeds, and does nothing) or REFUSED for a call."""
    if name in _NOTHING:
        return KEPT
    served = name in CALLS or ATTRIBUTE_CALL.fullmatch(name) or name.startswith(("Register", "Unregister"))
    return SERVED if served else REFUSED


def properties() -> Iterator[tuple[str, str, str]]:
    """Yield each property of the installed nidaqmx, as (kind, type, name), once."""
    seen: set[tuple[str, str]] = set()
    for method in pb.DESCRIPTOR.services_by_name["NiDAQmx"].methods:
        match = ATTRIBUTE_CALL.fullmatch(method.name)
        if match is None or match["verb"] == "Reset":
            continue
        for value in method.input_type.fields_by_name["attribute"].enum_type.values:
            name = value.name.partition("ATTRIBUTE_")[2]
            if name not in ("", "UNSPECIFIED") and (match["kind"], name) not in seen:
                seen.add((match["kind"], name))
                yield match["kind"], match["type"], name


def calls() -> list[str]:
    """Return the names of the calls of the installed nidaqmx that are not about a property."""
    methods = pb.DESCRIPTOR.services_by_name["NiDAQmx"].methods_by_name
    return sorted(name for name in methods if ATTRIBUTE_CALL.fullmatch(name) is None)


def page() -> str:
    """Return the page for the installed nidaqmx."""
    rows = sorted((kind, property_status(kind, type_, name), name) for kind, type_, name in properties())
    rows += sorted(("Calls", call_status(name), name) for name in calls())
    parts = [_HEAD]
    for kind, of_kind in groupby(rows, key=lambda row: row[0]):
        listed = list(of_kind)
        statuses = {status for _, status, _ in listed}
        others = SERVED if kind == "Calls" or KEPT not in statuses else KEPT
        unnamed = "all others" if len(statuses) > 1 else "all"
        parts.append(f"\n## {kind}\n")
        for status, title in _TITLES.items():
            names = [name for _, of, name in listed if of == status]
            if names:
                told = unnamed if status == others else ", ".join(names)
                told = f"{title} ({len(names)}): {told}."
                parts.append(
                    "\n" + textwrap.fill(told, 120, break_long_words=False, break_on_hyphens=False) + "\n"
                )
    return "".join(parts)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
