"""What this computer has that a rig could use: NI cards, serial ports, VISA resources, sound cards.

Nothing is opened, and nothing is written to: drivers and systems are asked for their lists.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from ...base.extras import optional


@dataclass(frozen=True)
class FoundCard:
    """An NI device that has terminals: its name (Dev1, cDAQ1Mod2), product, and analog terminals."""

    name: str
    product: str
    inputs: int
    outputs: int


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

    found = []
    for device in System.local().devices:
        inputs, outputs = len(device.ai_physical_chans), len(device.ao_physical_chans)
        if inputs or outputs:
            found.append(FoundCard(device.name, device.product_type, inputs, outputs))
    return found


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
