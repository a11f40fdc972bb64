"""The wire of a Yocto-MaxiCoupler: a look-alike of VirtualHub on a simulated box.

Our own driver, the vendor's native library and its pure Python one can all use it. What they ask
and what they need was measured (hardware.md, section 4c): requests of theirs carry no HTTP version,
so no ordinary HTTP server parses them; the end of the connection ends the reply, and a
Content-Length would make one of them wait for 20 s; /not.byn never ends. What a real hub does was
not seen here: an attribute that this one does not know is answered with 404.
"""

from __future__ import annotations

import json
import math
import socket
import socketserver
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Literal, Self, cast
from urllib.parse import parse_qsl, unquote, urlsplit

from instruments.yocto import Yocto
from mocks.relay import Contacts, RelayBox, box_in

__all__ = ["ReplyFault", "YoctoHub", "wire"]

_SERIAL = "MXCOUPL1-1A2B3"  # the form is known, the first part is an estimate
_HUB_SERIAL = "VIRTHUB0-0000000001"
_FIRMWARE = "60000"
_LONGEST_REQUEST = 8192
_POLL = 0.05
"""Real seconds between two looks at the box on behalf of a stream of notifications."""


@dataclass
class ReplyFault:
    """A misbehaviour of the hub or the network, put into `YoctoHub.faults`.

    It strikes requests whose path contains `path`, after letting `after` of them through, `times`
    times. Commands reach the box all the same, except with "not found", which is what a hub says
    whose module is unplugged.
    """

    kind: Literal["silence", "delay", "drip", "garbled", "truncated", "not found", "password", "disconnect"]
    path: str = ""
    after: int = 0
    times: float = math.inf
    delay: float = 0.05
    """Real seconds: before the reply with "delay", between its bytes with "drip"."""
    seen: int = 0
    fired: int = 0

    def strikes(self, path: str) -> bool:
        """Whether it does so now; counts itself."""
        if self.path not in path:
            return False
        self.seen += 1
        struck = self.seen > self.after and self.fired < self.times
        self.fired += struck
        return struck


