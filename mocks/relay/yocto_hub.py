"""Wire of a Yocto-MaxiCoupler: an imitation of VirtualHub on a simulated box.

haploop's driver and the vendor's native and pure Python libraries can all use it. Their requests and
needs were measured (docs/hardware.md, "Relay box"): requests may carry no HTTP version, so an ordinary
HTTP server does not parse them; a reply ends when the connection closes, because a Content-Length makes
one library wait for 20 s; /not.byn never ends. No real hub was observed: an attribute unknown to this
one is answered with 404.
"""

from __future__ import annotations

import json
import math
import re
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import parse_qsl, unquote, urlsplit

from ...instruments.relay.yocto import Yocto
from ..transport import Loopback, ReplyFault
from .box import Contacts, SimulatedBox, box_in

_HUB_SERIAL = "VIRTHUB0-0000000001"
_FIRMWARE = "60000"
_INDEX = 1
"""The module's index in the hub's list; the hub itself is 0."""
_LONGEST_REQUEST = 8192
_KEPT = ("logicalName", "luminosity", "stateAtPowerOn", "maxTimeOnStateA", "maxTimeOnStateB")
"""Attributes that a module keeps in its flash, once they are saved."""
_LOADED, _SAVED, _MODIFIED = range(3)
"""Values of `persistentSettings`: as in the flash, just saved, other than in the flash."""
_POLL = 0.05
"""Interval (s of real time) at which a notification stream polls the box."""


