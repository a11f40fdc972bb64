"""Each instrument of each rig missing, busy, wrong, silent, without its library, without permission.

The product is generated: every shipped rig, times every instrument that is hardware, times every state that
its connection can be in. The real driver meets that state where it
leaves haploop: at NI's library, a serial port, VISA, a hub, PortAudio or OpenCV. The rig's other instruments
are there, as twins.
"""

import errno
import json
import socket
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import pyvisa
import serial
from nidaqmx.errors import DaqNotFoundError, RpcError
from pyvisa.constants import StatusCode

from haploop.base import entry_points
from haploop.commands.options import ChosenRig
from haploop.console.data_folder import DataFolder
from haploop.console.worker.worker import Worker
from haploop.instruments import RigFile, load_rig_file
from haploop.instruments.config import shipped_rigs
from haploop.instruments.daq import ni_cards, ni_sessions, serial_adc
from haploop.instruments.daq.ni_sessions import Sessions
from haploop.instruments.driver import hardware_of
from haploop.instruments.rig import opening
from haploop.instruments.safety import machine
from haploop.mocks.simulation import Simulation
from haploop.nidaqmx_twin import NiTwin
from tests.raising import raising

try:
    import sounddevice
except (ImportError, OSError):  # neither it nor PortAudio is installed with haploop[test]
    sounddevice = None
try:
    import cv2
except ImportError:
    cv2 = None

Broken = Callable[[pytest.MonkeyPatch, dict[str, Any], ExitStack], Mapping[str, Any]]
"""Brings the connection of an instrument with these settings into a state; returns settings to change."""
QUICK = {"timeout": 0.05}


def doing(target: Any, name: str, value: Any, **changed: Any) -> Broken:
    """Replace something of a library."""

    def broken(patch: pytest.MonkeyPatch, settings: dict[str, Any], stack: ExitStack) -> Mapping[str, Any]:
        patch.setattr(target, name, value)
        return changed

    return broken


# NI-DAQmx


def ni_with(change: Callable[[dict[str, str]], dict[str, str]]) -> Broken:
    def broken(patch: pytest.MonkeyPatch, settings: dict[str, Any], stack: ExitStack) -> Mapping[str, Any]:
        stack.enter_context(NiTwin(change(dict(settings["devices"]))))
        return {}

    return broken


def ni_busy(patch: pytest.MonkeyPatch, settings: dict[str, Any], stack: ExitStack) -> Mapping[str, Any]:
    """Another program has reserved the inputs and outputs of every card."""
    twin = stack.enter_context(NiTwin(dict(settings["devices"])))
    for name in settings["devices"]:
        twin.fail(name, "reserved")
    return {}


def ni_silent(patch: pytest.MonkeyPatch, settings: dict[str, Any], stack: ExitStack) -> Mapping[str, Any]:
    """A device server accepts connections, and says nothing."""
    patch.setattr(ni_sessions, "_CONNECT", 0.2)
    patch.setattr(ni_cards, "_PATIENCE", 0.2)
    return {"server": stack.enter_context(mute())}


@contextmanager
def mute(answer: bytes = b"") -> Iterator[str]:
    """The address of who accepts connections and gives each the same `answer`, or none."""
    listener = socket.create_server(("127.0.0.1", 0))
    links = []

    def serve() -> None:
        while True:
            try:
                link = listener.accept()[0]
            except OSError:
                return
            links.append(link)
            if answer:
                link.recv(4096)
                link.sendall(answer)
                link.close()

    threading.Thread(target=serve, daemon=True).start()
    try:
        yield f"127.0.0.1:{listener.getsockname()[1]}"
    finally:
        listener.shutdown(socket.SHUT_RDWR)
        listener.close()
        for link in links:
            link.close()


# Serial ports


class _SerialPort:
    """A port at which something answers the same to everything, or nothing."""

    def __init__(self, answer: bytes) -> None:
        self._answer, self._left = answer, b""

    def open(self) -> None:
        pass

    def reset_input_buffer(self) -> None:
        self._left = b""

    def write(self, data: bytes) -> int:
        self._left += self._answer
        return len(data)

    def read(self, count: int) -> bytes:
        if not self._left:
            threading.Event().wait(0.002)
        read, self._left = self._left[:count], self._left[count:]
        return read

    def read_until(self, end: bytes = b"\n", size: int | None = None) -> bytes:
        return self.read(self._left.find(end) + 1 or len(self._left) or 1)

    def close(self) -> None:
        pass


def port(error: int) -> Broken:
    found = serial.SerialException(error, f"could not open port: [Errno {error}]")
    return doing(serial, "serial_for_url", raising(found))


