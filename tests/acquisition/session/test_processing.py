"""Processing a study: the same bytes, whoever computes them, and whoever is killed meanwhile."""

import csv
import multiprocessing
import os
import shutil
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import haploop
from haploop.acquisition import content_hash, process_study
from haploop.acquisition.session import processing
from tests import forked

STUDY = """
name = "pilot"
buttons = ["latch", "push"]
participants = ["P01", "P02", "P03"]
presses = 2
method = "barycentre"
"""


@pytest.fixture(scope="module", autouse=True)
def _workers() -> None:
    """The product's workers are forked from the server that all tests of this process have."""
    forked.context()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("study")
    (path / "study.toml").write_text(STUDY, encoding="utf-8")
    with haploop.open_rig("simulated") as rig:
        haploop.run_study(rig, haploop.load_study(path))
    return path


@pytest.fixture(scope="module")
def alone(folder: Path) -> dict[str, bytes]:
    """What one process writes."""
    process_study(haploop.load_study(folder), folder / "alone", workers=1)
    return content(folder / "alone")


def content(path: Path) -> dict[str, bytes]:
    return {str(p.relative_to(path)): p.read_bytes() for p in path.rglob("*") if p.is_file()}


def once(act: Callable[[], None]) -> haploop.base.progress.Progress:
    """Progress that acts after the first part."""

    def progress(step: str, done: int, of: int, unit: str) -> None:
        if done == 1:
            act()

    return progress


@pytest.mark.long
def test_what_is_written(folder, alone):
    pairs = [f"{who}-{button}" for who in ("P01", "P02", "P03") for button in ("latch", "push")]
    parts = [f"parts/{pair}{end}" for pair in pairs for end in (".json", "-press.h5")]
    assert set(alone) == {
        *("presses.csv", "statistics.csv", "latch.h5", "push.h5"),
        *("parts/latch.whole.json", "parts/push.whole.json"),
        *parts,
    }
    study = haploop.load_study(folder)
    haploop.export_file(folder, "csv", folder / "exported.csv")
    assert alone["presses.csv"] == (folder / "exported.csv").read_bytes()
    assert content_hash(folder / "alone" / "latch.h5") == _hash(study.representative("latch"), folder)
    with (folder / "alone" / "statistics.csv").open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["measure"] == "force_at_activation_n"]
    (whole,) = (row for row in rows if (row["participant"], row["button"]) == ("", "latch"))
    means = []
    for who in study.file.participants:
        recording = haploop.Recording.open(folder / "recordings" / f"{who}-latch.h5")
        means.append(np.mean([press.force_at_activation for press in haploop.accepted_presses(recording)]))
    assert whole["count"] == "3"
    assert float(whole["mean"]) == pytest.approx(np.mean(means), rel=1e-8)
    assert float(whole["deviation"]) == pytest.approx(np.std(means, ddof=1), rel=1e-8)


def _hash(press: haploop.Representative, folder: Path) -> str:
    path = folder / "own.h5"
    press.save(path)
    return content_hash(path)


@pytest.mark.long
def test_a_killed_process_costs_time_only(folder, alone, tmp_path):
    killed = []

    def kill():
        child = multiprocessing.active_children()[0]
        killed.append(child.pid)
        child.kill()

    found = process_study(haploop.load_study(folder), tmp_path, workers=2, progress=once(kill))
    assert killed and (found.computed, found.parts, found.presses) == (8, 8, 12)
    assert content(tmp_path) == alone


@pytest.mark.long
def test_two_runs_do_not_write_into_one_folder(folder, alone, tmp_path, run):
    second = []

    def start_another():
        second.append(run("study process --study", folder, "--out", tmp_path, "--workers", 1))

    process_study(haploop.load_study(folder), tmp_path, workers=1, progress=once(start_another))
    assert second[0].exit_code == 3
    assert second[0].stderr.count("presses.csv is being written by another program: wait") == 1
    assert content(tmp_path) == alone


@pytest.mark.long
def test_what_is_done_is_not_done_again_and_what_was_changed_or_is_gone_is(folder, alone, tmp_path):
    study, parts = haploop.load_study(folder), tmp_path / "parts"

    def stop():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        process_study(study, tmp_path, workers=1, progress=once(stop))
    assert process_study(study, tmp_path, workers=1).computed == 7
    (parts / "P02-push.json").write_bytes(alone["parts/P02-push.json"][:100])
    assert process_study(study, tmp_path, workers=1).computed == 1
    rows, press = parts / "P02-push.json", parts / "P03-latch-press.h5"
    assert haploop.verify(rows) == ()
    rows.write_bytes(rows.read_bytes().replace(b'"peak_force_n": ', b'"peak_force_n": 1'))
    (tmp_path / "push.h5").unlink()
    press.write_bytes(press.read_bytes()[:-100] + bytes(100))
    assert process_study(study, tmp_path, workers=1).computed == 3
    assert content(tmp_path) == alone


