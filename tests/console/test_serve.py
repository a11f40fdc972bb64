"""`haploop serve` as processes: the server may be killed and come back, and the recording goes on."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from urllib.error import HTTPError

import pytest

from haploop.acquisition import Recording
from haploop.console.data_folder import DataFolder
from haploop.console.server import serving
from haploop.console.worker import Address, WorkerHangsError, free_tape, link, start_worker
from haploop.instruments import load_rig_file
from haploop.instruments.tape import Player
from tests.console.serving import Served, end, served, start


def gone(address: Path) -> bool:
    """Whether a worker ends, as it was told: it removes its address when it has left the rig."""
    until = time.monotonic() + 30
    while address.exists() and time.monotonic() < until:
        time.sleep(0.05)
    return not address.exists()


@pytest.mark.long
def test_a_server_that_is_killed_and_comes_back_finds_the_recording_going_on(tmp_path):
    state, data = tmp_path / "state", tmp_path / "data"
    first = start(data, "--port", "0", state=state)
    again = None
    try:
        first.ask("/api/command/override", {"reason": "a test"})
        wanted = {"button": "push", "participant": "P01", "presses": 3}
        first.ask("/api/command/start", {"kind": "record", "parameters": wanted})
        address = next(iter((state / "simulated").glob("console-*.json")))
        worker = Address.read(address)
        assert worker is not None
        if os.name != "nt":
            assert address.stat().st_mode & 0o077 == 0, "the tokens are its owner's"
        path = data / "recordings" / "P01-push.h5"
        while not path.exists():
            time.sleep(0.05)
        first.process.kill()
        first.process.wait()
        again = start(data, "--port", "0", state=state)
        assert Address.read(address) == worker, "the same worker, which nobody has disturbed"
        assert again.token != first.token
        with pytest.raises(HTTPError, match="403") as refused:
            again.__class__(again.process, again.base, first.token, data).ask("/api/files")
        refused.value.close()  # it holds the connection
        until = time.monotonic() + 60
        while not (path.exists() and Recording.open(path).complete):
            assert time.monotonic() < until
            time.sleep(0.2)
        assert again.ask(f"/api/presses?file=recordings/{path.name}")["state"] == "finished"
    finally:
        first.process.stdout.close()
        end(again or first)
    recording = Recording.open(path)
    assert len(recording.accepted) == 3 and recording.content_hash
    assert recording.blocks["first"][-1] + recording.blocks["count"][-1] == recording.volts.shape[1]
    assert os.name == "nt" or gone(address), "Ctrl-C ended the worker too"


@pytest.mark.long
@pytest.mark.parametrize("when", ["while it starts", "before pages are served"])
def test_a_stop_before_the_console_is_served_leaves_no_worker(tmp_path, monkeypatch, when):
    monkeypatch.setenv("HAPLOOP_STATE", str(tmp_path / "state"))
    file = load_rig_file("simulated")
    begun, popen = [], subprocess.Popen

    def stopped(*_):
        if begun:
            raise KeyboardInterrupt

    def started(*given, **named):
        begun.append(popen(*given, **named))
        return begun[0]

    monkeypatch.setattr(link.subprocess, "Popen", started)
    if when == "while it starts":
        monkeypatch.setattr(link, "find_worker", stopped)
    else:
        monkeypatch.setattr(serving, "application", stopped)
    with pytest.raises(KeyboardInterrupt):
        serving.serve_console("simulated", file, None, folders(tmp_path), "127.0.0.1", 0, print)
    try:
        assert begun[0].wait(20) is not None
    finally:
        begun[0].kill()


@pytest.mark.long
@pytest.mark.skipif(os.name == "nt", reason="Windows' terminate tells a server nothing")
def test_of_two_servers_of_a_rig_each_ends_what_it_began_and_the_last_one_the_worker(tmp_path):
    state, data = tmp_path / "state", tmp_path / "data"

    def begin(server, participant):
        wanted = {"button": "push", "participant": participant, "presses": 40}
        server.ask("/api/command/start", {"kind": "record", "parameters": wanted})
        path = data / "recordings" / f"{participant}-push.h5"
        until = time.monotonic() + 60
        while not (path.exists() and Recording.open(path).accepted):
            assert time.monotonic() < until
            time.sleep(0.1)
        return path

    with served(data, "--port", "0", state=state) as first:
        first.ask("/api/command/override", {"reason": "a test"})
        path = begin(first, "P01")
        with served(data, "--port", "0", state=state):
            address = next(iter((state / "simulated").glob("console-*.json")))
        assert Recording.open(path).in_progress, "it is the first one's"
        assert first.ask("/api/stop", {})["state"] == "safe"
        with served(data, "--port", "0", state=state) as second:
            path = begin(second, "P02")
        assert not Recording.open(path).in_progress, "Ctrl-C stops what was begun there"
        assert first.ask("/api/hello")["stop"]
        assert address.exists()
    assert gone(address), "the last one ended the worker"


needs_stopped_processes = pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGSTOP")


@contextmanager
def hanging_worker(tmp_path: Path) -> Iterator[tuple[Address, Path, dict[str, str]]]:
    """A worker that lives and does not answer, the path of its address, and the environment."""
    environment = {**os.environ, "HAPLOOP_STATE": str(tmp_path / "state")}
    command = [sys.executable, "-m", "haploop.console.worker", "--rig", "simulated", "--data", str(tmp_path)]
    command += ["--calibrations", str(tmp_path / "history")]
    worker = subprocess.Popen(command, env=environment)
    try:
        until = time.monotonic() + 60
        while not (found := list((tmp_path / "state" / "simulated").glob("console-*.json"))):
            assert time.monotonic() < until and worker.poll() is None
            time.sleep(0.05)
        address = Address.read(found[0])
        assert address is not None
        worker.send_signal(signal.SIGSTOP)
        yield address, found[0], environment
    finally:
        worker.send_signal(signal.SIGCONT)
        worker.terminate()
        worker.wait(60)


@pytest.mark.long
@needs_stopped_processes
def test_stop_at_a_worker_that_hangs_says_to_switch_the_amplifier_off(tmp_path):
    with hanging_worker(tmp_path) as (worker, _, environment):
        command = [sys.executable, "-m", "haploop", "serve", "--stop"]
        said = subprocess.run(
            command, env=environment, capture_output=True, text=True, timeout=60, check=False
        )
        assert said.returncode == 3
        assert f"process {worker.pid} hangs: switch the amplifier off" in said.stderr


def folders(place):
    return DataFolder(place, place / "history")


@pytest.mark.long
@needs_stopped_processes
def test_no_second_worker_is_started_beside_one_that_hangs(tmp_path, monkeypatch):
    monkeypatch.setenv("HAPLOOP_STATE", str(tmp_path / "state"))
    monkeypatch.setattr(link, "_HANGS", 0.5)
    monkeypatch.setattr(link, "_ANSWER", 0.5)
    file = load_rig_file("simulated")
    with hanging_worker(tmp_path) as (worker, path, _):
        with pytest.raises(WorkerHangsError, match=str(worker.pid)):
            start_worker("simulated", file, None, folders(tmp_path))
        assert Address.read(path) == worker, "its pages can STOP it when it goes on"
        os.kill(worker.pid, signal.SIGCONT)
        monkeypatch.setattr(link, "_HANGS", 20.0)
        assert start_worker("simulated", file, None, folders(tmp_path)).address == worker


@pytest.mark.filterwarnings("ignore:subprocess .* is still running")  # the worker outlives its starter
def test_of_two_programs_that_start_a_worker_at_once_one_does(tmp_path, monkeypatch):
    monkeypatch.setenv("HAPLOOP_STATE", str(tmp_path / "state"))
    file = load_rig_file("simulated")
    begun, popen = [], subprocess.Popen
    monkeypatch.setattr(
        link.subprocess, "Popen", lambda *given, **named: begun.append(given) or popen(*given, **named)
    )
    with ThreadPoolExecutor() as both:
        asked = [both.submit(start_worker, "simulated", file, None, folders(tmp_path)) for _ in range(2)]
    one, other = (each.result() for each in asked)
    try:
        assert one.address == other.address
        assert len(begun) == 1
    finally:
        one.end()
        other.end()


@pytest.mark.long
@pytest.mark.skipif(os.name == "nt", reason="Windows' terminate tells a server nothing")
def test_a_console_leaves_a_tape_of_what_its_worker_did(tmp_path):
    state, tape = tmp_path / "state", tmp_path / "day.tape"
    options = ("--port", "0", "--simulate", "wire", "--tape", str(tape))
    with served(tmp_path / "data", *options, state=state) as console:
        second = [sys.executable, "-m", "haploop", "serve", "--simulate", "wire", "--tape", "other.tape"]
        environment = {**os.environ, "HAPLOOP_STATE": str(state)}
        refused = subprocess.run(second, env=environment, capture_output=True, text=True, check=False)
        assert refused.returncode == 2 and "runs already, and a tape begins with it" in refused.stderr
        console.ask("/api/command/override", {"reason": "a test"})
        wanted = {"button": "push", "participant": "P01", "presses": 1}
        console.ask("/api/command/start", {"kind": "record", "parameters": wanted})
        path, until = tmp_path / "data" / "recordings" / "P01-push.h5", time.monotonic() + 120
        while not (path.exists() and Recording.open(path).complete):
            assert time.monotonic() < until
            time.sleep(0.2)
        address = next(iter((state / "simulated").glob("console-*.json")))
    assert gone(address)
    until = time.monotonic() + 30
    while not (found := Player(tape)).whole:
        assert time.monotonic() < until
        time.sleep(0.2)
    assert found.calls > 100


def test_a_worker_that_follows_another_has_a_tape_of_its_own(tmp_path):
    tape = tmp_path / "day.tape"
    assert free_tape(None) is None and free_tape(tape) == tape
    for name in ("day.tape", "day-2.tape"):
        (tmp_path / name).touch()
    assert free_tape(tape) == tmp_path / "day-3.tape"


@pytest.mark.long
@pytest.mark.skipif(os.name == "nt", reason="Ctrl-C of POSIX")
def test_a_console_ends_soon_after_ctrl_c(tmp_path):
    """Its question to the worker lasts for a second; the worker is told to stop after that."""
    one = start(tmp_path / "data", "--port", "0", state=tmp_path / "state")
    try:
        time.sleep(1.0)
        one.process.send_signal(signal.SIGINT)
        assert one.process.wait(5) == 130
    finally:
        end(one)


@pytest.mark.long
@pytest.mark.skipif(os.name == "nt", reason="Ctrl-C reaches a process group there")
def test_a_stop_while_a_page_is_answered_shows_no_traceback(tmp_path):
    slow = tmp_path / "slow.py"
    slow.write_text(
        "import time\n"
        "from haploop.console.server import data_routes\n"
        "data_routes.lab = lambda *_: time.sleep(3)\n"
        "from haploop.__main__ import main\n"
        "main()\n",
        encoding="utf-8",
    )
    command = [sys.executable, str(slow), "serve", "--json", "--port", "0", "--data", str(tmp_path / "data")]
    environment = {**os.environ, "HAPLOOP_STATE": str(tmp_path / "state")}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen(command, env=environment, text=True, **pipes) as process:
        base, _, token = json.loads(process.stdout.readline())["url"].partition("/#")
        with ThreadPoolExecutor(1) as pool:
            asked = pool.submit(Served(process, base, token, tmp_path / "data").ask, "/api/lab")
            time.sleep(1)
            process.terminate()
            said = process.communicate(timeout=60)[1]
            assert asked.exception() is not None, "the page had no answer"
    assert "Traceback" not in said and "Stopped" in said
