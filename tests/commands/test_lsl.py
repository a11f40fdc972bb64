"""`haploop live --lsl`, received by a real pylsl inlet in a program of its own. Loopback only."""

import json
import os
import subprocess
import sys
import threading
import time
import uuid
from pathlib import Path

import numpy as np
import pytest

import haploop
from haploop.commands.live_views import Stamps, find, published
from haploop.instruments.live import Run
from haploop.instruments.safety import state_folder
from haploop.instruments.sensors import Sensors

LOOPBACK = """
[ports]
IPv6 = disable
[multicast]
ResolveScope = machine
ListenAddress = 127.0.0.1
[lab]
KnownPeers = {{127.0.0.1}}
SessionID = {session}
[log]
level = -3
"""
INLET = """
import json, sys
import numpy as np
import pylsl
(found,) = pylsl.resolve_byprop("name", "haploop simulated record", 1, 60.0)
inlet = pylsl.StreamInlet(found, recover=False)
inlet.open_stream(30.0)
print("connected", flush=True)
info = inlet.info()
channel = info.desc().child("channels").child("channel")
labels = []
while not channel.empty():
    labels.append([channel.child_value("label"), channel.child_value("unit")])
    channel = channel.next_sibling()
values, stamps = [], []
try:
    while True:
        some, times = inlet.pull_chunk(timeout=1.0)
        values += some
        stamps += times
except pylsl.util.LostError:
    pass
about = {"labels": labels, "rate": info.nominal_srate(), "simulated": info.desc().child_value("simulated")}
np.savez(sys.argv[1], values=values, stamps=stamps, about=json.dumps(about))
"""


def loopback(folder: Path) -> dict[str, str]:
    """Environment of programs that see only one another; tests beside this one use the same names."""
    file = folder / "lsl_api.cfg"
    file.write_text(LOOPBACK.format(session=uuid.uuid4().hex), encoding="utf-8")
    return os.environ | {"LSLAPICFG": str(file)}


def block(run: Run, first: int, samples: int = 50) -> haploop.instruments.LiveBlock:
    return haploop.instruments.LiveBlock(run, first, np.zeros((1, samples)), np.zeros(1, dtype=np.bool_))


def run_number(number: int) -> Run:
    return Run("r", True, "record", "", ("a",), 1000.0, Sensors(), None, number)


def test_stamps_are_even_although_blocks_are_held_up():
    stamps, run = Stamps(), run_number(1)
    late = np.array([0.004, 0.002, 0.3, 0.05, 0.002, 0.002])
    found = [stamps.of(block(run, 50 * k), 100 + 0.05 * (k + 1) + late[k]) for k in range(6)]
    # From the second block, the least late, on: its lateness, and the time of its last sample.
    last = [times[-1] for times in found]
    np.testing.assert_allclose(last[1:], 100 + 0.05 * np.arange(2, 7) + 0.002, atol=1e-4)
    np.testing.assert_allclose(np.diff(np.concatenate(found[2:])), 0.001, atol=1e-5)


def test_stamps_rise_when_the_first_block_was_late_or_a_simulation_runs_ahead():
    stamps, run = Stamps(), run_number(1)
    arrivals = [100.5, *(100.05 + 0.05 * np.arange(2, 30)), *np.full(10, 101.5)]
    found = np.concatenate([stamps.of(block(run, 50 * k), at) for k, at in enumerate(arrivals)])
    assert np.diff(found).min() > 0.49e-3
    assert found[30 * 50 - 1] == pytest.approx(101.5, abs=0.06)


def test_a_gap_is_a_gap_in_the_stamps():
    stamps, run = Stamps(), run_number(1)
    before = stamps.of(block(run, 0), 100.05)
    after = stamps.of(block(run, 500), 100.55)
    assert after[0] - before[-1] == pytest.approx(0.451, abs=1e-4)


def test_stamps_follow_a_clock_that_drifts_and_begin_anew_with_a_run():
    stamps, run = Stamps(), run_number(1)
    for k in range(20_000):  # 1000 s, in which the card's clock loses 50 ms
        arrival = 1.00005 * 0.05 * (k + 1) + 0.002
        stamp = stamps.of(block(run, 50 * k), arrival)[-1]
    assert abs(stamp - arrival) < 1e-4
    again = stamps.of(block(run_number(2), 0), 5000.0)
    assert again[-1] == pytest.approx(5000.0)


