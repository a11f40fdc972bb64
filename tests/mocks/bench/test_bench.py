"""A bench file sets inputs, connects wires and lets cards fail, and no line of the program changes."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from haploop.base.errors import ConfigurationError
from haploop.instruments import recorded
from haploop.instruments.tape import TapeLines
from haploop.mocks.bench import running
from haploop.nidaqmx_twin.bench import read_bench

BENCH = """
[devices]
Dev1 = "PCIe-6363"
[inputs]
"dev1/AI0" = 1.5
"Dev1/ai1" = { waveform = "sine", frequency_hz = 50, amplitude = 2 }
"Dev1/ai2" = { samples = [0, 1, 2, 3], rate_hz = 100, repeat = true }
"Dev1/ai3" = { file = "signal.npy", rate_hz = 100, repeat = true }
"Dev1/ai6:7" = -1
"Dev1/port0/line1" = true
[[wires]]
from = "dev1/ao0"
to = "Dev1/ai4"
gain = 0.5
noise = 0.01
[[faults]]
device = "Dev1"
kind = "overflow"
"""
SCRIPT = """
import json
import nidaqmx
with nidaqmx.Task() as task:
    task.ao_channels.add_ao_voltage_chan("Dev1/ao0")
    task.write(2.0)
code = 0
for _ in range(2):
    with nidaqmx.Task() as task:
        task.ai_channels.add_ai_voltage_chan("Dev1/ai0:7")
        task.timing.cfg_samp_clk_timing(1000, samps_per_chan=400)
        try:
            heard = task.read(400)
        except nidaqmx.DaqError as error:
            code = error.error_code
with nidaqmx.Task() as task:
    task.di_channels.add_di_chan("Dev1/port0/line0:3")
    lines = task.read()
