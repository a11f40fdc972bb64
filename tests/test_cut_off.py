"""Programs that are killed and instruments that are cut off, in real time, over the wires.

A plant with its wires stands in this process; the command runs in another, with the real drivers, as
in a lab: its operator is the console, and this process presses what it is asked to. Then something
ends: the program (kill -9, signals), or the line to an instrument (cut, or hung). The relay must be
open and every patch without voltage, at the plant, within the dead-man's time; the files whole; and
the next program must start.
"""

import random
import re
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import pytest

from haploop.acquisition import Recording, recover
from haploop.base.clock import RealClock
from haploop.base.validation import validate
from haploop.calibration import Calibration
from haploop.commands.cli import cli
from haploop.instruments import Press, load_rig_file
from haploop.instruments.daq.ni_daqmx import NiDaq
from haploop.instruments.generator.scpi_generator import Keysight33500
from haploop.instruments.relay.yocto import Yocto
from haploop.instruments.vibrometer.ofv5000 import Ofv5000
from haploop.mocks.plant import Plant
from haploop.mocks.simulation import Simulation
from haploop.mocks.transport import Loopback

DEAD_MAN = 2.0
SLACK = 1.5
"""Seconds that a busy machine may be late, and that the program takes to notice what was cut."""
PLACE = re.compile(r"(.*127\.0\.0\.1:+)(\d+)(.*)")
PROMPT = re.compile(r"Press the (\w+) button.*\((\d+) of (\d+)\)")
ROLES = {
    "daq": (NiDaq, "server"),
    "relay": (Yocto, "hub"),
    "vibrometer": (Ofv5000, "port"),
    "generator": (Keysight33500, "resource"),
}
CUTS = [f"{how} {role}" for role in ROLES for how in ("cut", "hang")]
WAYS = ["kill", "ctrl-c", "kill", "ctrl-c again and again", "kill", "terminate", "kill", *CUTS]


class Cable(Loopback):
    """What lies between a program and an instrument: it can be cut, and it can go dead."""

    def __init__(self, port: int) -> None:
        self._far = port
        self.dead = threading.Event()
        super().__init__(self._carry)

    def _carry(self, link: socket.socket) -> None:
        with socket.create_connection(("127.0.0.1", self._far)) as far:
            back = threading.Thread(target=self._pump, args=(far, link), daemon=True)
            back.start()
            self._pump(link, far)
        back.join()

    def _pump(self, source: socket.socket, target: socket.socket) -> None:
        try:
            while data := source.recv(1 << 16):
                if not self.dead.is_set():
                    target.sendall(data)
        except OSError:
            pass
        finally:
            for end in (source, target):
                with suppress(OSError):
                    end.shutdown(socket.SHUT_RDWR)


@dataclass
class World:
    plant: Plant
    rig: Path
    cables: dict[str, Cable]


@contextmanager
def world(folder: Path) -> Iterator[World]:
    """A rig's instruments, served, and a rig file that reaches them through cables."""
    file = load_rig_file("bench")
    clock = RealClock()
    simulation = Simulation(file, clock)
    with ExitStack() as stack:
        stack.callback(simulation.close)
        cables: dict[str, Cable] = {}
        lines = ['base = "bench"', 'name = "bench"']
        for role, (driver, key) in ROLES.items():
            device = getattr(file, role)
            settings = validate(driver.Settings, device.settings, role)
            before, port, after = PLACE.fullmatch(
                str(simulation.serve(device.driver, settings)[key])
            ).groups()
            cables[role] = stack.enter_context(Cable(int(port)))
            lines += [f"[{role}]", f'{key} = "{before}{cables[role].port}{after}"']
            lines += ['visa = "@py"'] if role == "generator" else []
        rig = folder / "bench.toml"
        rig.write_text("\n".join(lines) + "\n", encoding="utf-8")
        yield World(simulation.plant, rig, cables)


