"""The guides to served twins and live views, literally: served by one program, recorded by another."""

import json
import os
import re
import shlex
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import pytest
import serial

import haploop
from haploop.acquisition import Recording

GUIDES = Path(__file__).parents[2] / "docs" / "how-to"


def _blocks(guide: str, language: str) -> list[str]:
    text = (GUIDES / guide).read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def _command(line: str) -> list[str]:
    words = shlex.split(line)
    assert words[0] == "haploop"
    return [sys.executable, "-m", "haploop", *words[1:]]


@contextmanager
def _running(
    command: list[str], folder: Path, out: int | IO[str] = subprocess.PIPE
) -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen(command, cwd=folder, stdout=out, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


@pytest.mark.long
@pytest.mark.skipif(os.name == "nt", reason="Windows delivers Ctrl-C to a console, not to a process")
def test_the_guide_to_served_twins(tmp_path):
    serve, record, *_ = _blocks("serving-twins.md", "sh")
    (printed,) = _blocks("serving-twins.md", "text")
    (rig,) = _blocks("serving-twins.md", "toml")
    *lines, unserved = printed.splitlines()
    with _running(_command(serve), tmp_path) as server:
        for line in lines:
            kind, address = line.split(": ", 1)
            real_kind, real_address = server.stdout.readline().strip().split(": ", 1)
            assert real_kind == kind
            assert address in rig
            rig = rig.replace(address, real_address)
        (tmp_path / "served.toml").write_text(rig, encoding="utf-8")
        watch = [sys.executable, "-m", "haploop", "live", "--rig", "served.toml", "--wait", "60", "--json"]
        # Into a file: a pipe that nobody reads would stop the viewer, which then drops blocks.
        with (tmp_path / "seen").open("w") as out, _running(watch, tmp_path, out) as viewer:
            assert viewer.stderr.readline() == "Waiting for a command that uses the rig served.\n"
            done = subprocess.run(
                _command(record), cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False
            )
            assert done.returncode == 0, done.stderr
            _, complaint = viewer.communicate(timeout=30)
            assert viewer.returncode == 0, complaint
        server.send_signal(signal.SIGINT)
        _, said = server.communicate(timeout=30)
    assert server.returncode == 0
    assert said.strip() == unserved
    recording = Recording.open(tmp_path / "recordings" / "P01-latch.h5")
    assert recording.complete
    assert recording.simulated
    assert len(recording.accepted) == 2
    blocks = [json.loads(line) for line in (tmp_path / "seen").read_text().splitlines()]
    assert {(b["rig"], b["simulated"], b["doing"]) for b in blocks} == {("served", True, "record")}
    # A viewer that came in time and kept up has seen everything from then on.
    count = round((blocks[-1]["first"] - blocks[0]["first"]) / blocks[0]["samples"]) + 1
    assert len(blocks) + blocks[-1]["dropped"] - blocks[0]["dropped"] == count
    forces = [level["mean"] for b in blocks for level in b["levels"] if level["name"] == "Fz"]
    assert max(forces) - min(forces) > 1  # newton: it has seen a press


def test_the_guide_to_taps(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (script,) = _blocks("live-views.md", "python")
    exec(compile(script, "live-views.md", "exec"), {})


def _serial(folder: Path) -> Path:
    path = folder / "serial.toml"
    text = 'base = "haptable"\n[relay]\ndriver = "serial-relay"\nport = "COM4"\nrating = 48\n'
    text += "patches = { A = 0, B = 1 }\n"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.long
@pytest.mark.skipif(os.name == "nt", reason="Windows delivers Ctrl-C to a console, not to a process")
@pytest.mark.parametrize("rig", ["bench", "serial"])
def test_every_kind_is_served(tmp_path, rig):
    name = "bench" if rig == "bench" else str(_serial(tmp_path))
    command = [sys.executable, "-m", "haploop", "twin", "all", "--rig", name, "--json"]
    with _running(command, tmp_path) as server:
        addresses = json.loads(server.stdout.readline())
        server.send_signal(signal.SIGTERM)
        server.communicate(timeout=30)
    kinds = {"bench": {"ni", "yocto", "ofv", "scpi"}, "serial": {"ni", "serial"}}
    assert set(addresses) == kinds[rig]
    assert server.returncode == 0


def test_nothing_to_watch_is_one_sentence(run):
    result = run("live --rig simulated --wait", 0.1, ends=2)
    waited, told = result.output.strip().splitlines()
    assert waited == "Waiting for a command that uses the rig simulated."
    assert told.startswith("Error: No running program publishes the rig 'simulated'")


@pytest.mark.long
@pytest.mark.skipif(os.name == "nt", reason="Ctrl-C is sent as a POSIX signal")
def test_alone_it_looks_at_the_sensors_itself(tmp_path):
    command = [sys.executable, "-m", "haploop", "live", "--rig", "simulated", "--json"]
    with _running(command, tmp_path) as program:
        blocks = [json.loads(program.stdout.readline()) for _ in range(3)]
        program.send_signal(signal.SIGINT)
        _, said = program.communicate(timeout=60)
    assert [block["doing"] for block in blocks] == ["look"] * 3
    assert program.returncode == 130 and "Traceback" not in (said or "")
    assert not list(tmp_path.glob("**/*.h5"))


@pytest.mark.parametrize("live", ["on", "off"])
def test_commands_publish_unless_they_are_told_not_to(run, tmp_path, monkeypatch, live, _state):
    from haploop.instruments.live import publisher

    made: list[Path] = []
    begin = publisher.Publisher.__init__

    def noted(self, *args, **more):
        begin(self, *args, **more)
        assert self.path.stat().st_mode & 0o77 == 0 or os.name == "nt"
        made.append(self.path)

    monkeypatch.setattr(publisher.Publisher, "__init__", noted)
    monkeypatch.setenv("HAPLOOP_LIVE", live)
    run("record latch -p P01 -n 1 --out", tmp_path, ends=0)
    assert len(made) == (live == "on")
    assert not any(path.exists() for path in made)


def test_a_command_that_cannot_publish_works_without(run, tmp_path, monkeypatch):
    from haploop.instruments.live import publisher

    def refuse(*_args, **_more):
        raise OSError(24, "Too many open files")

    monkeypatch.setattr(publisher.socket, "create_server", refuse)
    result = run("record latch -p P01 -n 1 --out", tmp_path, ends=0)
    assert "No live view" in result.output


def test_the_meter_shows_names_as_they_are():
    """A rig's name and a path may hold what rich takes for markup."""
    import io

    import numpy as np
    from rich.console import Console

    from haploop.commands.live_views import show_meter
    from haploop.instruments import Block, Sensors
    from haploop.instruments.live import Feed, Run

    feed, out = Feed(), io.StringIO()
    tap = feed.tap()
    publish = feed.begin(Run("odd[/x]", True, "record", "[red]a.h5", ("a[/b]",), 100.0, Sensors(), None))
    publish(Block(0, np.ones((1, 10)), np.array([True])))

    def end():
        time.sleep(0.2)
        feed.close()

    import threading

    threading.Thread(target=end).start()
    show_meter(tap, Console(file=out, width=100, force_terminal=False))
    for shown in ("odd[/x] (simulated): record [red]a.h5", "a[/b]", "V overload"):
        assert shown in out.getvalue()


SCRIPT = """
import json, sys, urllib.request
import nidaqmx, pyvisa, serial
from nidaqmx.system import System

with nidaqmx.Task() as task:
    task.ai_channels.add_ai_voltage_chan("Dev1/ai0")
    volts = task.read()
with serial.Serial("COM3", 115200, timeout=5) as port:
    port.write(b"GetDevInfo,Controller,0,Name\\n")
    laser = port.readline().decode().strip()
manager = pyvisa.ResourceManager()
(name,) = manager.list_resources("?*::SOCKET")
generator = manager.open_resource(name, read_termination="\\n").query("*IDN?").strip()
hub = json.load(urllib.request.urlopen(sys.argv[1] + "/api.json", timeout=5))
boxes = [page["productName"] for page in hub["services"]["whitePages"]]
print(json.dumps([System.local().devices.device_names, volts, laser, name, generator, boxes]))
sys.exit(7)
"""


def free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


@pytest.mark.long
def test_a_program_that_knows_nothing_of_haploop_finds_every_instrument_of_a_rig(tmp_path):
    """By the names of the rig file: cards, serial port, VISA resource, and the hub's own address."""
    (tmp_path / "script.py").write_text(SCRIPT)
    hub = f"http://127.0.0.1:{free_port()}"
    (tmp_path / "lab.toml").write_text(f'base = "bench"\nname = "lab"\n[relay]\nhub = "{hub}"\n')
    command = _command("haploop twin all --rig lab.toml --")
    ran = subprocess.run(
        [*command, sys.executable, "script.py", hub],
        cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert ran.returncode == 7, ran.stderr
    cards, volts, laser, name, generator, boxes = json.loads(ran.stdout)
    assert cards == ["Dev1", "Dev2"] and abs(volts) < 10
    assert laser == "OFV-5000 Vibrometer Controller"
    assert name == "TCPIP0::192.0.2.10::5025::SOCKET" and "33522B" in generator
    assert "Yocto-MaxiCoupler" in boxes


@pytest.mark.long
def test_ports_are_those_that_were_asked_for_and_a_rig_file_points_at_them(tmp_path):
    ni, yocto = free_port(), free_port()
    command = f"haploop twin all --rig bench --port ni={ni},yocto={yocto} --write lab.toml --json"
    with _running(_command(command), tmp_path) as server:
        addresses = json.loads(server.stdout.readline())
        assert addresses["ni"] == f"127.0.0.1:{ni}" and addresses["yocto"] == f"http://127.0.0.1:{yocto}"
        with haploop.open_rig(tmp_path / "lab.toml") as rig:
            assert rig.name == "bench-served" and rig.simulated and rig.mode is None
            assert rig.vibrometer.signal_level() == pytest.approx(0.8, abs=0.01)
            assert "33522B" in rig.generator.identity


@pytest.mark.long
@pytest.mark.skipif(os.name == "nt", reason="Windows has no pseudo-terminals")
def test_a_serial_line_is_a_device_file(tmp_path):
    with _running(_command("haploop twin all --rig bench --pty --json"), tmp_path) as server:
        path = json.loads(server.stdout.readline())["ofv"]
        assert Path(path).is_char_device()
        for _ in range(2):
            with serial.Serial(path, 115200, timeout=5) as port:
                port.write(b"Get,VeloDec,0,Range\n")
                assert port.readline() == b"5mm/s/V\n"


def test_a_port_that_is_taken_is_one_sentence(run):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        ran = run("twin all --rig haptable --port", f"yocto={taken.getsockname()[1]}")
    assert ran.exit_code == 3 and "name another" in ran.stderr, ran.stderr
