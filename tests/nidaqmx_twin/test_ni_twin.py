"""Code that knows nothing of haploop runs on simulated NI cards."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import grpc
import nidaqmx
import numpy as np
import pytest
from nidaqmx._lib import lib_importer
from nidaqmx.errors import DaqError, DaqNotFoundError, DaqReadError
from nidaqmx.system import System

from haploop.base.errors import ConfigurationError
from haploop.nidaqmx_twin import NiServer, NiTwin
from haploop.nidaqmx_twin.__main__ import main
from tests.nidaqmx_twin.ni_client import CONTINUOUS, FINITE, clocked

RATE = 1000.0


def acquire(channel: str, samples: int = 500, rate: float = RATE) -> np.ndarray:
    """A script as people write it."""
    with nidaqmx.Task() as task:
        clocked(task, channel, rate, sample_mode=FINITE, samps_per_chan=samples)
        return np.array(task.read(samples, timeout=samples / rate + 10))


def write(channel: str, values: float | list[float], rate: float = RATE) -> None:
    with nidaqmx.Task() as task:
        task.ao_channels.add_ao_voltage_chan(channel)
        if isinstance(values, list):
            task.timing.cfg_samp_clk_timing(rate, samps_per_chan=len(values))
            task.write(values, auto_start=True)
            task.wait_until_done(60)
        else:
            task.write(values)


@pytest.mark.nidaqmx(Dev1="PCIe-6363", Dev2="PCIe-6321")
def test_unchanged_code_finds_the_cards(nidaqmx_twin):
    found = {device.name: device.product_type for device in System.local().devices}
    assert found == {"Dev1": "PCIe-6363", "Dev2": "PCIe-6321"}
    nidaqmx_twin.set("Dev2/ai3", 1.25)
    assert acquire("Dev2/ai3").mean() == pytest.approx(1.25, abs=1e-3)


def test_nidaqmx_is_as_before_afterwards():
    with NiTwin({"Dev1": "PCIe-6363"}):
        assert len(System.local().devices) == 1
        assert lib_importer.encoding == "utf-8", "without the driver's library"
        slept = time.sleep
    assert time.sleep is not slept
    with pytest.raises(DaqNotFoundError):
        lib_importer.encoding  # noqa: B018  asking is the point
    with pytest.raises(DaqNotFoundError):
        System.local().devices  # noqa: B018  asking is the point


def test_an_input_reads_what_is_set(nidaqmx_twin, tmp_path):
    twin = nidaqmx_twin
    twin.set("Dev1/ai0", lambda times: 3 * np.sin(2 * np.pi * 10 * times))
    began = twin.now
    heard = acquire("Dev1/ai0", 1000)
    assert heard.std() == pytest.approx(3 / np.sqrt(2), rel=1e-3)
    spectrum = np.abs(np.fft.rfft(heard))
    assert spectrum.argmax() == 10 and twin.now - began == pytest.approx(1, abs=0.02)
    np.save(tmp_path / "steps.npy", [0.0, 1.0, 2.0, 3.0])
    for value in ([0.0, 1.0, 2.0, 3.0], tmp_path / "steps.npy"):
        twin.set("Dev1/ai1", value, rate_hz=10)
        assert np.unique(np.round(acquire("Dev1/ai1", 1000))).tolist() == [0, 1, 2, 3]
    assert acquire("Dev1/ai1", 100).mean() == pytest.approx(3, abs=0.01), "the last value is held"
    twin.set("Dev1/ai1", [0.0, 1.0], rate_hz=10, repeat=True)
    assert acquire("Dev1/ai1", 4000).mean() == pytest.approx(0.5, abs=0.03)


def test_what_was_written_can_be_asked_for_with_its_timing(nidaqmx_twin):
    ramp = np.linspace(0, 5, 200)
    write("Dev1/ao1", ramp.tolist(), rate=2000)
    put = nidaqmx_twin.put("Dev1/ao1")
    assert put.values == pytest.approx(ramp, abs=1e-3)
    assert np.diff(put.times) == pytest.approx(1 / 2000, rel=1e-6)
    assert put.at(put.times[100] + 1e-4) == pytest.approx(ramp[100], abs=1e-3)
    with nidaqmx.Task() as task:
        task.do_channels.add_do_chan("Dev1/port0/line0")
        task.write(True)
    assert nidaqmx_twin.put("Dev1/port0/line0").values[-1] == 1
    for state in (1, 0):
        nidaqmx_twin.set("Dev1/port0/line3", state)
        with nidaqmx.Task() as task:
            task.di_channels.add_di_chan("Dev1/port0/line3")
            assert task.read() is bool(state)
    assert not len(nidaqmx_twin.put("Dev1/ao0").values)


def test_a_wire_carries_an_output_to_an_input(nidaqmx_twin):
    twin = nidaqmx_twin
    twin.wire("Dev1/ao0", "Dev1/ai0", gain=0.5, offset=0.1)
    twin.wire("Dev1/ao0", "Dev1/ai1", low_pass_hz=5.0)
    twin.wire("Dev1/ao0", "Dev1/ai2", noise=0.1)
    write("Dev1/ao0", 4.0)
    assert acquire("Dev1/ai0").mean() == pytest.approx(2.1, abs=1e-3)
    assert acquire("Dev1/ai2").std() == pytest.approx(0.1, rel=0.2)
    write("Dev1/ao0", 0.0)
    heard = acquire("Dev1/ai1", 60)
    assert 3.0 < heard[0] < 4.0 and np.polyfit(np.arange(60) / RATE, np.log(heard), 1)[0] == pytest.approx(
        -2 * np.pi * 5, rel=1e-2
    )


def test_an_hour_with_callbacks_is_seconds(nidaqmx_twin, full):
    nidaqmx_twin.set("Dev1/ai0", lambda times: times % 4)
    minutes = 60 if full else 2
    blocks: list[list[float]] = []
    with nidaqmx.Task() as task:
        clocked(task, "Dev1/ai0", 100, sample_mode=CONTINUOUS)
        task.register_every_n_samples_acquired_into_buffer_event(
            1000, lambda _task, _event, count, _data: blocks.append(task.read(count)) or 0
        )
        task.start()
        time.sleep(60 * minutes + 0.5)
        task.stop()
    assert len(blocks) == 6 * minutes
    assert np.unwrap(np.ravel(blocks), period=4)[-1] == pytest.approx(60 * minutes, abs=0.1)


def test_a_card_fails_as_asked(nidaqmx_twin):
    for how, code in (("overflow", -200010), ("overrun", -200279)):
        nidaqmx_twin.fail("Dev1", how)
        with pytest.raises(DaqReadError) as lost:
            acquire("Dev1/ai0")
        assert lost.value.error_code == code
        acquire("Dev1/ai0")
    for how, code in (("reserved", -50103), ("removed", -201003)):
        nidaqmx_twin.fail("Dev1", how)
        for use in (acquire, lambda _channel: write("Dev1/ao0", 1.0)):
            with pytest.raises(DaqError) as refused:
                use("Dev1/ai0")
            assert refused.value.error_code == code
        nidaqmx_twin.fail("Dev1", None)
        acquire("Dev1/ai0")
    got = 0
    with nidaqmx.Task() as task:
        clocked(task, "Dev1/ai0", RATE, sample_mode=CONTINUOUS)
        task.start()
        while got < 100:  # polling comes to an end
            got += len(task.read(nidaqmx.constants.READ_ALL_AVAILABLE))
        nidaqmx_twin.fail("Dev1", "removed")
        with pytest.raises(DaqError) as refused:
            task.read(100)
    assert refused.value.error_code == -201003


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        (lambda twin: twin.set("Dev1/ai99", 1.0), "does not exist"),
        (lambda twin: twin.set("Dev9/ai0", 1.0), "there is no device 'Dev9'"),
        (lambda twin: twin.set("Dev1/ai0", [1.0, 2.0]), "needs its rate"),
        (lambda twin: twin.set("Dev1/ai0", [1.0, np.nan], rate_hz=1), "finite"),
        (lambda twin: twin.set("Dev1/ai0", "nothing.npy"), "cannot be read"),
        (lambda twin: twin.set("Dev1/ai0", "x.txt"), "none of .npy"),
        (lambda twin: twin.wire("Dev1/ao9", "Dev1/ai0"), "no output 'Dev1/ao9'"),
        (lambda twin: twin.put("Dev1/ai0"), "no output 'Dev1/ai0'"),
        (lambda twin: twin.fail("Dev1", "fire"), "not by 'fire'"),
        (lambda twin: twin.fail("Dev7", "removed"), "there is no device 'Dev7'"),
        (lambda _twin: NiTwin({"Dev1": "PCIe-0000"}), "no simulated 'PCIe-0000'"),
        (lambda _twin: NiTwin({"Dev1": "PCIe-6363"}, time="fast"), '"virtual" or "real"'),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(nidaqmx_twin, wrong, sentence):
    with pytest.raises(ConfigurationError, match=sentence):
        wrong(nidaqmx_twin)


SCRIPT = """
import grpc
import nidaqmx
from nidaqmx.system import System
print(*[device.product_type for device in System.local().devices])
with nidaqmx.Task() as task:
    task.ai_channels.add_ai_voltage_chan("Dev1/ai0")
    print(len(task.read(7)))
