"""What cannot end well is refused before a rig is opened, or ends in one plain sentence."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from haploop.base.errors import ConfigurationError, DataError
from haploop.base.files import os_error_text
from haploop.base.hdf5 import write
from haploop.reports import figures, outputs
from tests.elsewhere import in_use_elsewhere

SIMULATED = "Everything here is simulated"
"""What a command says once its rig is open."""


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    path = tmp_path / "lab.toml"
    path.write_text('base = "haptable"\nname = "lab"\n', encoding="utf-8")
    return path


@pytest.mark.parametrize(
    "command",
    [["record", "latch", "-p", "P01"], ["calibrate"], ["doctor"], ["reset", "--reason", "why"]],
    ids=" ".join,
)
def test_two_commands_never_share_a_relay(run, lab, tmp_path, command):
    out = [] if command[0] in ("doctor", "reset") else ["--out", tmp_path / "out"]
    with in_use_elsewhere(lab):
        result = run(*command, *out, "--rig", lab)
    assert result.exit_code == 3
    assert result.stdout == ""
    assert "The rig 'lab' is in use (" in result.stderr
    assert f") by process {os.getpid()} (" in result.stderr
    assert result.stderr.count("\n") == 1


def test_a_simulation_needs_no_lock(run, lab, tmp_path):
    with in_use_elsewhere(lab):
        result = run("record latch -p P01 -n 1 -o", tmp_path, "--rig", lab, "--simulate", "twin")
    assert SIMULATED in result.stderr and "in use" not in result.stderr


@pytest.mark.skipif(not Path("/proc/self").is_dir(), reason="needs a folder that not even root can write to")
def test_a_calibration_that_could_not_be_kept_is_not_measured(run):
    result = run("calibrate --out /proc/calibration.h5", says="/proc cannot be written")
    assert SIMULATED not in result.stderr


@pytest.mark.parametrize("name", ["latch-press.h5", "latch-drive.h5", "latch-check.png"])
def test_a_check_that_could_not_be_kept_is_not_played(demo, run, tmp_path, name):
    (tmp_path / name).write_text("mine")
    result = run(
        "check", demo.folder / "recordings" / "P01-latch.h5", "--calibration", demo.folder / "calibration.h5",
        "--out", tmp_path, ends=2,
    )  # fmt: skip
    assert name in result.stderr and "participant" not in result.stderr
    assert SIMULATED not in result.stderr
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [(name, "mine")]


def test_a_check_of_what_is_simulated_says_so(demo, run, tmp_path, monkeypatch):
    drawn: list[Figure] = []

    def encode(figure, kind):
        drawn.append(figure)
        return b"PNG"

    monkeypatch.setattr(figures, "encode", encode)
    recording = demo.folder / "recordings" / "P01-latch.h5"
    result = run(
        "check", recording, "--calibration", demo.folder / "calibration.h5", "--out", tmp_path / "new",
    )  # fmt: skip
    assert result.exit_code in (0, 1, 4), result.output
    assert "Simulated: no real instrument measured this." in result.stdout
    run("show", recording, "--plot", tmp_path / "p.png", ends=0)
    run("show", tmp_path / "new" / "latch-drive.h5", "--plot", tmp_path / "d.png", ends=0)
    assert len(drawn) == 3
    assert all([text.get_text() for text in figure.texts] == ["simulated"] for figure in drawn)


def test_what_was_measured_is_not_marked(tmp_path):
    figure = Figure()
    outputs.save_picture(figure, tmp_path / "real.png", simulated=False)
    assert not figure.texts
    with pytest.raises(ConfigurationError, match="exists"):
        outputs.save_picture(figure, tmp_path / "real.png", simulated=False)


@pytest.mark.skipif(os.name == "nt", reason="Windows sets no limit to the size of a file")
def test_a_full_disk_is_one_plain_sentence(tmp_path):
    import resource

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, before[1]))
    try:
        with pytest.raises(DataError, match=r"whole\.h5 cannot be written: File too large\.$"):
            write(tmp_path / "whole.h5", "drive", {"volts": np.ones(100_000)})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert list(tmp_path.iterdir()) == []


def test_the_reason_is_the_system_s_own():
    text = (
        "Can't write data (file write failed: errno = 28, error message = 'No space', buf = 0x7f, size = 8)"
    )
    assert os_error_text(OSError(28, text)) == os_error_text(RuntimeError(text)) == os.strerror(28)
    assert "buf" not in os_error_text(OSError("buf = 0x7f"))


SIGNALLED = """
import runpy, signal, sys
class Impatient:
    def find_spec(self, name, *_):
        if name == 'click': signal.raise_signal(signal.{name})
