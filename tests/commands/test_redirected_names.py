"""A program under `haploop twin` opens simulated instruments by whatever name, and no real one."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

PROGRAM = """
import json, os, socket, sys, urllib.request
import nidaqmx, pyvisa, serial, serial.serialposix
import grpc
from nidaqmx import GrpcSessionOptions
manager, said = pyvisa.ResourceManager(), {}


def asked(name, open_it):
    try:
        said[name] = str(open_it())
    except Exception as error:
        said[name] = f"{type(error).__name__}: {error}"


def identity(name):
    with manager.open_resource(name, read_termination="\\n", write_termination="\\n", timeout=2000) as one:
        return one.query("*IDN?" if "5025" in name else "GetDevInfo,Controller,0,Name")


def remote(address):
    options = GrpcSessionOptions(grpc.insecure_channel(address), "")
    return nidaqmx.system.System.remote(options).devices.device_names


for name in json.loads(sys.argv[1]):
    asked(name, lambda: identity(name))
for name in json.loads(sys.argv[2]):
    asked(name, lambda: serial.Serial(name, timeout=1).close())
asked("own class", lambda: serial.serialposix.Serial("/dev/ttyUSB9"))
asked("url", lambda: serial.serial_for_url("socket://192.0.2.1:23"))
asked("bare", lambda: manager.open_bare_resource("TCPIP0::192.0.2.11::5025::SOCKET"))
asked("termination", lambda: manager.open_resource("TCPIP0::192.0.2.10::5025::SOCKET").read_termination)
asked("hub", lambda: urllib.request.urlopen("http://192.0.2.7:4444/api.json", timeout=2))
asked("hub here", lambda: socket.create_connection(("127.0.0.1", 4444), 2))
asked("server", lambda: remote("192.0.2.8:31763"))
asked("twin's server", lambda: remote("localhost:" + os.environ["HAPLOOP_NI_TWIN"].rpartition(":")[2]))
asked("cards", lambda: nidaqmx.system.System.local().devices.device_names)
asked("listed", lambda: manager.list_resources("?*"))
asked("GPIB", lambda: manager.list_resources("GPIB?*"))
try:
    import sounddevice
except (ImportError, OSError):
    said["sound"] = "no PortAudio"
else:
    asked("sound", lambda: sounddevice.OutputStream())
print(json.dumps(said))
"""
GENERATOR = ["TCPIP::192.0.2.10::5025::SOCKET", "TCPIP0::192.0.2.10::5025::SOCKET"]
GENERATOR += ["tcpip0::192.0.2.10::5025::socket"]
LASER = ["ASRL3::INSTR", "ASRLCOM3::INSTR", "asrl3::instr"]
OTHERS = ["TCPIP0::192.0.2.11::5025::SOCKET", "ASRL4::INSTR", "GPIB0::7::INSTR", "USB0::1::2::3::INSTR"]
OTHERS += ["TCPIP1::192.0.2.10::5025::SOCKET", "no name"]

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="serial lines are device files")


def said_by_a_program(folder: Path, rig: str, *options: str) -> dict[str, Any]:
    program = folder / "program.py"
    program.write_text(PROGRAM)
    visa = json.dumps([*GENERATOR, *LASER, *OTHERS])
    ports = json.dumps(["COM3", "com3", "COM4", "/dev/ttyS0"])
    ended = subprocess.run(
        [
            *(sys.executable, "-m", "haploop", "twin", "all", "--rig", rig, "--port", "yocto=0", *options),
            *("--", sys.executable, str(program), visa, ports),
        ],
        capture_output=True, text=True, check=False, cwd=folder,
    )  # fmt: skip
    assert ended.returncode == 0, ended.stderr
    found: dict[str, Any] = json.loads(ended.stdout.splitlines()[-1])
    return found


@pytest.mark.long
def test_every_way_to_write_a_name_is_redirected_and_no_other_name_is_opened(tmp_path):
    said = said_by_a_program(tmp_path, "bench")
    for name in GENERATOR:
        assert "33500" in said[name] or "3351" in said[name] or "Agilent" in said[name], (name, said[name])
    for name in LASER:
        assert "Error" not in said[name] and said[name], (name, said[name])
    for name in OTHERS:
        assert "is not opened" in said[name] and f"--allow {name}" in said[name], (name, said[name])
    assert said["COM3"] == said["com3"] == "None"
    for name in ("COM4", "/dev/ttyS0", "own class", "url"):
        assert said[name].startswith("SerialException: ") and "is not opened" in said[name], said[name]
    assert "VisaIOError" not in said["bare"] and "is not opened" in said["bare"]
    assert said["termination"] == "None", "as PyVISA's own"
    for name in ("hub", "hub here"):
        assert "may be a real instrument" in said[name], said[name]
    assert "192.0.2.8:31763 is not used" in said["server"]
    assert "Dev1" in said["cards"] and said["twin's server"] == said["cards"]
    assert "TCPIP0::192.0.2.10::5025::SOCKET" in said["listed"] and "ASRL3::INSTR" in said["listed"]
    assert said["GPIB"] == "()"
    assert said["sound"] == "no PortAudio" or "No sound device is opened" in said["sound"]


@pytest.mark.long
def test_what_is_allowed_is_opened_as_it_is(tmp_path):
    """What is not there then fails in its own words."""
    allowed = ("/dev/ttyS99", "TCPIP0::192.0.2.11::5025::SOCKET", "192.0.2.7")
    said = said_by_a_program(tmp_path, "bench", *(x for name in allowed for x in ("--allow", name)))
    assert "is not opened" not in said["TCPIP0::192.0.2.11::5025::SOCKET"]
    assert "may be a real instrument" not in said["hub"]
    assert "is not opened" in said["COM4"]
