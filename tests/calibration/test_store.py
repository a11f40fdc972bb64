"""Every kind of file of the store: what comes back is what was written, or the file is refused."""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from haploop.acquisition import Representative, content_hash, verify
from haploop.base import hdf5
from haploop.base.checksum import add_checksum
from haploop.base.errors import DataError
from haploop.calibration import Calibration, Check, DigitalButton, Drive, Learning, build_button
from haploop.calibration.map.folder import PointMeasurement
from tests.calibration.conftest import Calibrated, make_press
from tests.mutating import mutations, refused, restructure
from tests.raising import raises
from tests.rows import thinned

KINDS = {
    "representative": Representative, "calibration": Calibration, "drive": Drive, "learning": Learning,
    "check": Check, "button": DigitalButton, "map point": PointMeasurement,
}  # fmt: skip


@pytest.fixture(scope="module")
def values(calibrated: Calibrated) -> dict[str, Any]:
    told = {"scores": {"mean": 0.5}, "parameters": {"window": {"before": 0.15}}, "undone_hz": (20.0, 400.0)}
    press = dataclasses.replace(make_press(), left_out=("P01, press 3: why",), **told)
    button = build_button(calibrated.rig, press, calibrated.calibration, iterations=0, plays=3)
    spectrum = np.exp(1j * np.arange(40.0)).reshape(2, 20)
    point = PointMeasurement(
        "0" * 64, "point-3", "3", ("A", "all"), ((0, "A"), (1, "A")), spectrum, spectrum, 0.5, 2.05, "now"
    )
    parts = {name: getattr(button, name) for name in ("drive", "learning", "check")}
    others = {"calibration": calibrated.calibration, "button": button, "map point": point}
    return {"representative": press} | parts | others


@pytest.fixture(scope="module")
def saved(values: dict[str, Any], tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    folder = tmp_path_factory.mktemp("store")

    def path(kind: str) -> Path:
        file = folder / f"{kind}.h5"
        if not file.exists():
            hdf5.write(file, kind, hdf5.flatten(values[kind]))
        return file

    return path


def load(kind: str, path: Path) -> hdf5.Flat:
    """The content as it is after it was made a value again."""
    return hdf5.flatten(hdf5.restore(KINDS[kind], hdf5.read(path, kind), path))


def same(one: hdf5.Flat, other: hdf5.Flat) -> bool:
    def equal(mine: Any, theirs: Any) -> bool:
        if isinstance(mine, np.ndarray) and isinstance(theirs, np.ndarray):
            return (mine.dtype, mine.shape, mine.tobytes()) == (theirs.dtype, theirs.shape, theirs.tobytes())
        return type(mine) is type(theirs) and repr(mine) == repr(theirs)

    return one.keys() == other.keys() and all(equal(value, other[name]) for name, value in one.items())


@pytest.mark.parametrize("kind", KINDS)
def test_what_comes_back_was_written(kind, values, saved):
    path = saved(kind)
    assert same(load(kind, path), hdf5.flatten(values[kind]))
    assert hdf5.kind_of(path) == kind and verify(path) == ()
    assert content_hash(path) == hdf5.digest(hdf5.flatten(values[kind]))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.timeout(3600)
def test_a_changed_byte(kind, saved, tmp_path, full):
    raw, before = saved(kind).read_bytes(), load(kind, saved(kind))
    path, number = tmp_path / "changed.h5", 0
    for changed in mutations(raw, 500 if full else 100, seed=len(kind)):
        path.write_bytes(changed)
        found: list[hdf5.Flat] = []
        if refused(lambda found=found: found.append(load(kind, path))):
            number += 1
            raises(DataError, "", verify, path)
        else:
            assert same(found[0], before)
    assert number > (400 if full else 80)


@pytest.mark.parametrize("kind", thinned(KINDS, 3))
@pytest.mark.timeout(3600)
def test_another_structure(kind, saved, tmp_path, full):
    raw, before = saved(kind).read_bytes(), load(kind, saved(kind))
    path = tmp_path / "changed.h5"
    for seed in range(500 if full else 20):
        path.write_bytes(raw)
        restructure(path, seed, kind)
        found: list[hdf5.Flat] = []
        if not refused(lambda found=found: found.append(load(kind, path))):
            assert same(found[0], before), seed


@pytest.mark.parametrize("seed", thinned(range(3), 3))
def test_another_programs_file_is_no_crash(seed, values, tmp_path):
    """A field gone, or of another type: also where all hashes are right."""
    random = np.random.default_rng(seed)
    for kind, value in values.items():
        flat = hdf5.flatten(value)
        for number in range(4):
            name = sorted(flat)[int(random.integers(len(flat)))]
            changed = {key: content for key, content in flat.items() if key != name}
            if number:
                changed[name] = (np.zeros((2, 2, 2), "i8"), "no JSON", 1.5)[number - 1]
            path = tmp_path / f"{kind}-{number}.h5"
            hdf5.write(path, kind, changed)
            refused(lambda kind=kind, path=path: load(kind, path))


@pytest.mark.parametrize(("change", "told"), [
    ({"volts": np.array([[0.0, np.nan]])}, "not a signal for each patch"),
    ({"volts": np.array([[0.0, 1e9]])}, "reaches 1e.09 V, and no amplifier of a patch 1000 V"),
    ({"target": np.zeros(3)}, "not a signal for each patch"),
    ({"volts": np.zeros((2, 2))}, "not a signal for each patch"),
    ({"volts": np.zeros(2)}, "not a signal for each patch"),
    ({"rate_hz": np.inf}, "has inf samples/s"),
])  # fmt: skip
def test_a_drive_without_sense_is_refused_before_anybody_plots_or_plays_it(change, told, values, tmp_path):
    flat = hdf5.flatten(values["drive"]) | {"volts": np.zeros((1, 2)), "target": np.zeros(2)} | change
    path = tmp_path / "drive.h5"
    hdf5.write(path, "drive", flat)
    assert verify(path) == ()
    raises(DataError, rf"drive\.h5 cannot be used: the drive.* {told}", Drive.load, path)


def test_a_changed_type_order_or_shape_is_another_content():
    numbers = np.arange(6, dtype="<i8")
    one = hdf5.digest({"a": numbers})
    for other in (numbers.view("<u8"), numbers.view(">i8"), numbers.view("<f8"), numbers.reshape(2, 3)):
        assert other.tobytes() == numbers.tobytes()
        assert hdf5.digest({"a": other}) != one
    assert len({hdf5.digest({"a": value}) for value in (1, 1.0, True, "1", "True")}) == 5
    assert hdf5.digest({"a": "b", "c": "d"}) != hdf5.digest({"a": "b\0c", "": "d"})


def test_a_flipped_type_bit_in_a_file_is_seen(saved, tmp_path):
    path = tmp_path / "press.h5"
    path.write_bytes(saved("representative").read_bytes())
    with h5py.File(path, "r+") as file:
        force = file["force"][()]
        assert not force.any()  # zeros have the same bytes as any type
        del file["force"]
        file["force"] = force.astype("<i8")
    raises(DataError, "does not match its checksum", Representative.load, path)
    add_checksum(path, "representative")
    for read in (Representative.load, verify):
        raises(DataError, "does not match its hash", read, path)