raise SystemExit(5)
"""


@pytest.mark.long
def test_a_script_of_another_program(tmp_path):
    (tmp_path / "script.py").write_text(SCRIPT, encoding="utf-8")
    (tmp_path / "sitecustomize.py").write_text("print('of the lab')", encoding="utf-8")
    (tmp_path / "cards.ini").write_text(
        "[DAQmxDevice Dev1]\nProductType=PCIe-6321\nDevIsSimulated=1\n", encoding="utf-8"
    )
    for devices in (["--device", "Dev1=PCIe-6321"], ["--devices", "cards.ini"]):
        command = [sys.executable, "-m", "haploop.nidaqmx_twin", *devices, "--", sys.executable, "script.py"]
        ran = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert (ran.returncode, ran.stdout.split(), ran.stderr) == (5, ["PCIe-6321", "7"], "")


@pytest.mark.long
def test_a_run_of_tests_ends_in_silence(tmp_path):
    """pytest keeps the client of the cards until Python itself has ended."""
    (tmp_path / "test_it.py").write_text(
        "from nidaqmx.system import System\n\n\ndef test_it():\n    assert len(System.local().devices) == 1\n"
    )
    tests = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "test_it.py"]
    command = [sys.executable, "-m", "haploop.nidaqmx_twin", "--device", "Dev1=PCIe-6321", "--", *tests]
    ran = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (ran.returncode, ran.stderr) == (0, ""), ran.stdout + ran.stderr


@pytest.mark.parametrize(
    ("options", "code", "sentence"),
    [
        ((), 2, "Name a card"),
        (("--device", "Dev1"), 2, "NAME=PRODUCT"),
        (("--device", "Dev1=PCIe-6363", "--device", "Dev1=PCIe-6321"), 2, "name each device once"),
        (("--device", "Dev1=PCIe-6364"), 2, "did you mean"),
        (("--devices", "none.ini"), 2, "cannot be read"),
        (("--device", "Dev1=PCIe-6321", "--devices", "none.ini"), 2, "leave out --device"),
        (("--bench", "bench.toml"), 2, "served by haploop only"),
        (("--device", "Dev1=PCIe-6321", "--port", "70000"), 2, "from 0 to 65535"),
        (("--device", "Dev1=PCIe-6321", "--", "no-such-program"), 2, "no-such-program cannot be run"),
    ],
)
def test_what_cannot_be_run_is_one_sentence(options, code, sentence, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("bench.toml").write_text('[devices]\nDev1 = "PCIe-6321"\n[instruments]\nCOM3 = "x.toml"\n')
    try:
        ended = main(options)
    except SystemExit as usage:
        ended = int(str(usage.code))
    assert ended == code and sentence in capsys.readouterr().err


OPEN = """
import grpc
import nidaqmx
from nidaqmx.constants import AcquisitionType
task = nidaqmx.Task()
task.ai_channels.add_ai_voltage_chan("Dev1/ai0")
task.timing.cfg_samp_clk_timing(1000, sample_mode=AcquisitionType.CONTINUOUS)
task.register_every_n_samples_acquired_into_buffer_event(100, lambda *_: 0)
task.register_done_event(lambda *_: 0)
task.start()
raise SystemExit(5)
"""


@pytest.mark.long
def test_a_script_ends_though_a_task_with_events_is_open(tmp_path):
    (tmp_path / "script.py").write_text(OPEN, encoding="utf-8")
    command = [sys.executable, "-m", "haploop.nidaqmx_twin", "--device", "Dev1=PCIe-6321"]
    with subprocess.Popen([*command, "--", sys.executable, "script.py"], cwd=tmp_path) as program:
        try:
            assert program.wait(timeout=60) == 5
        finally:
            program.terminate()


@pytest.mark.long
@pytest.mark.skipif(os.name == "nt", reason="Windows delivers Ctrl-C to a console, not to a process")
@pytest.mark.parametrize(
    ("sent", "heed", "code"),
    [
        (signal.SIGINT, "", 3),
        (signal.SIGTERM, "import signal\nsignal.signal(signal.SIGTERM, lambda *_: exit(4))\n", 4),
    ],
)
def test_a_stopped_script_ends_as_the_script_says(tmp_path, sent, heed, code):
    """A loop until Ctrl-C, as NI's own examples have it: what ends well is no failure of haploop's."""
    (tmp_path / "script.py").write_text(
        f"{heed}import time\ntry:\n    print('running', flush=True)\n    time.sleep(60)\n"
        "except KeyboardInterrupt:\n    raise SystemExit(3)\n",
        encoding="utf-8",
    )
    served = [sys.executable, "-m", "haploop.nidaqmx_twin", "--device", "Dev1=PCIe-6321"]
    with subprocess.Popen(
        [*served, "--", sys.executable, "script.py"], cwd=tmp_path, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True, start_new_session=True,
    ) as program:  # fmt: skip
        assert program.stdout is not None and program.stdout.readline() == "running\n"
        if sent == signal.SIGINT:
            os.killpg(program.pid, sent)
        else:
            program.send_signal(sent)
        told = program.communicate(timeout=30)[1]
    assert program.returncode == code, told
    assert told == ""


def test_a_third_party_package_runs_unchanged(nidaqmx_twin):
    """nidaqwrapper, whose own tests need NI's driver or mock nidaqmx."""
    wrapper = pytest.importorskip("nidaqwrapper", reason="python -m pip install nidaqwrapper")
    nidaqmx_twin.set("Dev1/ai2", lambda times: np.sin(2 * np.pi * 50 * times))
    task = wrapper.AITask("twin", sample_rate=5000)
    task.add_channel("sine", "Dev1", 2, units="V", min_val=-5.0, max_val=5.0)
    task.start()
    heard = np.asarray(task.acquire(5000))
    task.clear_task()
    row = heard[0] if heard.shape[0] == 1 else heard[:, 0]
    assert len(row) == 5000 and row.std() == pytest.approx(np.sqrt(0.5), rel=1e-2)


