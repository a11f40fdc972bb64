"""Every kind of file that a command reads, changed: one sentence and an exit code, at no cost of memory.

The bytes, and the structure under a checksum that fits.
"""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result

from haploop.acquisition import Representative
from haploop.base import hdf5
from haploop.base.json_files import write_json
from haploop.calibration import Calibration, build_button
from haploop.instruments import open_rig
from tests.command_line import Demo, Run
from tests.mutating import mutations, restructure, within_memory


@pytest.fixture(scope="module")
def files(demo: Demo, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A file of each kind, by kind."""
    folder = tmp_path_factory.mktemp("whole")
    found = {
        "recording": demo.folder / "recordings" / "P01-push.h5",
        "representative": demo.folder / "presses" / "push.h5",
        "calibration": demo.folder / "calibration.h5",
        "drive": demo.folder / "drives" / "push.h5",
        "check": demo.folder / "checks" / "push.h5",
        "button": folder / "button.h5",
    }
    press, calibration = Representative.load(found["representative"]), Calibration.load(found["calibration"])
    with open_rig("simulated") as rig:
        build_button(rig, press, calibration, iterations=0).save(found["button"])
    return found


def used(run: Run, *arguments: object) -> int:
    """As `ended`. Returns the exit code."""
    return ended(run, *arguments).exit_code


def ended(run: Run, *arguments: object) -> Result:
    """Run a command: it ends by itself, in one sentence where it refuses."""
    with within_memory():
        result = run(*arguments)
    assert result.exit_code in (0, 1, 2, 3), (arguments, result.output[-500:])
    if result.exit_code > 1:
        # A status is shown also where it is bad.
        lines = 0 if result.stdout.startswith("{") else result.output.count("\n")
        assert lines <= 12 and len(result.stderr) < 2000, result.output
    return result


@pytest.mark.long
@pytest.mark.timeout(3600)
def test_a_command_survives_any_bytes_and_any_structure(kind, files, run, tmp_path, full):
    """What becomes of each change is looked at in the tests of each kind; here the commands'."""
    path, codes = tmp_path / "P01-push.h5", []
    raw = files[kind].read_bytes()
    for number, changed in enumerate(mutations(raw, 500 if full else 10, seed=11)):
        path.write_bytes(changed)
        codes.append(used(run, "show", path, "--json"))
        verified = used(run, "verify", path, "--json")
        assert verified >= 1 or changed == raw
        if kind == "recording" and number % 20 == 0:
            used(run, "recover", path)
            (tmp_path / "P01-push.recovered.h5").unlink(missing_ok=True)
    assert codes.count(2) > len(codes) // 2
    for seed in range(500 if full else 10):
        shutil.copyfile(files[kind], path)
        restructure(path, seed, kind)
        used(run, "show", path, "--json")
        used(run, "verify", path, "--json")


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Every kind with --full, else a recording and a digital button, which holds most other kinds."""
    if metafunc.function is test_a_command_survives_any_bytes_and_any_structure:
        stored = ("representative", "calibration", "drive", "check") * metafunc.config.getoption("--full")
        metafunc.parametrize("kind", ("recording", "button", *stored))


NONSENSE = {
    "representative": {"rate_hz": 1e300, "acceleration": np.full(4, np.nan), "activation_index": 10**9},
    "calibration": {
        "model/poles": np.zeros(3, complex),
        "response/frequencies": np.zeros(5),
        "response/coherence": np.full(5, np.nan),
    },
    "drive": {"volts": np.zeros(0), "rate_hz": -1.0},
    "check": {"verdict": "perhaps", "rate_hz": 1e300, "octaves/floor_db": np.full(3, np.nan)},
}


@pytest.mark.parametrize("kind", NONSENSE)
def test_content_that_nobody_measured_is_refused_under_a_hash_that_fits(kind, files, run, tmp_path):
    flat = hdf5.read(files[kind], kind)
    for number, (key, value) in enumerate(NONSENSE[kind].items()):
        assert key in flat
        path = tmp_path / f"{number}.h5"
        hdf5.write(path, kind, {**flat, key: value})
        assert used(run, "show", path, "--json") == 2


@pytest.mark.long
def test_a_response_without_coherence_is_shown_and_reported(files, run, tmp_path):
    """As another program may have measured it."""
    found = Calibration.load(files["calibration"])
    path = tmp_path / "other.h5"
    bare = replace(found.response, coherence=np.zeros(0), deviation=np.zeros(0))
    replace(found, response=bare).save(path)
    assert run.json("show", path)["confidence"] is None
    shown = run("show", path, "--plot", tmp_path / "other.png")
    assert shown.exit_code == 0 and "not measured" in shown.stdout, shown.output
    run("report", path, "--out", tmp_path / "report.html", ends=0)
    assert "coherence not measured" in (tmp_path / "report.html").read_text("utf-8")


OTHERS = ([], {}, [1], [[]], {"a": None}, "a", None, 1e308, [None] * 1000)


@pytest.mark.parametrize(
    ("kind", "own"), [("map", {"rig": "rig"}), ("rejections", [{"file": "P01-push.h5"}])]
)
def test_a_list_or_plan_of_another_content_is_refused(kind, own, files, run, tmp_path):
    path = tmp_path / f"{kind}.json"
    shutil.copyfile(files["recording"], tmp_path / files["recording"].name)
    for changed in (own, *OTHERS):
        path.unlink(missing_ok=True)
        write_json(path, kind, changed)
        used(run, "verify", path)
        used(run, "show", tmp_path, "--json")
        used(run, "show", tmp_path / files["recording"].name, "--json")
        used(run, "list", "--in", tmp_path, "--json")