class Program:
    """A command in a process of its own, whose prompts the plant's person follows."""

    def __init__(self, here: World, *args: object) -> None:
        self.said = ""
        self._here = here
        self.process = subprocess.Popen(
            [sys.executable, "-m", "haploop", *map(str, args), "--rig", str(here.rig)],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
        )
        self._person = threading.Thread(target=self._obey)
        self._person.start()

    def wait(self, seconds: float) -> int:
        """Its exit code. Raises TimeoutExpired."""
        try:
            return self.process.wait(seconds)
        finally:
            self.process.kill()
            self._person.join()
            for pipe in (self.process.stdin, self.process.stderr):
                assert pipe is not None
                with suppress(OSError):
                    pipe.close()

    def _obey(self) -> None:
        heard = 0
        while piece := self.process.stderr.read(1):
            self.said += piece.decode("latin-1")
            line = self.said[heard:]
            if line.endswith("[Y/n] "):
                with suppress(OSError):
                    self.process.stdin.write(b"y\n")
                    self.process.stdin.flush()
                heard = len(self.said)
            elif piece in b"\r\n":
                if asked := PROMPT.search(line):
                    press = Press(asked[1], "P01", int(asked[2]), int(asked[3]))
                    self._here.plant.press(press)
                heard = len(self.said)


def end(way: str, here: World, program: Program) -> None:
    """Bring it about."""
    match way.split():
        case ["kill"]:
            program.process.kill()
        case ["terminate"]:
            program.process.terminate()
        case ["ctrl-c"]:
            program.process.send_signal(signal.SIGINT)
        case ["ctrl-c", *_]:
            for _ in range(20):
                program.process.send_signal(signal.SIGINT)
                RealClock().sleep(0.01)
        case ["cut", role]:
            here.cables[role].close()
        case ["hang", role]:
            here.cables[role].dead.set()


def assert_safe_within(here: World, seconds: float) -> None:
    """Every patch is off, at the plant, and stays so."""
    clock, truth = RealClock(), here.plant.truth
    deadline = clock.now() + seconds
    while truth.closed or any(abs(volts) > 1e-3 for volts in truth.patch_voltages.values()):
        assert clock.now() < deadline, (truth.closed, truth.patch_voltages)
        clock.sleep(0.02)


def assert_whole(out: Path) -> None:
    for path in out.glob("*.h5"):
        if path.stem.startswith("calibration"):
            Calibration.load(path)
        elif path.stem.startswith("P01"):
            recording = Recording.open(path)
            assert recording.volts.shape[0] == len(recording.channels)
            if recording._state == "recording":
                recover(path)


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording and a calibration of this world, for the check."""
    folder = tmp_path_factory.mktemp("known")
    for args in (
        ["record", "latch", "-p", "P01", "-n", "3", "--out", folder],
        ["calibrate", "--out", folder / "calibration.h5"],
    ):
        with pytest.raises(SystemExit) as ended:
            cli.main([*map(str, args), "--rig", "bench", "--simulate", "twin"])
        assert ended.value.code == 0
    return folder


@pytest.mark.long
@pytest.mark.timeout(7200)
def test_cut_off_at_any_moment(known, tmp_path, full, mode):
    if mode != "twin":
        pytest.skip("it serves wires of its own")
    r = random.Random(7)
    count = 200 if full else 2
    ended: dict[str, int] = {}
    for number in range(count):
        out = tmp_path / str(number)
        out.mkdir()
        commands: list[list[object]] = [
            ["check", known / "P01-latch.h5", "-c", known / "calibration.h5", "--out", out],
            ["calibrate", "--out", out / "calibration.h5"],
            ["record", "latch", "-p", "P01", "-n", 2, "--out", out],
        ]
        way, command = WAYS[number % len(WAYS)], commands[number % len(commands)]
        with world(out) as here:
            program = Program(here, *command)
            after = r.uniform(0.5, 9.0)
            with suppress(subprocess.TimeoutExpired):
                program.process.wait(after)
            end(way, here, program)
            if way == "kill":
                assert_safe_within(here, DEAD_MAN + SLACK)
            code = program.wait(60)
            ended[f"{way}: {code}"] = ended.get(f"{way}: {code}", 0) + 1
            # -2, -15: Python itself dies of a signal before the command has begun, or once it has ended.
            assert code in (0, -9, -2, -15, 3, 130, 143), (command, way, after, program.said)
            assert "Traceback" not in program.said
            # Whoever has said how it ended is off at once, unless the relay itself was cut off.
            assert_safe_within(here, DEAD_MAN + SLACK if "relay" in way or way == "kill" else 0.1)
            assert_whole(out)
            if not way.startswith(("cut", "hang")):
                again = Program(here, "record", "latch", "-p", "P02", "-n", 1, "--out", out)
                assert again.wait(60) == 0, (command, way, after, again.said)
    print(ended, file=sys.stderr)