def test_calls_that_pass_grpc_by_are_the_same(monkeypatch):
    past = _seen()
    monkeypatch.setattr(NiServer, "direct", lambda server: grpc.insecure_channel(server.address))
    assert past == _seen()


def _seen() -> list[object]:
    seen: list[object] = []
    with NiTwin({"Dev1": "PCIe-6363"}) as twin:
        twin.wire("Dev1/ao0", "Dev1/ai0")
        write("Dev1/ao0", 1.5)
        seen += acquire("Dev1/ai0", 5).round(3).tolist()
        for code in (lambda: acquire("Dev9/ai0"), lambda: acquire("Dev1/ai0", rate=1e9)):
            with pytest.raises(DaqError) as refused:
                code()
            seen += [refused.value.error_code, str(refused.value)]
        with nidaqmx.Task("mine") as task:
            task.ai_channels.add_ai_voltage_chan("Dev1/ai0:1", "a,b")
            task.timing.cfg_samp_clk_timing(RATE, sample_mode=CONTINUOUS, samps_per_chan=1000)
            task.register_every_n_samples_acquired_into_buffer_event(
                100, lambda _task, _event, count, _data: seen.append(len(task.read(count)[0])) or 0
            )
            seen += [*task.channel_names, task.timing.samp_clk_rate]
            with pytest.raises(DaqError) as refused:
                nidaqmx.Task("mine")
            seen.append(refused.value.error_code)
            task.start()
            twin.sleep(0.35)
            with pytest.raises(DaqReadError) as late:
                task.read(5000, timeout=0.5)
            seen += [late.value.error_code, twin.now]
    names = ["a", "b", 1000.0, -200089]
    assert seen[:6] == [1.5] * 5 + [-200220]
    assert [one for one in seen if one in names][-4:] == names
    assert seen.count(100) >= 3
    return seen


@pytest.mark.nidaqmx(Dev1="USB-6211", Mod1="NI 9472", Dev2="USB-6212")
@pytest.mark.parametrize(
    ("way", "lines", "code"),
    [
        ("di", "Dev1/port0/line0:3", 0), ("do", "Dev1/port1", 0), ("do", "Dev2/port0/line0", 0),
        ("do", "Dev1/port0/line0", -200430), ("di", "Dev1/port1", -200430),
        ("di", "Mod1/port0/line1", -200430),
    ],
)  # fmt: skip
def test_a_line_that_goes_one_way_only(nidaqmx_twin, way, lines, code):
    with nidaqmx.Task() as task:
        made = task.di_channels.add_di_chan if way == "di" else task.do_channels.add_do_chan
        try:
            made(lines)
        except DaqError as error:
            assert error.error_code == code
        else:
            assert not code
