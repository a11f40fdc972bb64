"""Recordings with bytes or structure changed: refused in one sentence, or no more than was recorded."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from haploop.acquisition import Recording, verify
from haploop.acquisition.recording.recovery import recover_damaged
from haploop.acquisition.recording.salvage import finish
from haploop.base.errors import HaploopError
from tests.acquisition.recording.pattern import unfinished
from tests.mutating import mutations, refused, restructure


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("mutated")
    paths = {
        "unfinished": unfinished(folder / "P01-push.h5"),
        "finished": unfinished(folder / "P02-push.h5", 40 // 4),
    }
    finish(paths["finished"])
    return paths


def content(path: Path) -> dict[str, Any]:
    recording = Recording.open(path)
    header = {
        key: value.tolist() if isinstance(value, np.ndarray) else value
        for key, value in dataclasses.asdict(recording.header).items()
    }
    own = {name: getattr(recording, name) for name in ("events", "verdicts", "force", "complete")}
    blocks = recording.blocks[["first", "count", "overload", "time"]].tolist()
    codes = recording._contents.codes[:]
    return own | {"header": header, "codes": codes, "blocks": blocks, "problems": verify(path)}


def part_of(found: dict[str, Any], whole: dict[str, Any]) -> bool:
    """Whether nothing is there that was not recorded."""
    samples = found["codes"].shape[1]
    return (
        found["header"] == whole["header"]
        and np.array_equal(found["codes"], whole["codes"][:, :samples])
        and found["blocks"] == whole["blocks"][: len(found["blocks"])]
        and all(event in whole["events"] for event in found["events"] if event.kind != "recovered")
        and all(verdict in whole["verdicts"] for verdict in found["verdicts"])
    )


def same(found: dict[str, Any], whole: dict[str, Any]) -> bool:
    return (
        part_of(found, whole)
        and all(len(found[key]) == len(whole[key]) for key in ("events", "verdicts"))
        and (found["codes"].shape == whole["codes"].shape and found["complete"] == whole["complete"])
    )


@pytest.mark.parametrize("state", ["finished", "unfinished"])
@pytest.mark.timeout(3600)
def test_a_changed_recording(files, state, tmp_path, full):
    raw, whole = files[state].read_bytes(), content(files[state])
    path, number = tmp_path / "P09-push.h5", 0
    for changed in mutations(raw, 500 if full else 60, seed=1):
        path.write_bytes(changed)
        found: dict[str, Any] = {}
        if refused(lambda found=found: found.update(content(path))):
            number += changed != raw
        elif state == "finished":
            assert same(found, whole)
        else:
            assert part_of(found, whole) and found["problems"] and not found["complete"]
    assert number > (400 if full and state == "finished" else 20)


@pytest.mark.parametrize("state", ["finished", "unfinished"])
@pytest.mark.timeout(3600)
def test_another_structure(files, state, tmp_path, full):
    """Also with a checksum that fits: what another program writes is no reason to fail."""
    raw, whole = files[state].read_bytes(), content(files[state])
    path = tmp_path / "P09-push.h5"
    for seed in range(500 if full else 40):
        path.write_bytes(raw)
        restructure(path, seed, "recording")
        found: dict[str, Any] = {}
        if not refused(lambda found=found: found.update(content(path))):
            assert part_of(found, whole) if state == "unfinished" else same(found, whole), seed


@pytest.mark.timeout(3600)
def test_what_is_recovered_was_recorded(files, tmp_path, full):
    """Within this process, as far as the HDF5 library survives it; `recover` uses a process of its own."""
    raw, whole = files["finished"].read_bytes(), content(files["finished"])
    path, recovered, saved = tmp_path / "P09-push.h5", tmp_path / "P09-push.recovered.h5", 0
    start = len(raw) // 2
    for changed in mutations(raw[start:], 250 if full else 20, seed=3):
        path.write_bytes(raw[:start] + changed)
        recovered.unlink(missing_ok=True)
        try:
            recover_damaged(path, recovered)
        except HaploopError:
            continue
        found = content(recovered)
        assert part_of(found, whole) and found["problems"] == () and not found["complete"]
        saved += found["codes"].shape[1] > 0
    assert saved > 2
