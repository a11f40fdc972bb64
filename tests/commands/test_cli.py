import json
import os
import signal
import subprocess
import sys

import grpc
import nidaqmx
import nidaqmx.system
import pytest
from click.testing import CliRunner

from haploop.acquisition import Recording
from haploop.commands.cli import cli


def test_help_and_version(run):
    assert "demo" in run("--help").stdout
    assert run("--version").stdout.startswith("haploop 0.")


def test_record_then_show(run, tmp_path):
    recorded = run("record toggle -p P03 --presses 2 --out", tmp_path, "--json", ends=0)
    values = json.loads(recorded.stdout)
    assert (values["button"], values["participant"], values["presses_detected"]) == ("toggle", "P03", 2)
    assert "Everything here is simulated (twin, seed 0)." in recorded.stderr
    assert run.json("show", tmp_path / "P03-toggle.h5") == values
    run("record toggle -p P03 --presses 2 --out", tmp_path, says="P03-toggle.h5")


def test_a_bug_is_one_sentence_and_a_code_of_its_own(monkeypatch):
    from haploop.reports import contents

    def broken(*_args):
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr(contents, "file_contents", broken)
    result = CliRunner().invoke(cli, ["show", "anything"])
    assert result.exit_code == 70
    assert result.stderr.count("\n") == 1


@pytest.mark.skipif(os.name == "nt", reason="Windows delivers Ctrl-C to a console, not to a process")
@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)], ids=["Ctrl-C", "SIGTERM"]
)
def test_a_stopped_recording_is_safe_and_readable(tmp_path, number, code):
    command = [
        sys.executable, "-m", "haploop", "record", "latch", "-p", "P01", "-n", "60", "-o", str(tmp_path),
    ]  # fmt: skip
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert "simulated" in process.stderr.readline()
        assert "Record the latch button" in process.stderr.readline()
        process.send_signal(number)
        out, err = process.communicate(timeout=60)
    assert process.returncode == code, err
    assert out == ""
    (sentence,) = err.split("\n")[1:-1]  # the first line ends what the terminal echoes as ^C
    assert "the output is zero and the relay is open" in sentence
    assert str(tmp_path) in sentence
    recording = Recording.open(tmp_path / "P01-latch.h5")
    assert not recording.complete
    assert recording.duration > 0.4
    assert recording.volts.shape[0] == len(recording.channels)


@pytest.mark.long
@pytest.mark.skipif(os.name == "nt", reason="Windows delivers Ctrl-C to a console, not to a process")
def test_twin_ni_serves_the_devices_of_an_export(tmp_path):
    export = tmp_path / "max.ini"
    export.write_text("[DAQmxDevice Dev1]\nProductType = PCIe-6363\nDevIsSimulated = 1\n", encoding="utf-8")
    command = [sys.executable, "-m", "haploop", "twin", "ni", "--devices", str(export)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            line = process.stdout.readline()
            assert line.startswith("Server listening on port ")
            with grpc.insecure_channel(
                f"127.0.0.1:{int(line.split()[-1])}", options=[("grpc.enable_http_proxy", 0)]
            ) as channel:
                options = nidaqmx.GrpcSessionOptions(channel, "")
                assert nidaqmx.system.System.remote(options).devices.device_names == ["Dev1"]
        finally:
            process.send_signal(signal.SIGINT)
            _, err = process.communicate(timeout=30)
    assert process.returncode == 0, err


def test_an_unknown_name_is_an_attribute_error():
    import haploop

    with pytest.raises(AttributeError, match="recrod"):
        haploop.recrod  # noqa: B018
