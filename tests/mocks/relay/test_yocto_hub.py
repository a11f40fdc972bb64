"""The hub as the vendor's two libraries see it: their recorded requests, byte for byte, on a socket."""

import json
import socket
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from haploop.base.clock import VirtualClock
from haploop.mocks.relay import SimulatedBox
from haploop.mocks.relay.yocto_hub import YoctoHub

NATIVE_INFO = (
    b"GET /info.json HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n"
    b"Accept-Encoding:\r\nUser-Agent: Yoctopuce\r\n\r\n"
)
NATIVE_NOTIFY = b"GET /not.byn \r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n"
PURE_NOTIFY = b"GET /not.byn \r\n\r\n"


class Bench:
    def __init__(self) -> None:
        self.clock = VirtualClock()
        self.box = SimulatedBox({1: "A", 3: "C"}, self.clock, np.random.default_rng(3))
        self.hub = YoctoHub(self.box)

    def link(self) -> socket.socket:
        host, port = self.hub.url.removeprefix("http://").split(":")
        return socket.create_connection((host, int(port)), 2)

    def ask(self, request: bytes) -> bytes:
        """The whole reply: whatever comes until the hub closes the connection."""
        with self.link() as link:
            link.sendall(request)
            return b"".join(iter(lambda: link.recv(4096), b""))

    def module(self, path: str) -> bytes:
        return self.ask(f"GET /bySerial/{self.hub.serial}{path} \r\n\r\n".encode())

    def relay(self, channel: int) -> dict[str, Any]:
        _, body = self.module("/api.json?fw=60000").split(b"\r\n\r\n", 1)
        found: dict[str, Any] = json.loads(body)[f"relay{channel}"]
        return found


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench()
    with bench.hub:
        yield bench


def test_says_where_and_how_it_is_spoken_to(bench):
    head, body = bench.ask(NATIVE_INFO).split(b"\r\n\r\n", 1)
    assert head.startswith(b"HTTP/1.1 200 OK")
    info = json.loads(body)
    assert info["port"] == [f"http:{bench.hub.url.split(':')[-1]}"]
    assert info["securityMode"] == 1


def test_a_request_without_a_version_is_answered_without_a_length(bench):
    head, body = bench.ask(b"GET /api.json \r\n\r\n").split(b"\r\n\r\n", 1)
    assert b"content-length" not in head.lower()
    services = json.loads(body)["services"]
    assert {m["serialNumber"] for m in services["whitePages"]} >= {bench.hub.serial}
    assert [r["hardwareId"] for r in services["yellowPages"]["Relay"]] == [
        f"{bench.hub.serial}.relay{channel}" for channel in range(1, 9)
    ]


def test_the_libraries_short_form_is_answered_shortly_and_that_of_public_programs_in_http(bench):
    assert bench.module("/api/relay3/state?state=1&.") == b"0K\r\n\r\n"
    assert bench.relay(3)["state"] == 1
    assert bench.relay(3)["advertisedValue"] == "B"
    assert bench.module("/api/relay3/state?state=0&.") == b"0K\r\n\r\n"
    assert [(patch, closed) for patch, closed, _ in bench.box.take(1)] == [("C", True), ("C", False)]
    assert bench.module("/api?scr=&ctx=relay1&state=1").startswith(b"HTTP/1.1 200")
    assert bench.relay(1)["state"] == 1
    assert bench.module("/api/relay1/state").endswith(b"\r\n\r\nB")


def test_pulse_toggle_and_limit(bench):
    bench.module("/api/relay1/delayedPulseTimer?delayedPulseTimer=100%3A20&.")
    assert (bench.relay(1)["state"], bench.relay(1)["delayedPulseTimer"]["moving"]) == (0, 1)
    bench.module("/api/relay3/state?state=X&.")
    bench.module("/api/relay4/pulseTimer?pulseTimer=50&.")
    assert bench.relay(4)["pulseTimer"] == 50
    bench.module("/api/relay3/maxTimeOnStateB?maxTimeOnStateB=2000&.")
    assert bench.relay(3)["maxTimeOnStateB"] == 2000
    bench.clock.sleep(5)
    assert bench.relay(3)["state"] == 1, "a limit counts from the next closing"
    assert bench.relay(4)["state"] == 0
    (_, _, closed), (_, _, opened) = [e for e in bench.box.take(bench.clock.now()) if e[0] == "A"]
    assert 0.103 <= closed <= 0.111, "100 ms after the command arrived, and the contact's own time"
    assert opened - closed == pytest.approx(0.02)


