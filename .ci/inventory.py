"""Everything that a user, a script or a rig file can name, one line each, beside the list that is kept.

`python .ci/inventory.py` prints what appeared and what went since `.ci/inventory.txt`, and fails if anything
did; `--write` keeps the new list, so that a commit shows what it adds or takes away: commands with options,
names of Python with their signatures, keys of rig files with their bounds, drivers, faults and formats.
"""

from __future__ import annotations

import difflib
import inspect
import sys
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from typing import Any

import click

import haploop
from haploop.commands.cli import cli
from haploop.exchange.columns import FORMATS as READ
from haploop.exchange.formats import FORMATS as WRITTEN
from haploop.instruments.rig.json_schema import rig_schema
from haploop.mocks.faults import OWN as FAULTS
from haploop.terminal import exits

_LIST = Path(__file__).with_suffix(".txt")
_ROOT = Path(__file__).parent.parent
_BOUNDS = (
    "type",
    "minimum",
    "maximum",
    "exclusiveMinimum",
    "exclusiveMaximum",
    "enum",
    "const",
    "anyOf",
    "items",
)


def _commands(command: click.Command, name: str) -> Iterator[str]:
    if isinstance(command, click.Group):
        for sub, one in command.commands.items():
            yield from _commands(one, f"{name} {sub}")
    for parameter in command.params:
        if isinstance(parameter, click.Option) and parameter.hidden:
            continue
        kind = "option" if isinstance(parameter, click.Option) else "argument"
        spelled = "/".join((*parameter.opts, *parameter.secondary_opts))
        bounds = parameter.type if isinstance(parameter.type, click.FloatRange | click.IntRange) else ""
        yield f"command {name} {kind} {spelled} {bounds}".strip()
    yield f"command {name}"


def _names() -> Iterator[str]:
    for name in dir(haploop):
        one = getattr(haploop, name)
        if inspect.ismodule(one):
            public = ((each, getattr(one, each)) for each in dir(one) if not each.startswith("_"))
            yield from (f"python haploop.{name}.{each}{_signature(value)}" for each, value in public)
        else:
            yield f"python haploop.{name}{_signature(one)}"
        if inspect.isclass(one):
            own = {
                name for base in one.__mro__ if base.__module__.startswith("haploop.") for name in vars(base)
            }
            for member, value in inspect.getmembers(one):
                if not member.startswith("_") and member in own:
                    yield f"python haploop.{name}.{member}{_signature(value)}"


def _signature(one: Any) -> str:
    """The parameters, without types: of which an annotation's wording would count as a change."""
    try:
        parameters = inspect.signature(one).parameters
    except (TypeError, ValueError):
        return ""
    return f"({', '.join(parameters)})"


def _keys(node: Any, path: str) -> Iterator[str]:
    """The schema's properties with their bounds; a description is no part of what a file may say."""
    if isinstance(node, dict):
        for key, value in node.get("properties", {}).items():
            one_of = [value, *value.get("anyOf", ()), value.get("items") or {}]
            bounds = " or ".join(
                str({word: one[word] for word in _BOUNDS if word in one}) for one in one_of if one
            )
            yield f"rig {path}{key} {bounds}"
        for key, value in node.items():
            below = (
                value.items() if key in ("properties", "$defs") and isinstance(value, dict) else [("", value)]
            )
            for name, one in below:
                yield from _keys(one, f"{path}{name}." if name else path)
    elif isinstance(node, list):
        for one in node:
            chosen = one.get("properties", {}) if isinstance(one, dict) else {}
            named = next((v["const"] for v in chosen.values() if isinstance(v, dict) and "const" in v), None)
            yield from _keys(one, f"{path}[{named}]." if named else path)


def _now() -> list[str]:
    installed = metadata.distribution("haploop").entry_points
    lines = {
        *_commands(cli, "haploop"),
        *_names(),
        *_keys(rig_schema(), ""),
        *(f"entry point {one.group} {one.name}" for one in installed),
        *(f"fault {kind}" for kind in FAULTS),
        *(f"read {name}" for name in READ),
        *(f"written {kind} as {name}" for kind, name in WRITTEN),
        *(f"rig file {path.stem}" for path in (_ROOT / "rigs").glob("*.toml")),
        *(
            f"exit {name} {value}"
            for name, value in vars(exits).items()
            if name.isupper() and type(value) is int
        ),
    }
    return sorted(lines)


if __name__ == "__main__":
    now = _now()
    if "--write" in sys.argv:
        _LIST.write_text("\n".join(now) + "\n", encoding="utf-8")
    kept = _LIST.read_text(encoding="utf-8").splitlines()
    changes = [
        line for line in difflib.unified_diff(kept, now, "kept", "now", n=0, lineterm="") if line[0] in "+-"
    ]
    print(f"{len(now)} names" + "".join(f"\n{line}" for line in changes))
    sys.exit(bool(changes) and "Keep the new list: python .ci/inventory.py --write")
