"""Lines of text: how a serial port is opened, other ends of a line, resources that need another library."""

import importlib.util
from typing import Any

import pytest
from pydantic import ValidationError

from haploop.base.clock import RealClock
from haploop.base.errors import InstrumentError
from haploop.instruments.relay.serial_relay import SerialRelay
from haploop.instruments.relay.yocto import Yocto
from haploop.instruments.transport import SerialSettings, VisaLine, serial_line
from haploop.instruments.transport.text_line import Port, TextLine
from haploop.instruments.vibrometer.ofv5000 import Ofv5000
from tests.raising import raises


def test_a_port_is_opened_as_the_rig_file_says(monkeypatch):
    how = SerialSettings(
        parity="even", data_bits=7, stop_bits=2, handshake="rts-cts", dtr=False, rts=True, open_wait=0.2
    )
    states: list[tuple[bool, bool]] = []
    made = serial_line.serial.serial_for_url

    def watched(*given: Any, **settings: Any) -> Any:
        port = made(*given, **settings)
        whole = port.open

        def opened() -> None:
            states.append((port.dtr, port.rts))
            whole()

        port.open = opened
        return port

    monkeypatch.setattr(serial_line.serial, "serial_for_url", watched)
    begun = RealClock().now()
    port = how.opened("loop://", 9600, 0.1, 0.1)
    assert (port.parity, port.bytesize, port.stopbits, port.rtscts, port.xonxoff) == ("E", 7, 2, True, False)
    # The lines have their states before the port is open: a board would restart at an edge.
    assert states == [(False, True)]
    assert RealClock().now() - begun >= 0.2
    port.close()


@pytest.mark.parametrize(("settings", "key"), [
    ({"stop_bits": 3}, "stop_bits"), ({"parity": "e"}, "parity"), ({"handshake": "rts"}, "handshake"),
])  # fmt: skip
def test_what_no_port_has_is_refused(settings, key):
    raises(ValidationError, key, SerialSettings, **settings)


def test_each_serial_instrument_takes_them():
    laser = Ofv5000.Settings(port="COM3", channel="laser", scale=0.005, parity="odd", terminator="cr")
    board = SerialRelay.Settings(port="COM5", patches={"A": 0}, rating=50, dtr=False, open_wait=2.0)
    assert (laser.parity, board.dtr, board.open_wait) == ("odd", False, 2.0)


class Far(Port):
    """Answers what it is told to, byte by byte."""

    def __init__(self, reply: bytes) -> None:
        self.sent, self._reply = b"", reply

    def send(self, data: bytes) -> None:
        self.sent += data

    def receive(self, wait: float) -> bytes:
        first, self._reply = self._reply[:1], self._reply[1:]
        return first

    def close(self) -> None:
        pass


@pytest.mark.parametrize("end", [b"\n", b"\r", b"\r\n"])
def test_a_line_ends_as_it_is_told_to(end):
    far = Far(b"5mm/s/V" + end)
    line = TextLine("It", lambda: far, "its 'port'", 0.2, end)
    line.send("Get")
    assert line.receive("Get") == "5mm/s/V" and far.sent == b"Get" + end


@pytest.mark.parametrize(("end", "reply", "sentence"), [
    (b"\n", b"5\r", "ends in a carriage return, not in a line feed: set its terminator to LF"),
    (b"\r", b"5\n", "ends in a line feed, not in a carriage return: set its terminator to CR"),
    (b"\r\n", b"5\n", "ends in a line feed, not in a carriage return and a line feed"),
])  # fmt: skip
def test_another_end_is_named(end, reply, sentence):
    line = TextLine("It", lambda: Far(reply), "its 'port'", 0.05, end)
    raises(InstrumentError, sentence, line.receive, "Get")


@pytest.mark.parametrize(("resource", "module", "extra"), [
    ("USB0::0x0957::0x2C07::MY52::INSTR", "usb", "haploop[usb]"),
    ("GPIB0::10::INSTR", "gpib_ctypes", "haploop[gpib]"),
])  # fmt: skip
def test_a_resource_without_its_library_says_what_to_install(resource, module, extra):
    if importlib.util.find_spec(module) is not None:
        pytest.skip(f"{module} is installed")
    line = VisaLine("The generator", resource, "@py", 0.5)
    error = raises(InstrumentError, "", line.send, "*IDN?")
    assert extra in error and "NI-VISA" in error and len(error.splitlines()) == 1


@pytest.mark.parametrize(("hub", "given", "waits"), [
    ("http://127.0.0.1:4444", None, 0.1),
    ("http://localhost", None, 0.1),
    ("http://192.0.2.7", None, 1.0),
    ("http://192.0.2.7", 0.4, 0.4),
])  # fmt: skip
def test_a_hub_in_the_network_has_more_time(hub, given, waits):
    assert Yocto.Settings(patches={"A": 1}, hub=hub, patience=given).waits == waits
