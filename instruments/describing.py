"""A new rig file from a shipped one, and what this computer has for it."""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from ..base.entry_points import optional
from ..base.files import check_destination, new_file
from .config import RigFile, load_rig_file, problems_of, rig_text, shipped_rig

# What this computer has that a rig could use: NI cards, serial ports, VISA resources, sound cards.
#
# Nothing is opened, and nothing is written to: drivers and systems are asked for their lists.


@dataclass(frozen=True)
class FoundCard:
    """An NI device that has analog terminals: its name (Dev1, cDAQ1Mod2) and product."""

    name: str
    product: str


@dataclass(frozen=True)
class Found:
    """What was found, each by the name that a rig file uses and a description."""

    cards: tuple[FoundCard, ...] = ()
    ports: tuple[tuple[str, str], ...] = ()
    visa: tuple[tuple[str, str], ...] = ()
    sounds: tuple[tuple[str, str], ...] = ()
    missing: tuple[str, ...] = ()
    """What could not be looked for, each as a sentence."""


Thing = TypeVar("Thing")


def look_for_hardware() -> Found:
    """Look for all of it."""
    missing: list[str] = []

    def of(what: str, find: Callable[[], list[Thing]]) -> tuple[Thing, ...]:
        try:
            return tuple(find())
        except Exception as error:  # of a library of others nearly any, and none of it matters here
            said = " ".join(str(error).split()).partition(". ")[0].rstrip(".:") or type(error).__name__
            reason = textwrap.shorten(said, 160, placeholder=" ...")
            missing.append(f"{what} could not be looked for ({reason}).")
            return ()

    return Found(
        cards=of("NI cards", _cards),
        ports=of("Serial ports", _ports),
        visa=of("VISA resources", _visa),
        sounds=of("Sound cards", _sounds),
        missing=tuple(missing),
    )


def _cards() -> list[FoundCard]:
    from nidaqmx.system import System  # noqa: PLC0415 - slow to load, here as below

    return [
        FoundCard(device.name, device.product_type)
        for device in System.local().devices
        if len(device.ai_physical_chans) or len(device.ao_physical_chans)
    ]


def _ports() -> list[tuple[str, str]]:
    from serial.tools.list_ports import comports  # noqa: PLC0415

    return [(port.device, port.description) for port in comports()]


def _visa() -> list[tuple[str, str]]:
    import pyvisa  # noqa: PLC0415

    # An installed library knows its resources; pyvisa-py would call for them on the network.
    names = pyvisa.ResourceManager("@ivi").list_resources()
    return [(name, "") for name in names if not name.startswith("ASRL")]


def _sounds() -> list[tuple[str, str]]:
    sounddevice = optional("sounddevice", "sound", "A sound card")
    return [
        (str(device["name"]), f"{device['max_input_channels']} in, {device['max_output_channels']} out")
        for device in sounddevice.query_devices()
        if device["max_input_channels"] and device["max_output_channels"]
    ]


# A new rig file: a shipped one with its comments, for a person to edit.
#
# What was found on this computer is filled in. Every other line that depends on a lab's own parts and wiring
# is marked, because a figure of an example is a wrong figure for all other parts.

LOOK_UP = "LOOK UP"
"""Marks, in a comment, a line whose value is an example's."""
_FIXED = {"driver", "input", "channel", "channels", "kind", "quantity", "patches", "button_point"}
"""Keys that choose among what the file itself names."""
_OURS = {"", "simulation", "recalibration", "abort"}
"""Tables that no part's figures are in."""
_TABLE = re.compile(r"\s*\[+\s*([\w.\"-]+)\s*\]+")
_KEY = re.compile(r"([\w-]+)\s*=\s*")
_STRING = re.compile(r'"(?:[^"\\]|\\.)*"')
_HEAD = """\
# Made like the shipped rig {like}. A line with {mark} has an example's value: put your own in, from a
# manual, a calibration sheet or your wiring, and take the mark away.
# `haploop rig check {path}` says what is left.
"""


