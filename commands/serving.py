"""What `haploop twin` serves of a rig: wires on one plant, at ports that were asked for."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import click

if TYPE_CHECKING:
    from ..mocks.plant import Plant

KINDS = {
    "ni-daqmx": "ni",
    "yocto-maxicoupler": "yocto",
    "serial-relay": "serial",
    "ofv-5000": "ofv",
    "keysight-33500": "scpi",
    "rigol-dg1000z": "scpi",
}
"""Served name of each driver's wire; a wire of another package has its driver's name."""
_MARK = "# Written by haploop twin"
"""Beginning of a rig file that may be written over."""


@dataclass(frozen=True)
class Asked:
    """What is to be served."""

    rig: str
    ports: Mapping[str, int] = field(default_factory=dict)
    """TCP ports by kind; others are free ones."""
    terminals: bool = False
    """True to serve serial lines at device files."""
    own_ports: bool = False
    """True to serve a hub on this computer at the port that the rig file says."""


@dataclass(frozen=True)
class Served:
    """What is served, as long as the context lasts."""

    plant: Plant
    addresses: dict[str, str]
    """By kind."""
    settings: dict[str, dict[str, Any]]
    """Keys of the tables of a rig file that point at what is served, by role."""
    others: list[str]
    """Instruments that have no protocol."""
    serial: dict[str, str]
    """What stands for each serial port that the rig file names."""
    visa: dict[str, str]
    """What stands for each VISA resource that the rig file names."""

    def write(self, path: Path, rig: str) -> None:
        """Write a rig file that points at what is served. Raises ConfigurationError for another file."""
        from ..base.errors import ConfigurationError  # noqa: PLC0415

        base = str(Path(rig).resolve()) if Path(rig).is_file() else rig
        lines = [
            f"{_MARK}: {rig} on simulated instruments, as long as that program runs.",
            f"base = {json.dumps(base)}",
            f"name = {json.dumps(Path(base).stem + '-served')}",
        ]
        for role, keys in self.settings.items():
            lines += ["", f"[{role}]", *(f"{key} = {json.dumps(value)}" for key, value in keys.items())]
        try:
            if path.exists() and not path.read_text(encoding="utf-8").startswith(_MARK):
                raise ConfigurationError(f"{path} exists and is another file: name a new one.")
            path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            why = getattr(error, "strerror", None) or "it is no text"
            raise ConfigurationError(f"{path} cannot be written ({why.lower()}): name a new file.") from None


def ports_of(text: str | None) -> dict[str, int]:
    """Ports by kind, of "ni=50051,yocto=4444". Raises click.UsageError for another text."""
    if text is None:
        return {}
    found: dict[str, int] = {}
    for part in text.split(","):
        name, _, number = part.strip().partition("=")
        if not name or not number.isdecimal() or not int(number) < 1 << 16 or name in found:
            raise click.UsageError(
                f"--port wants KIND=N,KIND=N, as ni=50051,yocto=4444, ports up to 65535, and not {text!r}"
            )
        found[name] = int(number)
    return found


@contextmanager
def served(asked: Asked) -> Iterator[Served]:
    """Serve wires on one plant, in real time.

    Raises ConfigurationError, and InstrumentError for a port that is in use.
    """
    from ..base import entry_points  # noqa: PLC0415
    from ..base.clock import RealClock  # noqa: PLC0415
    from ..base.errors import ConfigurationError  # noqa: PLC0415
    from ..base.validation import validate  # noqa: PLC0415
    from ..instruments import load_rig_file  # noqa: PLC0415
    from ..mocks.simulation import Simulation  # noqa: PLC0415

    file = load_rig_file(asked.rig)
    wires = entry_points.installed(entry_points.WIRES)
    others: list[str] = []
    with ExitStack() as stack:
        simulation = Simulation(file, RealClock())
        stack.callback(simulation.close)
        found = Served(simulation.plant, {}, {}, others, {}, {})
        for role, device in file.devices.items():
            driver: Any = entry_points.driver_class(device.driver, role)
            kind = KINDS.get(device.driver, device.driver)
            if device.driver not in wires:
                # The plant needs the instruments that are not served too, such as a laser.
                simulation.instrument(role, device, driver, "twin")
                others.append(f"{role} ({device.driver})")
                continue
            settings = validate(driver.Settings, device.settings, f"[{role}] of {file.name}")
            address = simulation.serve(device.driver, settings)
            port = asked.ports.get(kind, _own_port(settings) if asked.own_ports else 0)
            if port:
                address = _at(stack, address, kind, port)
            if asked.terminals and str(address.get("port", "")).startswith("socket://"):
                address = {**address, "port": _terminal(stack, address["port"])}
            # The first of the wire's settings is its address.
            found.addresses[kind] = str(next(iter(address.values())))
            found.settings[role] = address
            for key, names in (("port", found.serial), ("resource", found.visa)):
                if key in address and getattr(settings, key, None):
                    names[str(getattr(settings, key))] = str(address[key])
        if not found.addresses:
            raise ConfigurationError(f"The rig {file.name!r} has no instrument to serve: name another rig.")
        unknown = sorted(set(asked.ports) - set(found.addresses))
        if unknown:
            raise ConfigurationError(
                f"--port names {unknown[0]!r}, and what is served is {', '.join(found.addresses)}."
            )
        yield found


def _at(stack: ExitStack, address: Mapping[str, Any], kind: str, port: int) -> dict[str, Any]:
    """Serve the same at another port."""
    from ..base.errors import InstrumentError  # noqa: PLC0415
    from ..mocks.transport import faulty_line  # noqa: PLC0415

    try:
        return stack.enter_context(faulty_line(address, lambda _request: None, port))
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        raise InstrumentError(f"{kind} cannot be served at port {port} ({why}): name another.") from None


def _terminal(stack: ExitStack, url: str) -> str:
    from ..mocks.transport import pseudo_terminal  # noqa: PLC0415

    parts = urlsplit(url)
    return stack.enter_context(pseudo_terminal(str(parts.hostname), int(parts.port or 0)))


def _own_port(settings: Any) -> int:
    """Port of a hub that the rig file expects on this computer; 0 for any other."""
    parts = urlsplit(str(getattr(settings, "hub", "")))
    return (parts.port or 0) if parts.hostname in ("127.0.0.1", "localhost", "::1") else 0


def has_terminals() -> bool:
    """True where serial lines can be device files."""
    return os.name != "nt"