class YoctoHub(Loopback):
    """A hub with one module, served on loopback while its context lasts."""

    def __init__(self, box: SimulatedBox, serial: str | None = None, port: int = 0) -> None:
        self.faults: list[ReplyFault] = []
        self.at_power_on: dict[int, int] = {}
        """`stateAtPowerOn` of channels whose own is not 1, open."""
        self._box = box
        self._serial = serial
        self._names: dict[str, str] = {}
        """Logical names that were given, by function."""
        self._module = {"luminosity": 50, "beacon": 0, "userVar": 0, "persistentSettings": 0}
        self._flash = self._kept()
        super().__init__(self._serve, port)
        self.url = f"http://{self.address}"

    @property
    def serial(self) -> str:
        """Serial number of the module: no two have one. The form is known; the first part is an estimate."""
        return self._serial or f"MXCOUPL1-{self.port:05}"

    def _serve(self, link: socket.socket) -> None:
        target = _target(link)
        if target is None:
            return
        if target.startswith("/not.byn"):
            self._notify(link)
            return
        fault = next((f for f in self.faults if f.fires(target)), None)
        if fault is None:
            link.sendall(self._answer(target))
            return
        special = {"not found": _NOT_FOUND, "password": _PASSWORD}
        reply = special.get(fault.kind) or self._answer(target)
        fault.send(link, reply, self.closing, spare=reply.index(b"\r\n\r\n") + 4)

    def _notify(self, link: socket.socket) -> None:
        """Send the endless notification stream: a start position, then each channel's changes."""
        # Before the client hears the start position: what it then changes must be told.
        sent = self._values()
        link.sendall(b"HTTP/1.1 200 OK\r\n\r\n" + b"YN01@0\n")
        while not self.closing.wait(_POLL):
            values = self._values()
            changed = {c: v for c, v in values.items() if v != sent[c]}
            lines = "".join(f"y{chr(65 + _INDEX)}{chr(48 + c - 1)}{v}\n" for c, v in changed.items())
            link.sendall(lines.encode() or b"\n")
            sent = values

    def _answer(self, target: str) -> bytes:
        """Return the whole reply to a request for `target`."""
        url = urlsplit(target)
        path = unquote(url.path)
        if path == "/info.json":
            return _ok(json.dumps(self._info()))
        if path == "/api.json":
            return _ok(json.dumps(self._listing()))
        root = f"/bySerial/{self.serial}/api"
        if path == f"{root}.json":
            return _ok(json.dumps(self._tree()))
        if path != root and not path.startswith(f"{root}/"):
            return _NOT_FOUND
        return self._attribute(path[len(root) + 1 :], url.query)

    def _values(self) -> dict[int, str]:
        """Return each channel's advertised value: A is open, B is closed."""
        return {channel: "AB"[state.closed] for channel, state in self._box.states().items()}

    def _attribute(self, path: str, query: str) -> bytes:
        """Set the attributes in the query, in either of the two forms in use, or read one attribute."""
        function, _, attribute = path.partition("/")
        asked = parse_qsl(query, keep_blank_values=True)
        if asked:
            names = dict(asked)
            function = names.pop("ctx", function)
            short = "." in names
            settings = {k: v for k, v in names.items() if k not in ("scr", ".")}
            done = [self._set(function, name, value) for name, value in settings.items()]
            if not done or not all(done):
                return _NOT_FOUND
            return b"0K\r\n\r\n" if short else _ok("OK")
        tree = self._tree()
        if function.endswith(".json") and function[:-5] in tree:
            return _ok(json.dumps(tree[function[:-5]]))
        value = tree.get(function, {}).get(attribute)
        if value is None:
            return _NOT_FOUND
        return _ok("AB"[value] if attribute == "state" else str(value))

    def _set(self, function: str, name: str, value: str) -> bool:
        """Set an attribute; return False when the module does not know it or refuses the value."""
        channels = {f"relay{channel}": channel for channel in self._box.states()}
        try:
            if name == "logicalName" and function in (*channels, "module"):
                self._names[function] = _name(value)
            elif function == "module":
                self._set_module(name, int(value))
            elif function in channels:
                self._set_channel(channels[function], name, value)
            else:
                return False
        except (KeyError, ValueError):
            return False
        if name in _KEPT:
            self._module["persistentSettings"] = _MODIFIED
        return True

    def _set_module(self, name: str, value: int) -> None:
        """Set an attribute of the module. Raises KeyError, ValueError."""
        if name == "persistentSettings" and value == _SAVED:
            self._flash = self._kept()
        elif name == "persistentSettings" and value == _LOADED:
            self._restore()
        elif not 0 <= value <= {"luminosity": 100, "beacon": 1, "userVar": (1 << 31) - 1}[name]:
            raise ValueError(name)
        self._module[name] = value

    def _kept(self) -> dict[str, Any]:
        """What is saved to the flash."""
        limits = {n: 0.0 if math.isinf(s) else s for n, s in self._box.limits().items()}
        opened = {n: 0.0 if math.isinf(s) else s for n, s in self._box.open_limits().items()}
        return {
            "names": dict(self._names),
            "luminosity": self._module["luminosity"],
            "at_power_on": dict(self.at_power_on),
            "limits": limits,
            "open_limits": opened,
        }

    def _restore(self) -> None:
        self._names = dict(self._flash["names"])
        self._module["luminosity"] = self._flash["luminosity"]
        self.at_power_on = dict(self._flash["at_power_on"])
        for channel in self._box.states():
            self._box.limit(channel, self._flash["limits"][channel])
            self._box.limit_open(channel, self._flash["open_limits"][channel])

    def _set_channel(self, channel: int, name: str, value: str) -> None:
        """Set an attribute of a relay. Raises KeyError, ValueError."""
        match name:
            case "state" | "output" if value in ("X", "-1"):
                self._box.toggle(channel)
            case "state" | "output":
                self._box.set_state(channel, {"0": False, "1": True, "A": False, "B": True}[value])
            case "pulseTimer":
                self._box.pulse(channel, int(value) / 1000)
            case "delayedPulseTimer":
                delay, length = value.split(":")
                self._box.pulse(channel, int(length) / 1000, int(delay) / 1000)
            case "maxTimeOnStateB":
                self._box.limit(channel, _time(value))
            case "maxTimeOnStateA":
                self._box.limit_open(channel, _time(value))
            case "stateAtPowerOn":
                self.at_power_on[channel] = {"0": 0, "1": 1, "2": 2}[value]
            case _:
                raise KeyError(name)

    def _info(self) -> dict[str, Any]:
        return {
            "serialNumber": _HUB_SERIAL,
            "productName": "VirtualHub",
            "firmwareRelease": _FIRMWARE,
            "protocol": "",
            "port": [f"http:{self.port}"],
            "securityMode": 1,
        }

    def _listing(self) -> dict[str, Any]:
        modules = [
            _white_page(_HUB_SERIAL, "VirtualHub", "/api", 0),
            _white_page(self.serial, "Yocto-MaxiCoupler", f"/bySerial/{self.serial}/api", _INDEX)
            | {"logicalName": self._names.get("module", ""), "beacon": self._module["beacon"]},
        ]
        relays = [
            {
                "baseType": 0,
                "hardwareId": f"{self.serial}.relay{channel}",
                "logicalName": self._names.get(f"relay{channel}", ""),
                "advertisedValue": value,
                "index": channel - 1,
            }
            for channel, value in self._values().items()
        ]
        return {
            "module": _module(_HUB_SERIAL, "VirtualHub"),
            "network": {"adminPassword": "", "userPassword": "", "httpPort": 0, "advertisedValue": ""},
            "services": {"whitePages": modules, "yellowPages": {"Relay": relays}},
        }

    def _tree(self) -> dict[str, Any]:
        limits, delays, opened = self._box.limits(), self._box.delays(), self._box.open_limits()
        module = _module(self.serial, "Yocto-MaxiCoupler") | self._module
        return {"module": module | {"logicalName": self._names.get("module", "")}} | {
            f"relay{channel}": {
                "logicalName": self._names.get(f"relay{channel}", ""),
                "advertisedValue": "AB"[state.closed],
                "state": int(state.closed),
                "stateAtPowerOn": self.at_power_on.get(channel, 1),
                "maxTimeOnStateA": _ms(opened[channel]),
                "maxTimeOnStateB": _ms(limits[channel]),
                "output": int(state.closed),
                "pulseTimer": _ms(state.remaining),
                "delayedPulseTimer": {"target": 0, "ms": 0, "moving": int(delays[channel] < math.inf)},
                "countdown": _ms(delays[channel]),
            }
            for channel, state in self._box.states().items()
        }