def new_rig(path: str | Path, like: str, found: Found) -> RigFile:
    """Write the new rig file `path` like a shipped one, with what was `found`; return it as it is read.

    Raises ConfigurationError for an unknown name, and when the file exists or cannot be written.
    """
    path = Path(path)
    check_destination(path)
    text = _renamed(shipped_rig(like), found)
    head = _HEAD.format(like=like, mark=LOOK_UP, path=path.name) + "".join(
        f"# Found on this computer: {sentence}\n" for sentence in _listed(found)
    )
    table, lines = "", []
    for line in text.splitlines():
        header = _TABLE.match(line)
        table = header[1] if header else table
        key = _KEY.match(line)
        if key is None or header:
            lines.append(line)
        elif not table and key[1] == "name":
            lines.append(f"name = {json.dumps(path.stem)}")
        elif not table and key[1] == "base":
            lines.append(f"{line.rstrip()}    # {LOOK_UP}: whatever is not stated below is that example's")
        else:
            lines.append(_filled(table, key[1], line, found))
    with new_file(path) as part:
        part.write_text(head + "\n".join(lines) + "\n", encoding="utf-8")
    return load_rig_file(path)


def new_rig_on(path: str | Path, base: str, name: str = "") -> RigFile:
    """Write the new rig file `path` on a base (a rig file, or a shipped rig's name); return it as it is read.

    `name` is the rig's, by default the file's. Raises ConfigurationError when the base is not valid, and when
    the file exists or cannot be written.

    For example:

        >>> haploop.new_rig_on("lab.toml", base="usb-6211").name
        'lab'
    """
    path = Path(path)
    check_destination(path)
    load_rig_file(base)
    found = str(Path(base).resolve()) if Path(base).is_file() else base
    with new_file(path) as part:
        part.write_text(
            f"base = {json.dumps(found)}\nname = {json.dumps(name or path.stem)}\n", encoding="utf-8"
        )
    return load_rig_file(path)


def rig_problems(path: str | Path) -> list[str]:
    """Every error of a rig file, each a sentence with its line; an error that hides others comes alone."""
    return problems_of(path)


def to_look_up(path: str | Path) -> list[str]:
    """Lines of a rig file that are still marked, each with its number. Raises ConfigurationError."""
    text = rig_text(Path(path))
    return [
        f"line {number}: {line.partition('#')[0].strip()}"
        for number, line in enumerate(text.splitlines(), 1)
        if LOOK_UP in line.partition("#")[2] and not line.startswith("#")
    ]


def _listed(found: Found) -> list[str]:
    """What was found, a line for each kind."""
    kinds: dict[str, Sequence[tuple[str, str]]] = {
        "NI cards": [(card.name, card.product) for card in found.cards],
        "serial ports": found.ports,
        "VISA resources": found.visa,
        "sound cards": found.sounds,
    }
    shown = {
        kind: ", ".join(f"{name} ({about})" if about else name for name, about in things) or "none"
        for kind, things in kinds.items()
    }
    listed = [f"{kind}: {one}" for kind, one in shown.items()]
    return [" ".join(one.split()) for one in (*listed, *found.missing)]


def _renamed(text: str, found: Found) -> str:
    """Give each card the name that this computer has for the same product."""
    left = list(found.cards)
    names: dict[str, str] = {}
    line = next((line for line in text.splitlines() if line.startswith("devices = ")), "")
    for name, product in re.findall(r"(\w+) = \"([^\"]+)\"", line):
        card = next((one for one in left if one.product == product), None)
        if card is not None:
            left.remove(card)
            names[name] = card.name
    if not names:
        return text
    wanted = "|".join(map(re.escape, names))
    return re.sub(rf"\b({wanted})(?=/| = \")", lambda at: names[at[1]], text)


def _filled(table: str, key: str, line: str, found: Found) -> str:
    """A line with what was found in it, or marked."""
    lists = {"port": found.ports, "resource": found.visa, "device": found.sounds}
    if table in _OURS or key in _FIXED:
        return line
    if key in lists and len(lists[key]) == 1:
        return f"{key} = {json.dumps(lists[key][0][0])}    # found on this computer, the only one"
    if key == "devices":
        wanted = re.findall(r"(\w+) = \"([^\"]+)\"", line)
        if all((name, product) in {(c.name, c.product) for c in found.cards} for name, product in wanted):
            return f"{line}    # found on this computer"
    code = line[: _STRING.sub(lambda text: "x" * len(text[0]), line).find("#")] if "#" in line else line
    if "#" in line and len(code) < len(line) - 1:
        return f"{code}# {LOOK_UP}: {line[len(code) :].lstrip('# ')}"
    return f"{line}    # {LOOK_UP}"
