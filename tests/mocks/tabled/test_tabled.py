"""Instruments of tables: unchanged code opens them, and what they received can be asserted."""

import json
import socket
import subprocess
import sys
import textwrap
import urllib.error
import urllib.request

import pytest
import pyvisa
import serial
from serial import Serial  # before any redirection, as modules under test do

from haploop.base.errors import ConfigurationError
from haploop.mocks.tabled import Instrument, Table, read_table
from haploop.mocks.transport import ReplyFault
from tests.raising import raises

ANSWERS = {
    "*IDN?": "ACME,PSU,1,1.0", "VOLT {volt}": "", "VOLT?": "{volt:.3f}", "OUTP {output}": "",
    "OUTP?": "{output:d}", "MEAS?": ["1", "2"],
}  # fmt: skip
STATE = {"volt": {"value": 0.0, "min": 0, "max": 30}, "output": False}


@pytest.mark.skipif(sys.platform == "win32", reason="serial lines are device files")
def test_a_serial_line(instrument_twin):
    pump = instrument_twin(
        "COM3", {"GET": "{rate:g} ml", "SET {rate}": "OK"}, state={"rate": 1.5}, end="\r\n"
    )
    for made in (Serial, serial.Serial):
        with made("COM3", 9600, timeout=5) as port:
            port.write(b"GET\r\nSET 4\r\n")
            assert [port.readline(), port.readline()] == [b"1.5 ml\r\n", b"OK\r\n"]
            port.write(b"SET 1.5\r\n")
            assert port.readline() == b"OK\r\n"
    assert pump.received == 2 * ["GET", "SET 4", "SET 1.5"]
    assert pump.state == {"rate": 1.5}
    for other in ("COM4", "/dev/ttyS0"):
        raises(serial.SerialException, "no simulated instrument", Serial, other)


@pytest.mark.parametrize("name", ["GPIB0::5::INSTR", "TCPIP0::192.0.2.10::5025::SOCKET"])
def test_a_visa_resource(name, instrument_twin):
    supply = instrument_twin(name, ANSWERS, state=STATE)
    own = {"read_termination": "\n", "write_termination": "\n"} if "SOCKET" in name else {}
    manager = pyvisa.ResourceManager()
    assert manager.list_resources("?*") == (str(pyvisa.rname.to_canonical_name(name)),)
    with manager.open_resource(name, **own) as it:
        it.write("VOLT 12.5")
        it.write("OUTP ON")
        assert it.query("VOLT?") == "12.500" and it.query("OUTP?") == "1"
        assert [it.query("MEAS?") for _ in range(3)] == ["1", "2", "2"]
    assert supply.received == ["VOLT 12.5", "OUTP ON", "VOLT?", "OUTP?", "MEAS?", "MEAS?", "MEAS?"]
    raises(pyvisa.VisaIOError, "no simulated instrument", manager.open_resource, "GPIB0::6::INSTR")
    manager.close()


def test_http_and_a_socket(instrument_twin):
    hub = instrument_twin(
        "http://192.0.2.20", {"GET /volt": '{"volt": {volt}}', "PUT /volt {volt}": "OK"}, state={"volt": 1.0}
    )
    put = urllib.request.Request("http://192.0.2.20/volt", data=b"2.5", method="PUT")
    assert urllib.request.urlopen(put, timeout=5).read() == b"OK"
    with urllib.request.urlopen("http://192.0.2.20/volt", timeout=5) as answer:
        assert json.load(answer) == {"volt": 2.5} and answer.headers["Content-Type"] == "application/json"
    assert hub.received == ["PUT /volt 2.5", "GET /volt"]
    meter = instrument_twin("meter.Example:5025", {"READ?": "1.25"})
    with socket.create_connection(("Meter.Example", 5025), 5) as link:
        link.sendall(b"READ?\n")
        assert link.recv(100) == b"1.25\n"
    meter.faults.append(ReplyFault("disconnect"))
    with socket.create_connection(("meter.example", 5025), 5) as link:
        link.sendall(b"READ?\n")
        assert link.recv(100) == b""
    with pytest.raises(urllib.error.HTTPError, match="404") as refused:
        urllib.request.urlopen("http://192.0.2.20/other", timeout=5)
    refused.value.close()
    hub.unknown.clear()


def test_nothing_is_redirected_afterwards():
    assert serial.Serial is Serial and Serial.open.__module__.startswith("serial")
    assert socket.getaddrinfo.__module__ == "socket" and "connect" not in vars(socket.socket)
    assert pyvisa.ResourceManager.open_resource.__module__ == "pyvisa.highlevel"


@pytest.mark.long
def test_a_command_that_is_not_in_the_table_fails_the_test(tmp_path):
    (tmp_path / "pytest.ini").write_text("[pytest]")
    (tmp_path / "test_it.py").write_text(
        textwrap.dedent("""
        import socket
        def send(text):
            with socket.create_connection(("192.0.2.21", 1), 5) as link:
                link.sendall(text)
                return link.recv(9)
        def test_silent(instrument_twin):
            instrument_twin("192.0.2.21:1", {"A {x}": "ok"}, state={"x": {"value": 0, "max": 3}})
            send(b"A 2\\nA 4\\nB\\nA 1\\n")
            import time; time.sleep(0.2)
        def test_error(instrument_twin):
            it = instrument_twin("192.0.2.21:1", {"A": "ok"}, error="?")
            assert send(b"B\\n") == b"?\\n" and it.unknown == ["B"]
    """)
    )
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False)
    assert "2 passed, 1 error" in done.stdout, done.stdout
    assert "192.0.2.21:1 was sent 'A 4', 'B', which its table does not have" in done.stdout


