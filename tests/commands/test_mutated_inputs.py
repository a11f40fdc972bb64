"""Every further kind of file that a command reads, changed: other programs', and folders of haploop's."""

import json
import shutil
from collections.abc import Callable
from importlib import resources
from pathlib import Path

import pytest

from haploop.acquisition import load_press
from haploop.calibration import Waveforms
from tests.command_line import Demo, Run
from tests.exchange.test_mutated_files import ended
from tests.mutating import mutations

Command = tuple[object, ...]
Made = tuple[Path, list[Command]]
"""The file to change, and the commands that read it; the first one's exit code counts."""


def signals(form: str, suffix: str) -> Callable[[Demo, Run, Path], Made]:
    def make(demo: Demo, run: Run, folder: Path) -> Made:
        path = folder / f"press{suffix}"
        run("export", demo.folder / "presses" / "push.h5", "--to", form, "--out", path, ends=0)
        return path, [("import", path, "--channel", "acceleration", "--out", folder / "out.h5", "--json")]

    return make


def sep005(demo: Demo, _run: Run, folder: Path) -> Made:
    press, path = load_press(demo.folder / "presses" / "push.h5"), folder / "press.json"
    one = {"name": "acceleration", "unit_str": "m/s^2", "fs": press.rate_hz}
    path.write_text(json.dumps([one | {"data": press.acceleration.tolist()}]), encoding="utf-8")
    return path, [("import", path, "--button", "push", "--out", folder / "out.h5", "--json")]


def beside(demo: Demo, run: Run, folder: Path) -> Made:
    path, commands = signals("wav", ".wav")(demo, run, folder)
    return path.with_name(f"{path.name}.json"), commands


def responses(demo: Demo, run: Run, folder: Path) -> Made:
    path = folder / "response.uff"
    run("export", demo.folder / "calibration.h5", "--to", "uff", "--out", path, ends=0)
    return path, [("import", path, "--out", folder / "out.h5", "--json")]


def waveforms(demo: Demo, _run: Run, folder: Path) -> Made:
    path = Path(shutil.copy(Waveforms.beside(demo.folder / "calibration.h5"), folder))
    return path, [("verify", path, "--json"), ("show", path, "--json")]


def mapped(what: str) -> Callable[[Demo, Run, Path], Made]:
    def make(_demo: Demo, run: Run, folder: Path) -> Made:
        out = folder / "map"
        run("map --out", out, "--points", "3", "--patches", "A", ends=0)
        path = next(iter(sorted(out.glob(what))))
        again = ("map", "--out", out, "--points", "3", "--patches", "A", "--json")
        return path, [("show", out, "--json"), ("verify", path), ("list", "--in", out), again]

    return make


def history(what: str) -> Callable[[Demo, Run, Path], Made]:
    def make(demo: Demo, run: Run, folder: Path) -> Made:
        of, button = ("--calibrations", folder / "calibrations"), folder / "push.h5"
        press, calibration = demo.folder / "presses" / "push.h5", demo.folder / "calibration.h5"
        ready = [
            run("button make", press, "-c", calibration, "-o", button, "--iterations", "5"),
            run("calibrations adopt", button, *of, "--reason", "a test"),
        ]
        assert all(result.exit_code == 0 for result in ready), [result.output for result in ready]
        path = next(iter(sorted((folder / "calibrations").rglob(what))))
        return path, [
            ("calibrations", "show", "1", *of, "--json"),
            ("calibrations", "list", *of, "--json"),
            ("verify", path),
        ]

    return make


def rig(_demo: Demo, _run: Run, folder: Path) -> Made:
    path = folder / "rig.toml"
    path.write_bytes((resources.files("haploop.rigs") / "simulated.toml").read_bytes())
    return path, [("log", "--rig", path, "--json")]


def experiment(_demo: Demo, run: Run, folder: Path) -> Made:
    run("experiment new", folder / "rating", "--from", "rating", ends=0)
    path = folder / "rating" / "experiment.toml"
    return path, [("experiment", "status", path, "-d", folder / "answers", "--json")]


def withdrawals(_demo: Demo, run: Run, folder: Path) -> Made:
    data = folder / "answers"
    run("experiment simulate rating -n 2 -d", data, ends=0)
    run("experiment withdraw rating P01 -d", data, "--yes", ends=0)
    path = data / "withdrawals.jsonl"
    return path, [("experiment", "status", "rating", "-d", data, "--json"), ("verify", path)]


def answers(_demo: Demo, run: Run, folder: Path) -> Made:
    data, path = folder / "answers", folder / "answers.csv"
    run("experiment simulate matching -n 1 -d", data, ends=0)
    run("experiment export matching", path, "-d", data, ends=0)
    return path, [("analyse", "confusion", path, "--json")]


def part_of_a_study(_demo: Demo, run: Run, folder: Path) -> Made:
    study = folder / "study"
    study.mkdir()
    text = 'name = "demo"\nrig = "simulated"\nbuttons = ["push"]\nparticipants = ["P01"]\npresses = 2\n'
    (study / "study.toml").write_text(text, encoding="utf-8")
    run("study run --study", study, "-p", "P01", ends=0)
    out = folder / "processed"
    process = ("study", "process", "--study", study, "--out", out, "--workers", "1", "--json")
    run(*process, ends=0)
    return next((out / "parts").glob("*.json")), [process]


def index(demo: Demo, run: Run, folder: Path) -> Made:
    listed = ("list", "--in", demo.folder, "--json")
    run(*listed, ends=0)
    return next((folder / "cache").rglob("catalogue-*.sqlite3")), [listed]


KINDS: dict[str, Callable[[Demo, Run, Path], Made]] = {
    "wav": signals("wav", ".wav"), "csv": signals("csv", ".csv"), "mat": signals("mat", ".mat"),
    "uff": signals("uff", ".uff"), "sep005": sep005, "sidecar": beside, "responses": responses,
    "waveforms": waveforms, "plan": mapped("map.json"), "point": mapped("point*.h5"),
    "modes": mapped("modes*.h5"), "activations": history("activations.json"),
    "generation": history("generation.json"), "generation's button": history("*.h5"), "rig": rig,
    "experiment": experiment, "withdrawals": withdrawals, "answers": answers, "part": part_of_a_study,
    "index": index,
}  # fmt: skip
NEVER_REFUSED = {"index", "part"}
"""Made again where they are damaged."""
SLOW = {"mat", "plan", "point", "modes", "activations", "generation", "generation's button", "part"}
"""Their commands measure or compute, or start a process."""


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.timeout(7200)
def test_a_command_survives_what_it_reads(kind, demo, run, full, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    if kind in SLOW and not full:
        pytest.skip("only with --full")
    path, commands = KINDS[kind](demo, run, tmp_path)
    raw, refused, whole = path.read_bytes(), 0, run(*commands[0]).stdout
    (tmp_path / "out.h5").unlink(missing_ok=True)
    for changed in mutations(raw, 500 if full else 10, seed=13):
        path.write_bytes(changed)
        first, *_ = [ended(run, *command) for command in commands]
        (tmp_path / "out.h5").unlink(missing_ok=True)
        refused += first.exit_code == 2
        assert kind not in NEVER_REFUSED or first.exit_code in (0, 1)
        assert kind != "index" or first.stdout == whole
    assert refused > 0 or kind in NEVER_REFUSED