def test_stamps_begin_anew_with_another_program():
    stamps = Stamps()
    for program in range(3):  # each numbers its runs from 1, and may be joined late
        stamps.begin()
        for k in range(2 * program, 20 * (program + 1)):
            arrival = 100 + 60 * program + 0.05 * k
            assert stamps.of(block(run_number(1), 50 * k), arrival)[-1] == pytest.approx(arrival)


def test_a_missing_pylsl_is_named(run, monkeypatch):
    monkeypatch.setitem(sys.modules, "pylsl", None)
    run("live --lsl", says='pip install "haploop[lsl]"')


def test_a_viewer_that_waits_misses_nothing(tmp_path):
    """Even of a simulated rig, which measures faster than a viewer connects."""
    file, blocks = haploop.load_rig_file("simulated"), []

    def view():
        with find(file, None, 60, 4096) as tap:
            blocks.extend(tap)
            blocks.append(tap.dropped)

    viewer = threading.Thread(target=view)
    viewer.start()
    folder = state_folder(file, True)
    while not list(folder.glob("waiting-*.txt")):
        time.sleep(0.01)
    with haploop.open_rig("simulated") as rig, published(rig):
        recording = haploop.record(rig, "latch", "P01", 1, tmp_path)
    viewer.join(60)
    *blocks, dropped = blocks
    assert dropped == 0 and blocks[0].first == 0
    assert blocks[-1].end >= recording.volts.shape[1]
    assert not list(folder.glob("waiting-*.txt"))


def test_a_viewer_that_was_killed_is_not_waited_for_twice(tmp_path):
    file = haploop.load_rig_file("simulated")
    left, other = (state_folder(file, True) / f"waiting-{name}.txt" for name in ("left", "other"))
    left.write_text(file.name)
    other.write_text("another rig")
    with haploop.open_rig("simulated") as rig, published(rig):
        assert not left.exists() and other.exists()
    other.unlink()


def test_an_inlet_receives_what_is_recorded(tmp_path, monkeypatch):
    pytest.importorskip("pylsl", reason='pylsl is not installed: python -m pip install -e ".[lsl]"')
    environment = loopback(tmp_path)
    live = [sys.executable, "-m", "haploop", "live", "--lsl", "--wait", "60"]
    sender = subprocess.Popen(live, env=environment, stderr=subprocess.PIPE, text=True)
    inlet = subprocess.Popen(
        [sys.executable, "-c", INLET, str(tmp_path / "received.npz")],
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert inlet.stdout.readline() == "connected\n"  # before anything is recorded, as with LabRecorder
        with haploop.open_rig("simulated", real_time=True) as rig, rig.publish_live():
            recording = haploop.record(rig, "latch", "P01", 1, tmp_path)
        sender.terminate()
        inlet.communicate(timeout=60)
        assert inlet.returncode == 0
    finally:
        for process in (sender, inlet):
            process.kill()
            process.communicate()
    with np.load(tmp_path / "received.npz") as received:
        values, stamps, about = received["values"], received["stamps"], json.loads(str(received["about"]))
    assert about["rate"] == recording.rate_hz and about["simulated"] == "true"
    assert about["labels"][2] == ["Fz", "N"] and ["acceleration z", "m/s^2"] in about["labels"]
    volts = dict(zip(recording.channels, recording.volts, strict=True))
    force, acceleration = (
        sensor.to_si(np.stack([volts[name] for name in sensor.channels]))
        for sensor in (recording.sensors.force, recording.sensors.acceleration)
        if sensor is not None
    )
    # Blocks may be missing on a busy computer; what comes is what was recorded, in its order.
    where = {row.tobytes(): index for index, row in enumerate(np.concatenate([force, acceleration]).T)}
    index = [where[row.tobytes()] for row in np.ascontiguousarray(values[:, :9])]
    assert len(index) > 0.5 * recording.volts.shape[1]
    assert np.all(np.diff(index) > 0)
    step = np.diff(stamps)[np.diff(index) == 1] * recording.rate_hz
    assert np.diff(stamps).min() > 0 and np.median(step) == pytest.approx(1, abs=0.01)