def port_answering(answer: bytes) -> Broken:
    def broken(patch: pytest.MonkeyPatch, settings: dict[str, Any], stack: ExitStack) -> Mapping[str, Any]:
        patch.setattr(serial, "serial_for_url", lambda *_, **__: _SerialPort(answer))
        patch.setattr(serial_adc, "_LATE", 0.02)
        return {} if "frame" in settings else QUICK  # a board that streams is waited for on the rig's clock

    return broken


# VISA


def visa(error: Exception) -> Broken:
    return doing(pyvisa, "ResourceManager", raising(error))


def visa_saying(answer: bytes | None) -> Broken:
    def read(_: int = 1) -> bytes:
        if answer is None:
            raise pyvisa.VisaIOError(StatusCode.error_timeout)
        return answer

    session = SimpleNamespace(
        write_raw=len, read_bytes=read, read_raw=read, close=lambda: None, resource_class="INSTR"
    )
    manager = SimpleNamespace(open_resource=lambda *_, **__: session)
    return doing(pyvisa, "ResourceManager", lambda *_: manager, **QUICK)


# Hubs


def hub(answer: bytes | None) -> Broken:
    def broken(patch: pytest.MonkeyPatch, settings: dict[str, Any], stack: ExitStack) -> Mapping[str, Any]:
        at = "127.0.0.1:1" if answer is None else stack.enter_context(mute(answer))
        return {"hub": f"http://{at}", **QUICK}

    return broken


def http(status: str, body: str = "") -> bytes:
    return f"HTTP/1.1 {status}\r\nConnection: close\r\n\r\n{body}".encode()


EMPTY = json.dumps({"module": {}, "services": {"whitePages": []}})

# Sound cards and cameras


def card(channels: int, at: str = "", error: Exception | None = None) -> Broken:
    """A card with so many channels, and a function of the library, or all streams, that fails."""
    stream = SimpleNamespace(active=True, start=lambda: None, close=lambda **_: None)
    found = {"name": "card", "max_input_channels": channels, "max_output_channels": channels}

    def broken(patch: pytest.MonkeyPatch, settings: dict[str, Any], stack: ExitStack) -> Mapping[str, Any]:
        for name in ("query_devices", "Stream", "InputStream", "OutputStream"):
            right = (lambda *_: found) if name == "query_devices" else lambda **_: stream
            failing = error is not None and name.endswith(at)
            patch.setattr(sounddevice, name, raising(error) if failing and error else right)
        return {}

    return broken


def without(module: str) -> Broken:
    def broken(patch: pytest.MonkeyPatch, settings: dict[str, Any], stack: ExitStack) -> Mapping[str, Any]:
        patch.setitem(sys.modules, module, None)
        return {}

    return broken


def camera(opened: bool, frame: Any = None) -> Broken:
    seen = SimpleNamespace(
        isOpened=lambda: opened, read=lambda: (frame is not None, frame), release=lambda: None,
        set=lambda *_: True, get=lambda *_: 0.0,
    )  # fmt: skip
    return doing(cv2, "VideoCapture", lambda *_: seen)