WRONG = {
    '[answers]\n"V?" = "{volt}"': "the answer to 'V\\?' names 'volt', which is no state",
    '[answers]\n"V {vlt}" = ""\n[state]\nvolt = 1': "names 'vlt', which is no state; did you mean 'volt'",
    '[answers]\n"V {v} {v}" = ""\n[state]\nv = 1': "names 'v', twice",
    '[answers]\n"V?" = "{v:d}"\n[state]\nv = 1.5': "does not fit the state",
    '[answers]\n"V?" = []': '"V\\?|\'V\\?\' has no answer: write ""',
    '[answer]\n"V?" = "1"': "line 1: unknown key 'answer'; did you mean 'answers'",
    "[state]\nv = 1": "the key 'answers' is missing",
    '[answers]\n"V?" = "1"\n[state]\nv = { value = 1, maximum = 2 }': "unknown key",
    '[answers]\n"V?" = 1': "answers.V\\?",
}


@pytest.mark.parametrize("text", WRONG)
def test_a_wrong_table_is_one_sentence(text, tmp_path):
    path = tmp_path / "it.toml"
    path.write_text(text)
    with pytest.raises(ConfigurationError, match=WRONG[text]) as raised:
        read_table(path)
    assert "\n" not in str(raised.value) and "pydantic" not in str(raised.value)


@pytest.mark.parametrize(
    ("kept", "sent", "after"),
    [
        *((1, "2", 2), (1, "2.5", 1), (1.0, "2", 2.0), (1.0, "x", 1.0), (True, "off", False),
            (True, "2", True)),
        *(("a", "b c", "b c"), ({"value": 1, "min": 0, "max": 3}, "3", 3), ({"value": 1, "min": 0}, "-1", 1)),
    ],
)  # fmt: skip
def test_a_value_is_of_the_kind_that_is_kept(kept, sent, after):
    it = Instrument(Table.model_validate({"answers": {"S {x}": "ok"}, "state": {"x": kept}}))
    changed = after != (kept["value"] if isinstance(kept, dict) else kept)
    assert (it.answer(f"S {sent}") == "ok") == changed
    assert it.state["x"] == after and type(it.state["x"]) is type(after)


def test_a_name_that_is_taken_or_none_is_refused(instrument_twin):
    instrument_twin("192.0.2.21:1", {"A": "b"})
    instrument_twin("COM3", {"A": "b"})
    for name in ("192.0.2.21:1", "https://192.0.2.20", "ftp://x", "", "a b", "com3", "http://x:99999",
        "x:70000"):  # fmt: skip
        raises(ConfigurationError, "", instrument_twin, name, {"A": "b"})


PROGRAM = """
import json, sys, urllib.request
import pyvisa, serial
with serial.Serial("COM3", timeout=5) as port:
    port.write(b"RATE?\\n")
    rate = port.readline().decode()
page = urllib.request.urlopen("http://192.0.2.20:8080/a", timeout=5).read().decode()
manager = pyvisa.ResourceManager()
with manager.open_resource("GPIB0::5::INSTR") as supply:
    identity = supply.query("*IDN?")
try:
    serial.Serial("COM9")
except serial.SerialException as error:
    refused = str(error)
try:
    urllib.request.urlopen("http://192.0.2.99/", timeout=5)
except OSError as error:
    elsewhere = str(error)
print(json.dumps([rate, page, identity, refused, elsewhere]))
"""


@pytest.mark.long
@pytest.mark.skipif(sys.platform == "win32", reason="serial lines are device files")
def test_a_bench_has_instruments(tmp_path):
    (tmp_path / "pump.toml").write_text('[answers]\n"RATE?" = "{rate}"\n[state]\nrate = 1.5\n')
    (tmp_path / "supply.toml").write_text('[answers]\n"*IDN?" = "ACME"\n')
    (tmp_path / "hub.toml").write_text('[answers]\n"GET /a" = "b"\n')
    (tmp_path / "bench.toml").write_text(
        '[instruments]\n"COM3" = "pump.toml"\n"GPIB0::5::INSTR" = "supply.toml"\n'
        '"http://192.0.2.20:8080" = "hub.toml"\n'
    )
    (tmp_path / "program.py").write_text(PROGRAM)
    twin = [sys.executable, "-m", "haploop", "twin", "ni", "--bench", "bench.toml"]
    done = subprocess.run(
        [*twin, "--", sys.executable, "program.py"],
        cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    rate, page, identity, refused, elsewhere = json.loads(done.stdout)
    assert (rate, page, identity) == ("1.5\n", "b", "ACME")
    assert "COM9 is not opened" in refused and "192.0.2.99:80 is not connected to" in elsewhere
