"""Every way out of a rig ends in the safe state, seen in the plant."""

import ctypes
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

from haploop.base.errors import InstrumentError
from haploop.base.signals import at_console_close, ending_in_order
from haploop.instruments import Rig, open_rig
from haploop.instruments.safety.audit import entries
from haploop.instruments.safety.machine import hold
from tests.instruments.safety.at_the_patch import bursts
from tests.raising import raises, raising

DRIVE = 20 * np.sin(2 * np.pi * 250 * np.arange(50_000) / 50_000) * np.hanning(50_000)
TraceFunction = Callable[[FrameType, str, Any], Any]
POSIX = pytest.mark.skipif(sys.platform == "win32", reason="signals to another program are POSIX")


def safe(rig: Rig) -> bool:
    truth = rig.simulation.truth
    rig.clock.sleep(0.1)
    return not truth.closed and max(map(abs, truth.patch_voltages.values())) < 0.02


# What hangs


@pytest.fixture
def patient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("haploop.instruments.safety.deadline.DEADLINE", 0.2)


def for_ever(*_: object) -> None:
    threading.Event().wait()


@pytest.mark.usefixtures("patient")
def test_an_instrument_that_hangs_keeps_no_other_from_its_way_out(monkeypatch):
    begun = time.monotonic()
    with pytest.raises(InstrumentError, match=r"not confirmed: The daq .* hangs: .* 0\.2 s\. .*by hand"):  # noqa: SIM117
        with open_rig("simulated") as rig:
            rig.relay.connect(["A", "B"])
            monkeypatch.setattr(rig.daq, "zero", for_ever)
            monkeypatch.setattr(rig.daq, "close", for_ever)
    assert rig.simulation.truth.closed == frozenset()
    assert time.monotonic() - begun < 5
    assert [entry["kind"] for entry in entries(rig.audit.folder)][-2:] == ["unsafe", "closed"]


@pytest.mark.usefixtures("patient")
def test_a_stream_that_hangs_does_not_keep_the_relay_closed(monkeypatch):
    with open_rig("simulated") as rig:
        monkeypatch.setattr("haploop.mocks.daq.card_twin._CardStream.close", for_ever)
        raises(InstrumentError, r"PCIe-6321.* hangs", rig.excite, DRIVE, ["A"], ["drive"])
        assert safe(rig)


@pytest.mark.usefixtures("patient")
def test_a_relay_that_hangs_leaves_the_output_at_zero(monkeypatch):
    with pytest.raises(InstrumentError, match=r"The relay .* hangs"), open_rig("simulated") as rig:
        relay, connect = rig.relay, rig.relay.connect
        monkeypatch.setattr(relay, "connect", lambda p: connect(p) if p else for_ever())
        rig.excite(DRIVE, ["A"], ["drive"])
    rig.clock.sleep(relay.dead_man + 0.1)
    assert safe(rig)  # by the box's own timer


def test_a_relay_that_does_not_open_leaves_the_outputs_held(monkeypatch):
    """A contact may be closed: another program must not write to what leads to it."""
    let_go: list[bool] = []
    with open_rig("simulated") as rig:
        rig.relay.connect(["A"])
        with monkeypatch.context() as patch:
            patch.setattr(rig.relay, "connect", raising(InstrumentError("The box is gone.")))
            patch.setattr(rig.daq, "_let_go", lambda: let_go.append(True))
            raises(InstrumentError, r"not confirmed: The box is gone\. Switch", rig.make_safe)
        assert not let_go
    assert safe(rig)


def test_a_step_that_fails_without_a_word_is_told_by_its_kind(monkeypatch):
    with open_rig("simulated") as rig, monkeypatch.context() as patch:
        patch.setattr(rig.daq, "zero", raising(MemoryError()))
        raises(InstrumentError, r"not confirmed: MemoryError\.", rig.make_safe)


# Ways out


def test_the_safe_state_can_be_asked_for_again_and_again():
    with open_rig("simulated") as rig:
        record = rig.simulation.truth.record()
        for _ in range(3):
            rig.make_safe()
    rig.close()
    rig.close()
    assert safe(rig) and not bursts(record)