sys.meta_path.insert(0, Impatient())
sys.argv[1:] = ['schema']
runpy.run_module('haploop', run_name='__main__')
"""


@pytest.mark.skipif(os.name == "nt", reason="Windows delivers Ctrl-C to a console, not to a process")
@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
@pytest.mark.parametrize("ignored", [False, True])
def test_a_signal_while_loading_is_no_traceback_and_one_to_be_ignored_is(name, ignored):
    """Ignored as under `nohup`, or in a job in the background of a script."""
    number = getattr(signal, name)
    disposition = "SIG_IGN" if ignored else "default_int_handler" if name == "SIGINT" else "SIG_DFL"
    program = f"import signal; signal.signal({int(number)}, signal.{disposition})\n"
    done = subprocess.run(
        [sys.executable, "-c", program + SIGNALLED.format(name=name)],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    expected = (0, "") if ignored else (128 + number, "Error: Stopped.")
    assert (done.returncode, done.stderr.strip()) == expected


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
@pytest.mark.parametrize("ignored", [False, True])
def test_a_command_that_was_started_with_nohup_outlives_its_terminal(monkeypatch, run, ignored):
    monkeypatch.setattr("haploop.instruments.rig_schema", lambda: signal.raise_signal(signal.SIGHUP) or {})
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN if ignored else signal.SIG_DFL)
    try:
        run("schema", ends=0 if ignored else 129)
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.skipif(os.name == "nt", reason="streams of POSIX")
@pytest.mark.parametrize("closed", [(1,), (2,), (0, 1, 2)])
def test_closed_streams_are_no_error(closed):
    program = (
        "import os, runpy, sys\n"
        f"for number in {closed}: os.close(number)\n"
        f"for number in {closed}: setattr(sys, ('stdin', 'stdout', 'stderr')[number], None)\n"
        "sys.argv[1:] = ['schema']\n"
        "runpy.run_module('haploop', run_name='__main__')\n"
    )
    done = subprocess.run([sys.executable, "-c", program], stdout=subprocess.PIPE, timeout=60, check=False)
    assert done.returncode == 0
    assert bool(done.stdout) == (1 not in closed)


@pytest.mark.skipif(os.name == "nt", reason="pipes of POSIX")
def test_a_reader_that_leaves_changes_no_exit_code():
    with subprocess.Popen([sys.executable, "-m", "haploop", "schema"], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None and process.stdout.read(5)
        process.stdout.close()
        assert process.wait(60) == 0


def test_a_folder_without_calibrations_says_how_to_make_one(run, tmp_path):
    result = run("calibrations list --calibrations", tmp_path / "none", ends=0)
    assert "holds no calibration yet: make one with `haploop calibrations adopt`" in result.stdout
    assert not list(tmp_path.iterdir())


def test_a_matrix_of_one_row_is_a_sensor_of_one_axis(run, tmp_path):
    rig, gauges = tmp_path / "rig.toml", [f"gauge{number}" for number in range(6)]
    matrix = [[5.2, 0.0, 0.0, 0.0, 0.0, 0.0]]
    rig.write_text(f'base = "simulated"\n[sensors.force]\nchannels = {gauges}\nmatrix = {matrix}\n')
    run("record latch -p P01 -n 1 -o", tmp_path, "--rig", rig, ends=0)