@contextmanager
def wire(settings: Yocto.Settings, plant: Contacts) -> Iterator[dict[str, object]]:
    """Serve a hub on a box in the plant; yield the settings that point the driver at it."""
    with YoctoHub(box_in(plant, settings.patches), serial=settings.serial) as hub:
        yield {"hub": hub.url}


def _target(link: socket.socket) -> str | None:
    """Read a request and return its target, or None. The HTTP version may be missing; an empty line ends
    the request.
    """
    request = b""
    while b"\r\n\r\n" not in request:
        more = link.recv(4096)
        request += more
        if not more or len(request) > _LONGEST_REQUEST:
            return None
    words = request.split(b"\r\n", 1)[0].split()
    if len(words) < 2 or words[0] != b"GET":
        return None
    return words[1].decode("ascii", "replace")


def _ok(body: str) -> bytes:
    return b"HTTP/1.1 200 OK\r\nContent-Type: text/plain\r\nConnection: close\r\n\r\n" + body.encode()


_NOT_FOUND = b"HTTP/1.1 404 Not Found\r\nConnection: close\r\n\r\n404 not found"
_PASSWORD = b'HTTP/1.1 401 Unauthorized\r\nWWW-Authenticate: Digest realm="YoctoDevices"\r\n\r\n'


def _name(text: str) -> str:
    """A logical name. Raises ValueError for one that the module would not take."""
    if not re.fullmatch(r"[A-Za-z0-9_-]{0,19}", text):
        raise ValueError(text)
    return text


def _time(text: str) -> float:
    """A time in ms as seconds. Raises ValueError."""
    if not 0 <= int(text) < 1 << 31:
        raise ValueError(text)
    return int(text) / 1000


def _ms(seconds: float) -> int:
    """Convert to the module's milliseconds: 0 means no time is set, a running timer shows at least 1."""
    return max(1, math.floor(seconds * 1000 + 1e-6)) if math.isfinite(seconds) else 0


def _module(serial: str, product: str) -> dict[str, Any]:
    return {
        "productName": product,
        "serialNumber": serial,
        "logicalName": "",
        "productId": 0,
        "productRelease": 1,
        "firmwareRelease": _FIRMWARE,
        "persistentSettings": 0,
        "luminosity": 50,
        "beacon": 0,
        "upTime": 1000,
        "usbCurrent": 50,
        "rebootCountdown": 0,
        "userVar": 0,
    }


def _white_page(serial: str, product: str, url: str, index: int) -> dict[str, Any]:
    return {
        "serialNumber": serial,
        "logicalName": "",
        "productName": product,
        "productId": 0,
        "networkUrl": url,
        "beacon": 0,
        "index": index,
    }