_PortAudioError = getattr(sounddevice, "PortAudioError", OSError)
_SOUND: dict[str, Broken] = {
    "missing": card(8, "query_devices", ValueError("No input device matching 'card'")),
    "busy": card(8, "Stream", _PortAudioError("Device unavailable [PaErrorCode -9985]")),
    "wrong": card(0),
    "silent": card(8),
    "without library": without("sounddevice"),
    "without PortAudio": doing(
        entry_points.importlib, "import_module", raising(OSError("PortAudio library not found"))
    ),
    "without permission": card(8, "Stream", _PortAudioError("Unanticipated host error")),
}
_SERIAL: dict[str, Broken] = {
    "missing": port(errno.ENOENT), "busy": port(errno.EBUSY), "wrong": port_answering(b"\xff\xfe?\r\n"),
    "another": port_answering(b"ACME 5\n"), "silent": port_answering(b""),
    "without permission": port(errno.EACCES),
}  # fmt: skip
_VISA: dict[str, Broken] = {
    "missing": visa(pyvisa.VisaIOError(StatusCode.error_resource_not_found)),
    "busy": visa(pyvisa.VisaIOError(StatusCode.error_resource_locked)),
    "wrong": visa_saying(b"ACME,5,0,1\n"),
    "silent": visa_saying(None),
    "without library": visa(ValueError("Could not locate a VISA implementation.")),
    "without permission": visa(pyvisa.VisaIOError(StatusCode.error_no_permission)),
}
STATES: dict[str, dict[str, Broken]] = {
    "ni-daqmx": {
        "missing": ni_with(lambda named: {f"Other{n}": product for n, product in enumerate(named.values())}),
        "busy": ni_busy,
        "wrong": ni_with(lambda named: dict.fromkeys(named, "USB-6009")),
        "silent": ni_silent,
        "without library": doing(Sessions, "system", raising(DaqNotFoundError("no NI-DAQmx"))),
        "without permission": doing(Sessions, "system", raising(RpcError(7, "PERMISSION_DENIED"))),
    },
    "sound-card": _SOUND, "sound-card-output": _SOUND, "serial-adc": _SERIAL, "ofv-5000": _SERIAL,
    "serial-relay": _SERIAL, "keysight-33500": _VISA, "rigol-dg1000z": _VISA,
    "yocto-maxicoupler": {
        "missing": hub(None),
        "busy": hub(http("200 OK", EMPTY)),  # a program that has the box by USB hides it from the hub
        "wrong": hub(http("200 OK", "<html>a router</html>")),
        "silent": hub(b""),
        "without permission": hub(http("401 Unauthorized")),
    },
    "opencv": {
        "missing": camera(False), "wrong": camera(True, np.zeros((50, 60), np.uint8)), "silent": camera(True),
        "without library": without("cv2"),
    },
}  # fmt: skip
"""What can be wrong with the instrument of a driver, and how to bring it about."""
SAYS: dict[tuple[str, str], str] = {
    ("ni-daqmx", "missing"): "There is no NI device", ("ni-daqmx", "busy"): "is in use by another program",
    ("ni-daqmx", "wrong"): "is a USB-6009, and the rig file says",
    ("ni-daqmx", "silent"): "No NI device server answers at 127.0.0.1:",
    ("ni-daqmx", "without library"): "The NI-DAQmx driver is not installed",
    ("serial-adc", "missing"): "The serial ADC at COM3 cannot be opened (no such file or directory)",
    ("ofv-5000", "missing"): "OFV-5000 at COM3 cannot be opened (no such file or directory",
    ("serial-relay", "missing"): "The relay board at COM9 cannot be talked to (no such file or directory)",
    ("yocto-maxicoupler", "missing"): "Connection refused): start VirtualHub",
    ("keysight-33500", "wrong"): "says that it is a ACME 5, which this driver is not for: correct 'driver'",
    ("rigol-dg1000z", "wrong"): "says that it is a ACME 5, which this driver is not for: correct 'driver'",
}  # fmt: skip
"""Words of a driver's sentence on a state."""
_SIX = {"missing", "busy", "wrong", "silent", "without library", "without permission"}
CANNOT = {
    # pyserial and the hub's HTTP come with haploop; OpenCV says of a camera that it opened, or not.
    **{name: {"without library"} for name in ("serial-adc", "ofv-5000", "serial-relay", "yocto-maxicoupler")},
    "opencv": {"busy", "without permission"},
}
"""States that a connection cannot be in."""
LIBRARIES = {"sound-card": sounddevice, "sound-card-output": sounddevice, "opencv": cv2}


DESCRIBED: dict[str, tuple[str, dict[str, dict[str, Any]]]] = {
    "serial relay, rigol": (
        "bench",
        {
            "relay": {
                "driver": "serial-relay", "port": "COM9", "patches": dict.fromkeys("A", 0), "rating": 250,
            },
            "generator": {
                "driver": "rigol-dg1000z",
                "resource": "TCPIP::192.0.2.10::INSTR",
                "output": "generator",
            },
        },
    ),
    "streams": ("minimal", {"streams": {"driver": "lsl", "inlets": {"eeg": {"type": "EEG"}}}}),
}  # fmt: skip
"""Rigs with the drivers that no shipped one has: one that each is like, and its own tables."""


def described(name: str) -> RigFile:
    base, own = DESCRIBED.get(name, (name, {}))
    return RigFile.model_validate({**load_rig_file(base).model_dump(), **own})


def rigs() -> Iterator[tuple[str, RigFile]]:
    """Shipped rigs, one for each set of drivers (to open, the others are the same), and described ones."""
    seen = set()
    for name in [*shipped_rigs(), *DESCRIBED]:
        file = described(name)
        drivers = tuple(sorted((role, device.driver) for role, device in file.devices.items()))
        if drivers not in seen:
            seen.add(drivers)
            yield name, file


def cases() -> Iterator[Any]:
    for name, file in rigs():
        for role, device in file.devices.items():
            for state in STATES.get(device.driver, {}):
                if name in DESCRIBED and role not in DESCRIBED[name][1]:
                    continue
                # Where it opens all the same, doctor goes on to examine a whole table: seconds to minutes.
                opens = state in ("busy", "wrong", "another", "silent", "without permission")
                whole = opens and (name == "no-ni" or role == "camera")
                marks = [pytest.mark.long] * whole
                if device.driver in LIBRARIES and LIBRARIES[device.driver] is None:
                    marks = [pytest.mark.skip(reason=f"the library of {device.driver} is not installed")]
                yield pytest.param(
                    name, role, state, id=f"{name}-{role}-{state}".replace(" ", "-"), marks=marks
                )


