"""Four channels at once, as programs on served instruments: each way to end is safe, and says one sentence.

A program plays into all patches; then it is killed or stopped, or another program is at the card.
"""

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from haploop.base.errors import DataError
from haploop.calibration import Drive
from haploop.instruments import load_rig_file
from haploop.mocks.simulation import Simulation
from tests.exchange.conftest import make_drive
from tests.instruments.safety.lab import FOUR_CHANNELS, serve
from tests.instruments.safety.test_other_clients import Client
from tests.instruments.safety.test_other_programs import POSIX

pytestmark = [POSIX, pytest.mark.timeout(300)]

DEAD_MAN, LATE = 2.0, 3.0
"""Seconds of the box's timer, and by how much a busy machine may be late."""
PEAK = 20.0

PROGRAM = f"""
import sys
import numpy as np
from haploop.base.errors import HaploopError
from haploop.instruments import open_rig
path, patches, plays, seconds = sys.argv[1], sys.argv[2], int(sys.argv[3]), float(sys.argv[4])
count = round(50_000 * seconds)
burst = {PEAK} * np.sin(2 * np.pi * 250 * np.arange(count) / 50_000) * np.hanning(count)
try:
    with open_rig(path) as rig:
        drives, monitors = dict.fromkeys(patches, burst), [rig.monitor(p) for p in patches]
        for _ in range(plays):
            rig.excite_each(drives, monitors, progress=lambda *_: print("block", flush=True))
            print("played", flush=True)
except HaploopError as error:
    sys.exit(f"{{type(error).__name__}}: {{error}}")
"""


@dataclass
class Lab:
    path: Path
    world: Simulation
    server: str

    def peak(self) -> float:
        """Largest volts at any patch so far."""
        self.world.plant.advance(self.world.clock.now())
        return float(self.world.truth.peak)

    def safe_within(self, seconds: float) -> None:
        """No contact is closed, and no patch has volts."""
        deadline = time.monotonic() + seconds
        truth = self.world.truth
        while truth.closed or any(abs(volts) > 1e-3 for volts in truth.patch_voltages.values()):
            assert time.monotonic() < deadline, (truth.closed, truth.patch_voltages)
            time.sleep(0.02)

    @contextmanager
    def program(
        self, patches: str = "ABCD", plays: int = 20, seconds: float = 1.0
    ) -> Iterator[subprocess.Popen[str]]:
        """The program, which is ended when the context is left."""
        command = [sys.executable, "-c", PROGRAM, str(self.path), patches, str(plays), str(seconds)]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            try:
                yield process
            finally:
                process.kill()

    def ended(self, process: subprocess.Popen[str]) -> tuple[int, str]:
        """How it ended, and what it said of that."""
        said = process.communicate(timeout=60)[1].strip()
        return process.returncode, said


@contextmanager
def a_lab(folder: Path, duty: float = 1.0) -> Iterator[Lab]:
    path = folder / "lab.toml"
    world, at = serve(load_rig_file("four-channel"), DEAD_MAN)
    path.write_text(
        f'base = "haptable"\nname = "lab"\n[daq]\nserver = "{at["server"]}"\n'
        f'devices = {{ Dev2 = "PCIe-6363" }}{FOUR_CHANNELS}'
        f'[relay]\nhub = "{at["hub"]}"\ndead_man = {DEAD_MAN}\n[limits]\nduty = {duty}\n'
    )
    yield Lab(path, world, str(at["server"]))
    world.close()


@pytest.fixture
def lab(tmp_path: Path) -> Iterator[Lab]:
    with a_lab(tmp_path) as found:
        yield found


def until_it_plays(process: subprocess.Popen[str]) -> None:
    """Wait for a block of a play of all drives: the proofs before it take one each."""
    while process.stdout.readline() != "played\n":
        assert process.poll() is None, process.communicate()
    for _ in range(3):
        assert process.stdout.readline() == "block\n"


def ctrl_c_twice(process: subprocess.Popen[str]) -> None:
    process.send_signal(signal.SIGINT)
    time.sleep(0.05)
    process.send_signal(signal.SIGINT)


@pytest.mark.long
def test_a_program_that_ends_in_the_middle_of_a_play_leaves_all_four_patches_off(lab):
    """One after the other, and each plays, although volts stood on one output before the first."""
    client = Client(lab.server, "somebody's")
    assert client.write(8.0, "Dev2/ao2")
    client.channel.close()
    ends: list[tuple[Callable[[subprocess.Popen[str]], None], float]] = [
        (lambda process: process.kill(), 1.5 * DEAD_MAN + LATE),
        (ctrl_c_twice, 0.1),
        (lambda process: process.terminate(), 0.1),
    ]
    for end, within in ends:
        with lab.program() as process:
            until_it_plays(process)
            assert lab.world.truth.closed == set("ABCD")
            end(process)
            code, _ = lab.ended(process)
        assert code not in (0, 1)
        lab.safe_within(within)
        assert lab.peak() < 1.1 * PEAK
    with lab.program(plays=1) as process:
        assert lab.ended(process) == (0, "")
    lab.safe_within(0.1)


@pytest.mark.long
def test_another_program_that_writes_one_channel_in_a_loop_gets_nothing_through(lab):
    client, ended = Client(lab.server, "somebody's"), threading.Event()

    def loop() -> None:
        while not ended.wait(1e-3):
            client.write(8.0, "Dev2/ao2")

    with lab.program(plays=2) as process:
        until_it_plays(process)
        other = threading.Thread(target=loop)
        other.start()
        code, said = lab.ended(process)
        ended.set()
        other.join(10)
    client.channel.close()
    # After a play the outputs are let go for a moment: who holds one then is named before the next one.
    assert (code, said) == (0, "") or (code == 1 and "-50103" in said and "\n" not in said)
    assert client.refused > 0
    lab.safe_within(LATE)
    assert lab.peak() < 1.1 * PEAK


@pytest.mark.long
def test_a_card_that_is_reset_and_written_to_in_a_play_is_noticed(lab):
    client = Client(lab.server, "somebody's")
    with lab.program() as process:
        until_it_plays(process)
        client.reset()
        client.write(8.0, "Dev2/ao2")
        code, said = lab.ended(process)
    client.channel.close()
    assert code == 1 and said.startswith("TakenError: ") and "\n" not in said
    lab.safe_within(LATE)


@pytest.mark.long
def test_what_one_program_played_into_a_patch_counts_for_another_patch_in_the_next(tmp_path):
    with a_lab(tmp_path, duty=0.02) as lab:  # 1.2 s of a minute
        with lab.program("A", plays=1, seconds=0.8) as process:
            assert lab.ended(process) == (0, "")
        with lab.program("C", plays=1, seconds=0.8) as process:
            code, said = lab.ended(process)
        assert code == 1 and said.startswith("LimitError: The drive would make 1.6"), said
        assert "beyond the 1.2 s that 'duty' in [limits] allows: wait" in said and "\n" not in said
        lab.safe_within(0.1)


def test_a_drive_has_one_signal_for_each_patch():
    drive = make_drive()
    twice = np.concatenate([drive.volts, drive.volts])
    with pytest.raises(DataError, match=r"two signals for one patch \(A, A\)"):
        replace(drive, patches=("A", "A"), volts=twice)
    assert isinstance(replace(drive, patches=("A", "B"), volts=twice), Drive)