print(json.dumps([lines, code, heard]))
raise SystemExit(7)
"""


@pytest.mark.long
def test_a_program_finds_its_bench(tmp_path, run):
    import json

    (tmp_path / "bench.toml").write_text(BENCH)
    (tmp_path / "script.py").write_text(SCRIPT)
    np.save(tmp_path / "signal.npy", [0.0, 4.0])
    twin = [sys.executable, "-m", "haploop", "twin", "ni", "--bench", "bench.toml", "--tape", "it.tape"]
    command = [*twin, "--", sys.executable, "script.py"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 7, done.stderr
    lines, code, heard = json.loads(done.stdout)
    rows = np.array(heard)
    assert lines & 2 and code == -200010, "line 1 is set, and the first read overflows"
    assert rows[:5].mean(axis=1) == pytest.approx([1.5, 0, 1.5, 2, 1], abs=0.01)
    assert rows[1].std() == pytest.approx(np.sqrt(2), rel=0.01)
    assert np.unique(rows[2].round()).tolist() == [0, 1, 2, 3]
    assert rows[4].std() == pytest.approx(0.01, rel=0.2)
    assert rows[6:].mean() == pytest.approx(-1, abs=1e-3)

    said = TapeLines.of(tmp_path / "it.tape")
    calls = [line["do"] for line in said.lines if line["is"] == "call"]
    assert said.whole and calls.count("CreateTask") == 4 and "WriteAnalogF64" in calls
    (written,) = [line for line in said.lines if line.get("do") == "WriteAnalogF64"]
    assert written["with"][0]["d"]["task"]["d"]["name"]
    failed = [line["error"][1][1] for line in said.lines if "error" in line]
    assert failed == [-200010]
    shown = run("tape show", tmp_path / "it.tape")
    assert "a program's own calls, without a rig" in shown.output
    run("doctor --simulate", f"tape:{tmp_path / 'it.tape'}", ends=2)


def test_every_input_has_noise_of_its_own(tmp_path):
    (tmp_path / "bench.toml").write_text(HEAD + '[inputs]\n"Dev1/ai0:2" = { waveform = "noise", rms = 1 }\n')
    signals = read_bench(tmp_path / "bench.toml").inputs["Dev1/ai0:2"]
    drawn = [signals(f"Dev1/ai{number}")(np.arange(1000) / 1000) for number in range(3)]
    assert np.allclose(np.corrcoef(drawn), np.eye(3), atol=0.15)
    assert np.array_equal(drawn[0], signals("Dev1/ai0")(np.arange(1000) / 1000))


HEAD = '[devices]\nDev1 = "PCIe-6363"\n'
INPUT = HEAD + '[inputs]\n"Dev1/ai0" = '
WIRE = HEAD + '[[wires]]\nfrom = "Dev1/ao0"\nto = "Dev1/ai0"\n'
FAULT = HEAD + '[[faults]]\ndevice = "Dev1"\n'
WRONG = {
    HEAD + "[inputz]": "line 3: unknown key 'inputz'; did you mean 'inputs'",
    INPUT + '{ wavform = "sine" }': "line 4: inputs.Dev1/ai0: .*did you mean 'waveform'",
    INPUT + '{ waveform = "sin" }': "no waveform 'sin'; did you mean 'sine'",
    INPUT + '{ waveform = "sine", frequency = 3 }': "did you mean 'frequency_hz'",
    INPUT + '{ waveform = "sine", frequency_hz = -3 }': "frequency_hz must be above 0",
    INPUT + '{ waveform = "noise", rms = true }': "rms: must be a number",
    INPUT + '"x"': "an input is a number, or a table",
    INPUT + "nan": "finite",
    INPUT + "{ samples = [1, 2] }": "'rate_hz' is missing",
    INPUT + '{ file = "none.npy", rate_hz = 1 }': "there is no file",
    INPUT + '{ file = "a.wav", rate_hz = 1 }': "brings its own rate",
    HEAD + '[inputs]\n"Dev1/ai99" = 1': "line 4: Dev1/ai99: Physical channel specified does not exist",
    HEAD + '[inputs]\n"Dve1/ai9" = 1': "no device 'Dve1' on this bench; did you mean 'Dev1'",
    HEAD + '[inputs]\n"Dev1/ao0" = 1': "is no input",
    HEAD + '[inputs]\n"Dev1/ctr0" = 1': "is no input",
    HEAD + '[inputs]\n"Dev1/ai0:1" = 1\n"Dev1/ai1" = 2': "sets Dev1/ai0:1, and .* sets Dev1/ai1",
    WIRE + "[inputs]\n'Dev1/ai0' = 1": "sets Dev1/ai0, and a wire goes from Dev1/ao0",
    WIRE + "delay = 1": "unknown key 'wires.0.delay'; did you mean 'delay_s'",
    WIRE.replace("ao0", "ao9"): "no output 'Dev1/ao9'",
    FAULT + 'kind = "explode"': "kind must be 'overflow', 'overrun', 'removed' or 'reserved'",
    FAULT + 'kind = "overflow"\nuntil_s = 3': "leave out until_s",
    FAULT + 'kind = "removed"\nat_s = 3\nuntil_s = 3': r"until_s \(3\) comes after at_s \(3\)",
    HEAD.replace("PCIe-6363", "6363"): "no simulated '6363'",
    "devices = 3": "devices must be a table",
    "[devices": "is not valid TOML",
}


@pytest.mark.parametrize("text", WRONG)
def test_a_wrong_bench_is_one_sentence(text, tmp_path):
    path = tmp_path / "bench.toml"
    path.write_text(text)
    with pytest.raises(ConfigurationError, match=f"(?s){WRONG[text]}") as raised:
        said = read_bench(path)
        with running(said.devices, said):
            pass
    assert "\n" not in str(raised.value)


TIMES = np.array([0.0, 0.1, 0.25, 0.6, 0.75])
WAVEFORMS = {
    '"sine", frequency_hz = 1': np.sin(2 * np.pi * TIMES),
    '"sine", frequency_hz = 1, phase_deg = 90, offset = 1': 1 + np.cos(2 * np.pi * TIMES),
    '"square", frequency_hz = 1': [1, 1, 1, -1, -1],
    '"square", frequency_hz = 1, duty = 0.2': [1, 1, -1, -1, -1],
    '"triangle", frequency_hz = 1': [0, 0.4, 1, -0.4, -1],
    '"sawtooth", frequency_hz = 1': [-1, -0.8, -0.5, 0.2, 0.5],
    '"step", at_s = 0.25, after = 3': [0, 0, 3, 3, 3],
    '"chirp", from_hz = 1, to_hz = 1, duration_s = 0.5, amplitude = 2': 2 * np.sin(2 * np.pi * (TIMES % 0.5)),
}


@pytest.mark.parametrize("said", WAVEFORMS)
def test_a_waveform_is_what_its_name_says(said, tmp_path):
    path = tmp_path / "bench.toml"
    path.write_text(INPUT + f"{{ waveform = {said} }}")
    assert read_bench(path).inputs["Dev1/ai0"]("Dev1/ai0")(TIMES) == pytest.approx(np.array(WAVEFORMS[said]))


def test_a_card_is_removed_and_comes_back(tmp_path):
    import grpc
    import nidaqmx
    from nidaqmx import GrpcSessionOptions

    path = tmp_path / "bench.toml"
    path.write_text(FAULT + 'kind = "removed"\nuntil_s = 0.5')
    said = read_bench(path)
    with running(said.devices, said) as found, grpc.insecure_channel(found.twin.address) as channel:
        codes = []
        while found.twin.now < 5 and codes[-1:] != [0]:
            try:
                with nidaqmx.Task(grpc_options=GrpcSessionOptions(channel, "")) as task:
                    task.ai_channels.add_ai_voltage_chan("Dev1/ai0")
                    task.read()
                codes.append(0)
            except nidaqmx.DaqError as error:
                codes.append(error.error_code)
    assert set(codes[:-1]) == {-201003} and codes[-1] == 0


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ((), None),
        (("--device", "Dev1"), "NAME=PRODUCT"),
        (("--device", "Dev1=PCIe-6363", "--device", "Dev1=PCIe-6363"), "twice"),
        (("--device", "Dev1=PCIe-6363", "--rig", "simulated"), "exclude each other"),
        (("--device", "Dev1=PCIe-6363", "--bench", "bench.toml"), "name each device once"),
        (("--bench", "none.toml"), "no bench file"),
        (("--tape", "new.tape"), "name the devices"),
    ],
)
def test_options_that_do_not_fit_are_refused(options, told, tmp_path, monkeypatch, run):
    monkeypatch.chdir(tmp_path)
    Path("bench.toml").write_text(HEAD)
    done = run("twin ni", *options, "--", sys.executable, "-c", "", ends=2)
    assert (told or "name the devices") in done.output


def test_a_tape_without_a_call_is_not_passed_over_in_silence(tmp_path):
    with (
        pytest.warns(UserWarning, match="Nothing was recorded.*--tape"),
        recorded(tmp_path / "a.tape"),
    ):
        pass
    assert not (tmp_path / "a.tape").exists()