@pytest.mark.long
def test_a_rejection_is_a_change(folder, tmp_path):
    copy = tmp_path / "study"
    (copy / "recordings").mkdir(parents=True)
    (copy / "study.toml").write_bytes((folder / "study.toml").read_bytes())
    for path in (folder / "recordings").glob("P0*.h5"):
        (copy / "recordings" / path.name).write_bytes(path.read_bytes())
    study = haploop.load_study(copy)
    process_study(study, tmp_path / "out", workers=1)
    study.reject("P01", "latch")
    assert process_study(study, tmp_path / "out", workers=1).computed == 8
    with (tmp_path / "out" / "presses.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["flags"] for row in rows[:2]] == ["rejected", "rejected"]
    assert not (tmp_path / "out" / "parts" / "P01-latch-press.h5").exists()


def test_workers_that_are_always_killed_end_it(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(processing, "_work", suicide)
    with pytest.raises(haploop.InstrumentError, match="enough memory"):
        process_study(haploop.load_study(folder), tmp_path, workers=2)


def suicide(*args: object) -> None:
    os.kill(os.getpid(), signal.SIGTERM)


@pytest.fixture
def cluster(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[object]:
    distributed = pytest.importorskip("distributed", reason="python -m pip install -e '.[dask]'")
    with distributed.LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        host="127.0.0.1",
        dashboard_address=None,
        local_directory=str(tmp_path / "dask"),
    ) as cluster:
        yield cluster


@pytest.mark.filterwarnings("default")
def test_a_dask_cluster_writes_the_same_bytes_when_a_worker_is_killed(folder, alone, tmp_path, cluster, run):
    killed = []

    def kill():
        worker = cluster.workers[0]
        killed.append(worker.pid)
        os.kill(worker.pid, signal.SIGKILL)

    address = cluster.scheduler_address
    study = haploop.load_study(folder)
    found = process_study(study, tmp_path / "out", dask=address, progress=once(kill))
    assert killed and found.computed == 8
    assert content(tmp_path / "out") == alone
    result = run("study process --study", folder, "--out", tmp_path / "out", "--dask", address)
    assert result.exit_code == 0 and "0 of 8 parts" in result.stdout


@pytest.mark.filterwarnings("default")
def test_a_cluster_that_loses_every_worker_ends_it(folder, tmp_path, cluster, monkeypatch):
    cluster.scheduler.allowed_failures = 0
    # By value: the workers have no module of tests.
    monkeypatch.setattr(processing, "_work", lambda *_: os.kill(os.getpid(), signal.SIGKILL))
    with pytest.raises(haploop.InstrumentError, match=r"lost its work \(KilledWorker\).*same command again"):
        process_study(haploop.load_study(folder), tmp_path / "out", dask=cluster.scheduler_address)


@pytest.mark.filterwarnings("default")
def test_no_scheduler_is_an_error_of_one_sentence(folder, tmp_path, monkeypatch):
    pytest.importorskip("distributed", reason="python -m pip install -e '.[dask]'")
    monkeypatch.setattr(processing, "_CONNECT", 0.5)
    for address in ("tcp://127.0.0.1:9", "nonsense://x"):
        with pytest.raises(haploop.InstrumentError, match="No Dask scheduler answers"):
            process_study(haploop.load_study(folder), tmp_path / "out", dask=address)


def test_a_study_without_recordings_is_refused(tmp_path, run):
    (tmp_path / "study.toml").write_text(STUDY, encoding="utf-8")
    run("study process --study", tmp_path, "--out", tmp_path / "out", says="has no recording yet")


@pytest.mark.parametrize("workers", [1, 2])
def test_a_recording_of_another_study_is_refused(folder, tmp_path, workers):
    (tmp_path / "recordings").mkdir()
    (tmp_path / "study.toml").write_text(STUDY, encoding="utf-8")
    for name, source in (("P01-latch.h5", "P01-latch.h5"), ("P02-push.h5", "P01-push.h5")):
        (tmp_path / "recordings" / name).write_bytes((folder / "recordings" / source).read_bytes())
    with pytest.raises(haploop.DataError, match=r"P02-push.h5 belongs to .*participant P01"):
        process_study(haploop.load_study(tmp_path), tmp_path / "out", workers=workers)


@pytest.mark.parametrize(
    ("names", "study", "refused"),
    [
        (["latch.h5"], STUDY, "latch.h5"),
        (["presses.csv", "parts/notes.txt"], STUDY, "presses.csv"),
        (["parts/push.whole.json", "latch.h5"], STUDY, "latch.h5"),
        (["parts/latch.whole.json", "presses.csv"], STUDY.replace("pilot", "main"), "presses.csv"),
    ],
    ids=["a button", "a table beside a folder of parts", "a button of a later run", "another study's"],
)
def test_files_of_others_are_not_replaced(folder, alone, tmp_path, names, study, refused):
    copy, out = tmp_path / "study", tmp_path / "out"
    shutil.copytree(folder / "recordings", copy / "recordings")
    (copy / "study.toml").write_text(study, encoding="utf-8")
    for name in names:
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        (out / name).write_bytes(alone.get(name, b"notes"))
    before = content(out)
    with pytest.raises(haploop.ConfigurationError, match=f"{refused} already exists"):
        process_study(haploop.load_study(copy), out, workers=1)
    assert content(out) == before