@pytest.mark.parametrize(
    "path",
    [
        "/api/relay9/state?state=1&.", "/api/relay1/state?state=7&.",
        "/api/relay1/pulseTimer?pulseTimer=soon&.", "/api/relay1/beacon?beacon=1&.", "/api/relay1/nothing",
        "/apis",
    ],
)  # fmt: skip
def test_what_the_module_does_not_know_is_refused_and_changes_nothing(bench, path):
    assert b" 404 " in bench.module(path).split(b"\r\n")[0]
    assert bench.box.take(1) == []
    assert b" 404 " in bench.ask(b"GET /bySerial/RELAYLO1-B263A/api.json \r\n\r\n")


@pytest.mark.parametrize("request_", [NATIVE_NOTIFY, PURE_NOTIFY])
def test_the_stream_of_notifications_tells_each_change_until_the_hub_is_closed(bench, request_):
    with bench.link() as link, link.makefile("rb") as stream:
        link.sendall(request_)
        lines = (line for line in stream if line.strip())
        assert next(lines).startswith(b"HTTP/1.1 200")
        assert next(lines) == b"YN01@0\n"
        bench.module("/api/relay3/state?state=1&.")
        assert next(lines) == b"yB2B\n"
        bench.module("/api/relay3/state?state=0&.")
        assert next(lines) == b"yB2A\n"
        bench.hub.close()
        assert list(lines) == []


def test_a_client_that_says_nothing_does_not_keep_the_hub_open(bench):
    with bench.link() as silent, bench.link() as half, bench.link() as wrong:
        half.sendall(b"GET /api.json ")
        wrong.sendall(b"POST /api.json \r\n\r\n")
        assert wrong.recv(1) == b""
        bench.hub.close()
        bench.hub.close()
        assert silent.recv(1) == b""
        assert half.recv(1) == b""


def put(bench: Bench, function: str, **attributes: object) -> bytes:
    """Set attributes as the native library does; return the head of the reply."""
    words = "&".join(f"{name}={value}" for name, value in attributes.items())
    return bench.module(f"/api/{function}?{words}&.").split(b"\r\n")[0]


def told(bench: Bench) -> dict[str, Any]:
    _, body = bench.module("/api.json?fw=60000").split(b"\r\n\r\n", 1)
    found: dict[str, Any] = json.loads(body)
    return found


@pytest.mark.parametrize(
    ("function", "name", "value"),
    [
        ("module", "logicalName", "box-1"),
        ("module", "luminosity", 20),
        ("module", "beacon", 1),
        ("module", "userVar", 7),
        ("relay3", "logicalName", "patch_C"),
        ("relay3", "stateAtPowerOn", 2),
        ("relay3", "maxTimeOnStateA", 5000),
        ("relay3", "maxTimeOnStateB", 4000),
    ],
)
def test_an_attribute_that_the_vendors_library_sets_takes(bench, function, name, value):
    assert put(bench, function, **{name: value}) == b"0K"
    bench.clock.sleep(0.1)
    assert told(bench)[function][name] == value


@pytest.mark.parametrize(
    ("function", "name", "value"),
    [
        ("module", "luminosity", 101),
        ("module", "beacon", 2),
        ("module", "serialNumber", "X"),
        ("module", "logicalName", "two%20words"),
        ("relay3", "stateAtPowerOn", 3),
        ("relay3", "maxTimeOnStateA", -1),
        ("relay3", "maxTimeOnStateB", "soon"),
        ("relay9", "logicalName", "x"),
        ("relay3", "colour", 1),
    ],
)
def test_what_does_not_take_is_refused(bench, function, name, value):
    before = told(bench)
    assert b"404" in put(bench, function, **{name: value})
    assert told(bench) == before


def test_what_is_saved_to_the_flash_comes_back(bench):
    put(bench, "relay1", logicalName="kept", maxTimeOnStateB=3000)
    assert told(bench)["module"]["persistentSettings"] == 2
    put(bench, "module", persistentSettings=1)
    put(bench, "relay1", logicalName="lost", maxTimeOnStateB=1000)
    put(bench, "module", luminosity=5)
    put(bench, "module", persistentSettings=0)
    bench.clock.sleep(0.1)
    found = told(bench)
    assert (found["relay1"]["logicalName"], found["relay1"]["maxTimeOnStateB"]) == ("kept", 3000)
    assert (found["module"]["luminosity"], found["module"]["persistentSettings"]) == (50, 0)


def test_a_channel_closes_when_its_longest_time_open_is_over(bench):
    put(bench, "relay1", maxTimeOnStateA=2000)
    bench.clock.sleep(5)
    assert bench.relay(1)["state"] == 0  # from the next opening on
    put(bench, "relay1", state=1)
    bench.clock.sleep(0.1)
    put(bench, "relay1", state=0)
    bench.clock.sleep(1.5)
    assert bench.relay(1)["state"] == 0
    bench.clock.sleep(1)
    assert bench.relay(1)["state"] == 1
    assert [closed for _, closed, _ in bench.box.take(bench.clock.now())] == [True, False, True]