starts_threads = pytest.mark.skipif(
    (3, 12) <= sys.version_info < (3, 12, 2), reason="starts no thread at its end (Python's issue 113964)"
)


def ran(program: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", program]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


LEFT = """
import sys, threading
from haploop.instruments import open_rig

modes = [("haptable", "twin"), ("haptable", "wire"), ("bench", "wire")]
rigs = [open_rig(name, simulate=mode) for name, mode in modes]
for rig in rigs:
    rig.relay.connect(["A"])
    reach = rig._safe.reach
    rig._safe.reach = lambda reach=reach, rig=rig: (
        threading.Thread(target=lambda: None).start(), reach(), print(sorted(rig.simulation.truth.closed)))
rigs[0]._safe.reach = lambda: sys.exit("this one cannot be closed")
raise ValueError("nobody closes them")
"""


@pytest.mark.long
@starts_threads
def test_rigs_that_nobody_closes_are_closed_when_the_program_ends():
    """While threads still run, and the simulated device server with them; each one, whatever another does."""
    left = ran(LEFT)
    assert left.returncode == 1 and left.stdout == "[]\n[]\n", left
    assert "ValueError: nobody closes them" in left.stderr and "SystemExit: this one" in left.stderr


USED = """
import concurrent.futures, sys, threading, time
import numpy as np
from haploop.instruments import open_rig

def play(rig):
    time.sleep(0.5)  # by then the main thread has ended
    for _ in range(3):
        rig.excite(np.hanning(9000) * np.sin(np.arange(9000) / 30), ["A"], ["drive"])
    sys.stdout.write("whole\\n")  # at once: three threads write

def own():
    with open_rig("simulated") as rig:
        play(rig)

rig = open_rig("haptable", simulate="wire")
reach = rig._safe.reach
rig._safe.reach = lambda: reach() or print(*rig.simulation.truth.closed, end="")
for work in (own, lambda: play(rig)):
    threading.Thread(target=work).start()
concurrent.futures.ThreadPoolExecutor().submit(own)
"""


@pytest.mark.long
@starts_threads
def test_a_rig_is_open_until_the_last_thread_of_a_program_has_ended():
    used = ran(USED)
    assert (used.returncode, used.stdout, used.stderr) == (0, 3 * "whole\n", "")


def test_two_threads_that_close_a_rig_wait_for_each_other(monkeypatch):
    """Otherwise one takes the instruments from the other's safe state, and the relay stays closed."""
    rig = open_rig("haptable", simulate="wire")
    rig.relay.connect(["A"])
    zero, reached = rig.daq.zero, threading.Event()
    monkeypatch.setattr(rig.daq, "zero", lambda: (reached.set(), time.sleep(0.3), zero()))
    failed: list[BaseException] = []
    monkeypatch.setattr(threading, "excepthook", lambda raised: failed.append(raised.exc_value))
    first = threading.Thread(target=rig.close)
    first.start()
    reached.wait(10)
    rig.close()
    assert rig.simulation.truth.closed == frozenset()
    first.join(10)
    assert not failed and not first.is_alive()


@pytest.mark.parametrize(("asked", "step"), [
    (Rig.make_safe, "haploop.mocks.daq.twin.DaqTwin.zero"),
    (lambda rig: rig.daq.zero(), "haploop.instruments.daq.ni_outputs.NiOutputs._write_zero"),
])  # fmt: skip
def test_two_threads_that_ask_for_the_safe_state_take_turns(asked, step, monkeypatch):
    """At once, they would clear each other's tasks, or read each other's answers."""
    within, most = 0, 0

    def slow(*_: object) -> None:
        nonlocal within, most
        within += 1
        most = max(most, within)
        time.sleep(0.1)
        within -= 1

    with (
        open_rig("haptable", simulate="wire" if "Ni" in step else "twin") as rig,
        monkeypatch.context() as patch,
    ):
        patch.setattr(step, slow)
        threads = [threading.Thread(target=asked, args=(rig,)) for _ in range(3)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(10)
    assert most == 1


@pytest.mark.long
def test_a_play_has_ended_before_its_rig_is_closed_by_another_thread():
    rig = open_rig("haptable", simulate="wire")
    played, errors = threading.Event(), list[str]()

    def progress(*_: object) -> None:
        played.set()
        time.sleep(0.01)

    def play() -> None:
        with pytest.raises(InstrumentError) as told:
            rig.excite(np.tile(DRIVE, 20), ["A"], ["drive"], progress=progress)
        errors.append(str(told.value))

    thread = threading.Thread(target=play)
    thread.start()
    played.wait(10)
    rig.close()
    assert safe(rig)
    thread.join(10)
    assert len(errors) == 1 and "was set to zero by this program while it played" in errors[0], errors


FORKED = """
import multiprocessing, os, sys
import numpy as np
from haploop.instruments import open_rig
from haploop.base.errors import HaploopError
from haploop.instruments.safety import machine
from haploop.instruments.safety.audit import entries

def tried(action):
    try:
        action()
    except HaploopError as error:
        print(error, flush=True)

with machine.hold({"a card"}, "The rig 'one'"), open_rig("simulated") as rig:
    file = machine.folder() / machine.file_for("a card", "lock")
    child = multiprocessing.get_context("fork").Process(target=int)
    child.start()
    child.join()
    relay = rig.relay
    relay.connect(["A"])
    if not os.fork():
        tried(lambda: rig.excite(np.zeros(9), ["A"], ["drive"]))
        tried(lambda: relay.connect(["B"]))
        sys.exit()
    os.wait()
    kinds = [entry["kind"] for entry in entries(rig.audit.folder)]
    print(child.exitcode, kinds.count("closed"), *relay.connected(), file.exists(), flush=True)
    if not os.fork():
        os.close(1)
        sys.stdin.read()  # a child that goes on after its parent
        os._exit(0)
    os._exit(0)  # as kill -9
"""


@POSIX
def test_a_forked_child_has_no_rig_and_no_lock(place):
    place.mkdir()
    program = (
        "from haploop.instruments.safety import machine\n"
        f"machine._place = lambda: machine.Path({str(place)!r})\n{FORKED}"
    )
    pipe = subprocess.PIPE
    with subprocess.Popen([sys.executable, "-c", program], stdin=pipe, stdout=pipe, text=True) as forked:
        used, connected, parent = forked.stdout.read().splitlines()
        assert (
            f"'simulated' is open in process {forked.pid}, of which this one is a fork: use it there" in used
        )
        assert connected == "The rig was closed: open it again."
        assert parent == "0 0 A True"
        forked.wait()
        with hold({"a card"}, "The rig 'two'"):
            pass


@pytest.fixture
def no_other_rig(monkeypatch: pytest.MonkeyPatch) -> None:
    """As if no rig were open that another test of this run keeps."""
    monkeypatch.setattr("haploop.base.signals._orderly", 0)


@contextmanager
def handled(kind: int, how: Any) -> Iterator[None]:
    before = signal.signal(kind, how)
    try:
        yield
    finally:
        signal.signal(kind, before)


@pytest.mark.parametrize(
    "kind", [getattr(signal, n) for n in ("SIGTERM", "SIGHUP", "SIGBREAK") if hasattr(signal, n)]
)
@pytest.mark.usefixtures("no_other_rig")
def test_what_ends_a_program_leaves_a_users_script_in_order(kind):
    with handled(kind, signal.SIG_DFL):
        with pytest.raises(SystemExit) as left, open_rig("simulated") as rig:
            rig.excite(DRIVE, ["A"], ["drive"], progress=lambda *_: signal.raise_signal(kind))
        assert left.value.code == 128 + kind
        assert safe(rig) and signal.getsignal(kind) is signal.SIG_DFL


def test_what_a_program_has_arranged_for_a_signal_stays():
    seen: list[int] = []
    with handled(signal.SIGTERM, lambda number, _: seen.append(number)), ending_in_order(), ending_in_order():
        signal.raise_signal(signal.SIGTERM)
    assert seen == [signal.SIGTERM]


@pytest.mark.usefixtures("no_other_rig")
def test_two_rigs_may_be_closed_in_any_order():
    with handled(signal.SIGTERM, signal.SIG_DFL):
        first, second = open_rig("simulated"), open_rig("simulated")
        first.close()
        raises(SystemExit, "", signal.raise_signal, signal.SIGTERM)
        second.close()
        assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


def test_closing_the_console_on_windows_waits_for_the_safe_state(monkeypatch):
    """Windows' part is played by this test; on Windows itself it has not been tried."""
    handlers: list[Any] = []

    class Kernel:
        @staticmethod
        def SetConsoleCtrlHandler(handler: Any, add: int) -> None:  # noqa: N802
            (handlers.append if add else handlers.remove)(handler)

    monkeypatch.setattr(ctypes, "windll", SimpleNamespace(kernel32=Kernel), raising=False)
    with open_rig("simulated") as rig:
        rig.relay.connect(["A"])
        (handler,) = handlers
        assert handler(0) == 0 and rig.simulation.truth.closed == {"A"}  # Ctrl-C is a signal's
        thread = threading.Thread(target=handler, args=(2,))
        thread.start()
        thread.join()
        assert safe(rig)
    assert not handlers
    with at_console_close(lambda: 1 / 0):
        assert handlers[0](6) == 0


def test_ctrl_c_at_any_line_of_the_way_out_of_a_play(full):
    """One stops the play, and one more comes at a random line of what follows: the play leaves no volts."""
    rng = random.Random(4)
    passed = second = 0

    def line(_frame: FrameType, event: str, _argument: object) -> TraceFunction:
        nonlocal passed
        if event == "line":
            passed += 1
            if passed == second:
                signal.raise_signal(signal.SIGINT)
        return line

    def first(*_: object) -> None:
        sys.settrace(lambda *_: line)
        signal.raise_signal(signal.SIGINT)

    def interrupted(rig: Rig, at: int) -> None:
        nonlocal passed, second
        passed, second = 0, at
        try:
            with suppress(KeyboardInterrupt):
                rig.excite(DRIVE[:15_000] / 4, ["A"], ["drive"], progress=first)
        finally:
            sys.settrace(None)

    with open_rig("simulated") as rig:
        interrupted(rig, sys.maxsize)
        lines = range(passed)
        assert len(lines) > 100
        for at in lines if full else rng.sample(lines, 4):
            interrupted(rig, at)
            assert safe(rig), at
        rig.excite(DRIVE, ["A"], ["drive"])


@POSIX
@pytest.mark.timeout(1800)
def test_ctrl_c_at_any_time_and_again_and_again(full):
    """Ctrl-C by a clock of its own: while a drive is played, while it is stopped, while it is left."""
    rng, raised = random.Random(0), 0
    me = threading.get_ident()
    for _ in range(500 if full else 8):
        delays = [rng.uniform(0, 0.05)] + [rng.choice((0, 1e-4, 1e-3, 5e-3)) for _ in range(rng.randrange(4))]

        def shoot(delays: list[float] = delays) -> None:
            for delay in delays:
                time.sleep(delay)
                signal.pthread_kill(me, signal.SIGINT)

        rigs: list[Rig] = []
        hail = threading.Thread(target=shoot)
        try:
            with open_rig("simulated") as rig:
                rigs.append(rig)
                hail.start()
                for _ in range(4):
                    rig.excite(DRIVE[:20_000] / 4, ["A"], ["drive"])
        except KeyboardInterrupt:
            raised += 1
        while True:
            try:
                while not hail.ident or hail.is_alive():
                    time.sleep(1e-3)
                time.sleep(1e-3)  # What has been sent by now has arrived after that.
                break
            except KeyboardInterrupt:
                continue
        assert safe(rigs[0])
    assert raised