class YoctoHub:
    """A hub with one module, serving on loopback while its context lasts."""

    def __init__(
        self, box: RelayBox, serial: str | None = None, port: int = 0, host: str = "127.0.0.1"
    ) -> None:
        self.serial = serial or _SERIAL
        self.faults: list[ReplyFault] = []
        self.closing = threading.Event()
        self._box = box
        self._server = _Server((host, port), self)
        self.url = f"http://{host}:{self._server.server_address[1]}"
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.02,), daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Stop serving and cut every connection, as a hub that is killed does. May be called again."""
        if self.closing.is_set():
            return
        self.closing.set()
        if self._thread.is_alive():
            self._server.shutdown()
            self._thread.join()
        self._server.cut()
        self._server.server_close()

    def answer(self, target: str) -> bytes:
        """The whole reply to a request for `target`."""
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

    def values(self) -> dict[int, str]:
        """What each channel advertises: A is open, B is closed."""
        return {channel: "AB"[state.closed] for channel, state in self._box.states().items()}

    def _attribute(self, path: str, query: str) -> bytes:
        """Set what the query says, in either form in use, or read one attribute."""
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
        """Whether the module knows that attribute and takes that value."""
        channels = {f"relay{channel}": channel for channel in self._box.states()}
        if function not in channels:
            return False
        channel = channels[function]
        try:
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
                    self._box.limit(channel, int(value) / 1000)
                case _:
                    return False
        except (KeyError, ValueError):
            return False
        return True

    def _info(self) -> dict[str, Any]:
        return {
            "serialNumber": _HUB_SERIAL,
            "productName": "VirtualHub",
            "firmwareRelease": _FIRMWARE,
            "protocol": "",
            "port": [f"http:{self._server.server_address[1]}"],
            "securityMode": 1,
        }

    def _listing(self) -> dict[str, Any]:
        modules = [
            _white_page(_HUB_SERIAL, "VirtualHub", "/api", 0),
            _white_page(self.serial, "Yocto-MaxiCoupler", f"/bySerial/{self.serial}/api", 1),
        ]
        relays = [
            {
                "baseType": 0,
                "hardwareId": f"{self.serial}.relay{channel}",
                "logicalName": "",
                "advertisedValue": value,
                "index": channel - 1,
            }
            for channel, value in self.values().items()
        ]
        return {
            "module": _module(_HUB_SERIAL, "VirtualHub"),
            "network": {"adminPassword": "", "userPassword": "", "httpPort": 0, "advertisedValue": ""},
            "services": {"whitePages": modules, "yellowPages": {"Relay": relays}},
        }

    def _tree(self) -> dict[str, Any]:
        limits, delays = self._box.limits(), self._box.delays()
        return {"module": _module(self.serial, "Yocto-MaxiCoupler")} | {
            f"relay{channel}": {
                "logicalName": "",
                "advertisedValue": "AB"[state.closed],
                "state": int(state.closed),
                "stateAtPowerOn": 1,
                "maxTimeOnStateA": 0,
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
    """Serve a hub on a box in the plant; gives the settings that point the driver at it."""
    with YoctoHub(box_in(plant, settings.patches), serial=settings.serial) as hub:
        yield {"hub": hub.url}


def _ok(body: str) -> bytes:
    return b"HTTP/1.1 200 OK\r\nContent-Type: text/plain\r\nConnection: close\r\n\r\n" + body.encode()


_NOT_FOUND = b"HTTP/1.1 404 Not Found\r\nConnection: close\r\n\r\n404 not found"
_PASSWORD = b'HTTP/1.1 401 Unauthorized\r\nWWW-Authenticate: Digest realm="YoctoDevices"\r\n\r\n'


def _ms(seconds: float) -> int:
    """As the module counts: 0 is no time set, and what is running has at least one left."""
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


class _Server(socketserver.ThreadingTCPServer):
    daemon_threads = True
    request_queue_size = 64

    def __init__(self, address: tuple[str, int], hub: YoctoHub) -> None:
        self.hub = hub
        self._links: set[socket.socket] = set()
        self._guard = threading.Lock()
        super().__init__(address, _Connection)

    def process_request(self, request: Any, client_address: Any) -> None:
        with self._guard:
            self._links.add(request)
        super().process_request(request, client_address)

    def shutdown_request(self, request: Any) -> None:
        with self._guard:
            self._links.discard(request)
        super().shutdown_request(request)

    def cut(self) -> None:
        """Wake every thread that waits for its client."""
        with self._guard:
            links = list(self._links)
        for link in links:
            with suppress(OSError):
                link.shutdown(socket.SHUT_RDWR)


class _Connection(socketserver.BaseRequestHandler):
    request: socket.socket

    def handle(self) -> None:
        hub = cast(_Server, self.server).hub
        with suppress(OSError):
            target = self._target()
            if target is None:
                return
            if target.startswith("/not.byn"):
                self._notify(hub)
            else:
                self._reply(hub, target)

    def _target(self) -> str | None:
        """What is asked for; the HTTP version may be missing, an empty line always ends the request."""
        request = b""
        while b"\r\n\r\n" not in request:
            more = self.request.recv(4096)
            request += more
            if not more or len(request) > _LONGEST_REQUEST:
                return None
        words = request.split(b"\r\n", 1)[0].split()
        if len(words) < 2 or words[0] != b"GET":
            return None
        return words[1].decode("ascii", "replace")

    def _reply(self, hub: YoctoHub, target: str) -> None:
        fault = next((f for f in hub.faults if f.strikes(target)), None)
        kind = fault.kind if fault else None
        reply = _NOT_FOUND if kind == "not found" else hub.answer(target)
        head, end, body = reply.partition(b"\r\n\r\n")
        match kind:
            case "silence":
                self.request.recv(1)  # returns when the client gives up, or the hub is closed
                return
            case "disconnect":
                return
            case "password":
                reply = _PASSWORD
            case "garbled":
                reply = head + end + bytes(b ^ 0x5A for b in body)
            case "truncated":
                reply = reply[: len(head + end) + len(body) // 2]
            case "delay" if fault:
                hub.closing.wait(fault.delay)
            case "drip" if fault:
                for position in range(len(reply)):
                    self.request.sendall(reply[position : position + 1])
                    if hub.closing.wait(fault.delay):
                        return
                return
        self.request.sendall(reply)

    def _notify(self, hub: YoctoHub) -> None:
        """The endless stream: a position to start from, then each channel's changes."""
        self.request.sendall(b"HTTP/1.1 200 OK\r\n\r\n" + b"YN01@0\n")
        sent = hub.values()
        while not hub.closing.wait(_POLL):
            values = hub.values()
            changed = {c: v for c, v in values.items() if v != sent[c]}
            lines = "".join(f"y{chr(65 + 1)}{chr(48 + c - 1)}{v}\n" for c, v in changed.items())
            self.request.sendall(lines.encode() or b"\n")
            sent = values