class Present:
    """In place of the driver of an instrument that is there: its twin."""

    def __init__(self, role: str, driver: Any, device: Any, world: Callable[[], Simulation]) -> None:
        self.Settings = driver.Settings
        self._role, self._driver, self._device, self._world = role, driver, device, world

    @staticmethod
    def hardware(_: object) -> tuple[str, ...]:
        return ()

    def open(self, _settings: object, _clock: object) -> Any:
        return self._world().instrument(self._role, self._device, self._driver, "twin")


@pytest.fixture
def lab(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Callable[[str, str, str], RigFile]]:
    """Brings an instrument of a rig into a state, and lets commands open that rig's hardware."""
    with ExitStack() as stack:

        def bring(name: str, role: str, state: str) -> RigFile:
            loaded = described(name)
            device = loaded.devices[role]
            changed = STATES[device.driver][state](monkeypatch, device.settings, stack)
            settings = {**device.settings, **changed, "driver": device.driver}
            rig = RigFile.model_validate({**loaded.model_dump(), role: settings, "simulate": None})
            drivers, worlds = opening._drivers, list[Simulation]()

            def real_drivers(file: RigFile) -> Iterator[tuple[str, Any, Any]]:
                for other, there, driver in drivers(file):
                    found = driver if other == role else Present(other, driver, there, lambda: worlds[-1])
                    yield other, there, found

            def clock() -> Any:
                worlds.append(Simulation(rig))
                return worlds[-1].clock

            monkeypatch.setattr(opening, "_drivers", real_drivers)
            monkeypatch.setattr(opening, "RealClock", clock)
            monkeypatch.setattr(ChosenRig, "load", lambda _: rig)
            monkeypatch.setenv("HAPLOOP_STATE", str(tmp_path / "state"))
            monkeypatch.setattr(machine, "folder", lambda: tmp_path)  # locks of these ports and cards
            return rig

        yield bring


def test_the_product_is_whole():
    """Each driver is in a rig, and each that opens something is met in each state of its connection."""
    drivers, opening_something = set(), set()
    for _, file in rigs():
        for role, device in file.devices.items():
            driver = entry_points.driver_class(device.driver, role)
            drivers.add(device.driver)
            if hardware_of(device.driver, driver, driver.Settings(**device.settings)):
                opening_something.add(device.driver)
    own = {one.name for one in entry_points.entries(entry_points.DRIVERS) if one.value.startswith("haploop.")}
    assert drivers == own
    assert opening_something == set(STATES)
    assert {name: _SIX - set(met) for name, met in STATES.items() if _SIX - set(met)} == CANNOT


def is_a_sentence(said: str) -> bool:
    *_, last = said.splitlines()
    return last.startswith("Error: ") and last.endswith((".", "?")) and "Internal error" not in last


@pytest.mark.parametrize(("name", "role", "state"), list(cases()))
def test_what_is_wrong_with_an_instrument_is_a_table_or_a_sentence(lab, name, role, state, run, tmp_path):
    rig = lab(name, role, state)
    doctor = run("doctor --rig", name, "--json")
    print(doctor.output)
    assert doctor.exit_code in (1, 3), doctor.output
    assert SAYS.get((rig.devices[role].driver, state), "") in doctor.output
    if doctor.stdout:
        red = [one for one in json.loads(doctor.stdout)["findings"] if one["status"] == "red"]
        assert red and all(one["sentence"].endswith((".", "?")) for one in red), red
    else:
        assert is_a_sentence(doctor.stderr)
    unused = {"record": ("camera", "player"), "calibrate": ("camera", "adc")}
    for command, more in {"record": ("push", "-p", "P01", "-n", 1), "calibrate": ()}.items():
        if doctor.exit_code == 3 or role not in unused[command]:
            result = run(command, *more, "--rig", name, "--out", tmp_path / command)
            print(command, result.output)
            assert result.exit_code in (2, 3) and is_a_sentence(result.stderr), result.output
    worker = Worker(rig, None, DataFolder(tmp_path, tmp_path / "history"), real_time=False)
    worker._abandoned.set()  # nobody answers a question
    worker.command("start", {"kind": "preflight"})
    worker._run(*worker._jobs.take())
    job = worker.board["job"]
    print(job)
    assert job["state"] in ("done", "failed", "unconfirmed") and "Internal error" not in job["sentence"], job
