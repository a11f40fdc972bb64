"""`haploop verify` and `haploop recover`: one line a file, and an exit code that a script can use."""

import json
import os
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from haploop.acquisition.recording import Rejection, add_rejections
from haploop.acquisition.recording.salvage import finish
from haploop.acquisition.recording.writer import Writer
from tests.acquisition.recording.pattern import block_of, header


@pytest.fixture
def files(tmp_path: Path) -> dict[str, Path]:
    """An intact recording, and recordings that were interrupted, changed and truncated."""
    names = {"whole": "P01-push", "interrupted": "P02-push", "changed": "P03-push", "cut": "P04-push"}
    paths = {name: tmp_path / f"{stem}.h5" for name, stem in names.items()}
    for path in paths.values():
        with Writer(path, header(), 250, 200) as writer:
            for i in range(100):
                writer.write(block_of(250 * i), 0.0)
    for name in ("whole", "changed", "cut"):
        finish(paths[name])
    with h5py.File(paths["changed"], "r+") as file:
        file["codes"][0, 0] += 1
    paths["cut"].write_bytes(paths["cut"].read_bytes()[:-1])
    return paths


def test_each_file_is_one_line_and_the_worst_gives_the_exit_code(run, files):
    for name, code, told in (
        ("whole", 0, "is intact: SHA-256 "),
        ("interrupted", 1, "was interrupted: `haploop recover` salvages it into a finished file."),
        ("changed", 2, "was damaged or changed after it was written: "),
        ("cut", 2, "is truncated: "),
    ):
        result = run("verify", files[name])
        assert (result.exit_code, result.stdout.count("\n")) == (code, 1)
        assert result.stdout.startswith(f"{files[name]} {told}")
    result = run("verify", *files.values(), "nowhere.h5")
    assert (result.exit_code, result.stdout.count("\n")) == (2, 5)
    assert "There is no file nowhere.h5: " in result.stdout


def test_what_verify_found_is_one_json_object(run, files):
    told = run.json("verify", *files.values(), ends=2)["files"]
    assert [file["status"] for file in told] == ["intact", "damaged", "unreadable", "unreadable"]
    assert [len(file["problems"]) for file in told] == [0, 1, 1, 1]
    assert len(told[0]["content_hash"]) == 64


def test_every_file_in_a_folder_is_verified(run, files, tmp_path):
    study = tmp_path / "study"
    (study / "recordings").mkdir(parents=True)
    good = Path(shutil.copy(next(iter(files.values())), study / "recordings" / "P01-push.h5"))
    shutil.copy(good, study / "recordings" / ".P01-push.h5.part.h5")
    (study / "z.h5").write_bytes(b"")
    told = run.json("verify", study, ends=2)["files"]
    assert [(file["file"], file["status"]) for file in told] == [
        (str(good), "intact"),
        (str(study / "z.h5"), "unreadable"),
    ]
    (tmp_path / "empty").mkdir()
    run("verify", tmp_path / "empty", says="holds no .h5 file")


@pytest.mark.long
def test_recovering_tells_what_was_saved_and_leaves_the_file_alone(run, files):
    for name, saved in (("interrupted", "Recovered 5.00 s"), ("cut", "Recovered ")):
        before = files[name].read_bytes()
        result = run("recover", files[name], "--json", ends=0, says=saved)
        assert json.loads(result.stdout)["ended"] in result.stderr
        assert files[name].read_bytes() == before
        whole = files[name].with_name(f"{files[name].stem}.recovered.h5")
        run("verify", whole, ends=0)
        again = run("recover", files[name])
        assert (again.exit_code, again.stdout) == (2, "")
        assert "not overwritten" in again.stderr
    assert np.all([run("recover", files[name]).exit_code == 2 for name in ("whole", "changed")])


def test_every_kind_of_file_is_verified(run, tmp_path):
    add_rejections(tmp_path, [Rejection("P01-push.h5", "0" * 64, 1, 1, "why", "now")])
    path = tmp_path / "rejections.json"
    assert f"{path} is intact: SHA-256 " in run("verify", path).stdout
    path.write_bytes(path.read_bytes().replace(b"why", b"who"))
    result = run("verify", path)
    assert (result.exit_code, result.stdout) == (
        2,
        f"{path} is damaged or was changed by hand: restore it from a copy.\n",
    )


def test_a_recovery_whose_process_dies_is_one_sentence(run, files, tmp_path, monkeypatch):
    """The HDF5 library (1.14) crashes on some files with damaged metadata; here it just dies."""
    raw = bytearray(files["whole"].read_bytes())
    raw[-100] ^= 1
    files["whole"].write_bytes(raw)
    dies = "import os; import h5py; h5py.File = lambda *a, **b: os.abort()\n"
    (tmp_path / "sitecustomize.py").write_text(dies, encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    result = run("recover", files["whole"])
    assert (result.exit_code, result.stdout) == (2, "")
    assert "so nothing can be recovered: copy it again from its source." in result.stderr


@pytest.mark.long
@pytest.mark.skipif(os.name == "nt", reason="Windows gives a file the rights of its folder")
def test_what_is_made_of_peoples_recordings_is_for_its_owner_only(demo, run, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    out = tmp_path / "out"
    recordings = demo.folder / "recordings"
    pressed = recordings / "P01-push.h5"
    ready = [
        run("export", pressed, "--to", "csv", "--out", out / "press.csv"),
        run("report", pressed, "--out", out / "report.html"),
        run("represent", pressed, "--out", out / "press.h5", "--average", "mean"),
        run("export", out / "press.h5", "--to", "ahap", "--out", out / "press.ahap"),
        run("show", pressed, "--plot", out / "presses.png"),
        run("show", recordings, "--plot", out / "forces.svg"),
        run("list --in", recordings),
    ]
    assert [result.exit_code for result in ready] == [0] * len(ready), ready
    made = [path for folder in (out, tmp_path / "cache" / "haploop") for path in folder.rglob("*")]
    assert len(made) > 5
    for path in (out, *made):
        assert path.stat().st_mode & 0o077 == 0, path
