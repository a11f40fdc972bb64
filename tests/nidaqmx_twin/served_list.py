"""The page of what the twin serves of nidaqmx: `python -m tests.nidaqmx_twin.served_list` writes it anew."""

from __future__ import annotations

import textwrap
from itertools import groupby
from pathlib import Path

from haploop.nidaqmx_twin import served

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "nidaqmx-served.md"
_HEAD = """# What the NI twin serves of nidaqmx

Every property and call of nidaqmx 1.7, generated; a test compares this page with the installed nidaqmx.

*Served*: the twin computes it, or acts on it. *Kept*: a program can set it and read it back, and nothing
follows from it; a task that starts with one at another value than its default warns (`TwinWarning`).
*Refused*: a property is -200197 until a program sets it (and is then kept), a call is
`DaqFunctionNotSupportedError`. Names are those of NI's C interface.
"""
_TITLES = {served.SERVED: "Served", served.KEPT: "Kept", served.REFUSED: "Refused"}


def page() -> str:
    """Return the page for the installed nidaqmx."""
    rows = sorted(
        (kind, served.property_status(kind, type_, name), name) for kind, type_, name in served.properties()
    )
    rows += sorted(("Calls", served.call_status(name), name) for name in served.calls())
    parts = [_HEAD]
    for kind, of_kind in groupby(rows, key=lambda row: row[0]):
        listed = list(of_kind)
        parts.append(f"\n## {kind}\n")
        for status, title in _TITLES.items():
            names = [name for _, of, name in listed if of == status]
            if names:
                told = f"{title} ({len(names)}): {', '.join(names)}."
                parts.append(
                    "\n" + textwrap.fill(told, 120, break_long_words=False, break_on_hyphens=False) + "\n"
                )
    return "".join(parts)


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
