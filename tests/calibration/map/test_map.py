from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from haploop.base.errors import ConfigurationError, DataError
from haploop.base.hdf5 import digest, flatten
from haploop.calibration.map.folder import MapFolder
from haploop.calibration.map.map import BAND, VibrationMap
from haploop.calibration.map.measuring import map_plan, measure_map
from haploop.instruments import Rig
from haploop.mocks.plant.hysteresis import Hysteresis
from haploop.mocks.pytest_plugin import Rigs
from tests.raising import raises

pytestmark = pytest.mark.many_plays

POINTS = (0, 14, 45, 76)
PERIOD = 1.0
"""Half of what a map takes, in a fifth of the time."""
FULL_NOISE = {"vibrometer_noise_scale": 11.2}
"""37 dB: what one patch makes of the table over the vibrometer's noise, both within 15 to 625 Hz, rms
over the map (measured)."""


@dataclass(frozen=True)
class Mapped:
    rig: Rig
    found: VibrationMap
    folder: Path


def lag(rig: Rig, level: float) -> complex:
    """First harmonic of what the plant's hysteresis makes of a sine: what a sweep at `level` shows."""
    phase = 2 * np.pi * np.arange(20_000) / 5_000
    law = Hysteresis(rig.file.simulation.hysteresis)
    linear_volts = law.follow(np.asarray(level * np.sin(phase)))[5_000:]
    return complex(2j * np.mean(linear_volts * np.exp(-1j * phase[5_000:])) / level)


def error(mapped: Mapped) -> float:
    """Relative rms over points, configurations and 30 to 600 Hz, gain and lag included."""
    found, truth = mapped.found, mapped.rig.simulation
    f = np.arange(*BAND, 0.5)
    expected, got = [], []
    for name in found.configurations:
        patches = found.plan.patches if name == "all" else (name,)
        expected.append(
            [sum(truth.truth.velocity_response(p, point, f) for p in patches) for point in found.points]
        )
        got.append(found.velocity(name, f))
    true = np.array(expected) * lag(mapped.rig, found.plan.level)
    return float(np.linalg.norm(np.array(got) - true) / np.linalg.norm(true))


def simulated(rigs: Rigs) -> None:
    if rigs.mode != "twin":
        pytest.skip("a whole map, and the truth, are for the twin")


@pytest.fixture(scope="module")
def mapped(
    rigs: Rigs, request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Mapped]:
    simulated(rigs)
    folder = tmp_path_factory.mktemp("map") / "one"
    with rigs.open(request.node, None, {}) as rig:
        measure_map(rig, folder, map_plan(rig, points=POINTS, patches=("A", "B"), period=PERIOD))
        yield Mapped(rig, VibrationMap.load(folder), folder)


@pytest.mark.long
def test_a_map_is_the_plates_own(mapped):
    assert error(mapped) < 0.013
    assert mapped.found.configurations == ("A", "B", "all")
    assert mapped.found.table_seconds < 12 * 1.4
    assert mapped.found.skipped == ()
    assert np.abs(mapped.found.drift).max() < 2e-4


def test_superposition_is_tested_where_it_is_used(mapped):
    tested = dict(mapped.found.superposition)
    assert len(tested) == 3
    # Hysteresis in parallel is each patch's own, so that nothing but noise and the fit are left.
    assert max(tested.values()) < 0.02


def test_the_best_place_is_the_plates(mapped):
    best = mapped.found.best()
    assert best.patch == "A"
    assert best.frequency_hz == pytest.approx(mapped.rig.simulation.truth.resonance_hz, abs=1.0)


def test_what_was_fitted_is_kept(mapped, monkeypatch):
    monkeypatch.setattr("haploop.calibration.map.map.fit_modes", None)
    again = VibrationMap.load(mapped.folder)
    f = np.array([100.0, 263.5])
    np.testing.assert_array_equal(again.velocity("A", f), mapped.found.velocity("A", f))
    raises(DataError, "no patch 'E'", again.velocity, "E", f)


def short(rig: Rig, points: tuple[int, ...] = (3, 17, 30)) -> tuple[object, ...]:
    return (map_plan(rig, points=points, patches=("A",), period=0.25),)


def test_an_interrupted_map_is_gone_on_with(open, tmp_path):
    rig = open()
    (plan,) = short(rig)

    def stop(_doing: str, done: float, _total: float, _unit: str) -> None:
        if done >= 0.25:
            raise KeyboardInterrupt

    raises(KeyboardInterrupt, "", measure_map, rig, tmp_path / "map", plan, stop)
    folder = MapFolder.open(tmp_path / "map")
    assert [step.name for step in folder.left()] == ["point-17", "point-30", "again-003"]
    before = digest(flatten(folder.read(plan.steps[0])))
    measure_map(rig, tmp_path / "map", plan)
    assert not list(folder.left())
    assert digest(flatten(folder.read(plan.steps[0]))) == before


def test_a_damaged_point_is_measured_again_and_kept_aside(open, tmp_path):
    rig = open()
    (plan,) = short(rig, (3,))
    folder = measure_map(rig, tmp_path / "map", plan)
    path = folder.file(plan.steps[0])
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    raises(DataError, "damaged", folder.read, plan.steps[0])
    measure_map(rig, tmp_path / "map", plan)
    assert folder.read(plan.steps[0]) is not None
    assert len(list((tmp_path / "map" / "damaged").iterdir())) == 1


def test_another_plan_is_refused(open, tmp_path):
    rig = open()
    (plan,) = short(rig, (3,))
    MapFolder.create(tmp_path / "map", replace(plan, level=2.0))
    folder = MapFolder.create(tmp_path / "map", plan)
    assert MapFolder.open(tmp_path / "map").plan == plan, "a plan of which nothing was measured gives way"
    folder.skip(plan.steps[0], "no light")
    for says, change in (("level", {"level": 1.0}), ("rig file", {"rig_file": "{}"})):
        raises(ConfigurationError, says, MapFolder.create, tmp_path / "map", replace(plan, **change))
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "notes.txt").write_text("mine")
    raises(ConfigurationError, "holds no map", MapFolder.create, tmp_path / "other", plan)
    raises(DataError, "no map", MapFolder.open, tmp_path / "other")
    (tmp_path / "map" / "map.json").write_text("{}")
    raises(DataError, "damaged", MapFolder.open, tmp_path / "map")


def test_no_light_leaves_a_point_out(open, tmp_path, monkeypatch):
    rig = open()
    (plan,) = short(rig)
    aimed: list[str] = []
    confirm = rig.operator.confirm

    def seen(request: object) -> bool:
        aimed.append(str(getattr(request, "point", "")))
        return confirm(request)

    monkeypatch.setattr(rig.operator, "confirm", seen)
    monkeypatch.setattr(rig.vibrometer, "signal_level", lambda: 0.02 if aimed[-1] == "17" else 0.9)
    folder = measure_map(rig, tmp_path / "map", plan)
    assert aimed.count("17") == 3
    assert "2% of its light" in folder.skipped()["17"]
    assert [step.point for step in folder.left()] == ["17"]
    monkeypatch.setattr(rig.vibrometer, "signal_level", lambda: 0.9)
    assert measure_map(rig, tmp_path / "map", plan).skipped() == {}


def test_a_blocked_laser_follows_no_patch(open, tmp_path):
    rig = open(faults=[{"kind": "laser-blocked", "after": 0.0, "within": 1e-6}])
    (plan,) = short(rig, (3,))
    folder = measure_map(rig, tmp_path / "map", plan)
    assert "does not follow patch A" in folder.skipped()["3"]
    raises(DataError, "no measured point", VibrationMap.load, tmp_path / "map")


def test_what_a_map_needs_is_asked_for(open):
    rig = open()
    no_numbers = [(key, value) for key in ("level", "period", "every") for value in (np.nan, np.inf, 0, -1)]
    for says, asked in (
        ("'84' is none", {"points": [84]}),
        ("'E' is none", {"patches": ["E"]}),
        ("no channel for each patch", {"together": True}),
        (r"level = 500: the limits .* allow 48 V about zero\.$", {"level": 500}),
        *((f"{key} = ", {key: value}) for key, value in no_numbers),
    ):
        raises(ConfigurationError, says, map_plan, rig, **asked)


@pytest.mark.long
def test_all_patches_at_once(rigs, request, tmp_path):
    simulated(rigs)
    with rigs.open(request.node, "four-channel", {}) as rig:
        plan = map_plan(rig, points=POINTS, patches=("A", "B"), period=PERIOD)
        assert plan.together
        measure_map(rig, tmp_path / "map", plan)
        assert error(Mapped(rig, VibrationMap.load(tmp_path / "map"), tmp_path)) < 0.013


@pytest.mark.timeout(3600)
@pytest.mark.parametrize(("name", "most", "minutes"), [("simulated", 0.013, 21), ("four-channel", 0.0035, 5)])
def test_whole_maps(name, most, minutes, full, rigs, request, tmp_path):
    """84 points x 5 configurations on tables that nothing was tuned on."""
    simulated(rigs)
    if not full:
        pytest.skip("a minute or more each: pytest --full")
    for seed in (7, 8):
        with rigs.open(request.node, name, {"seed": seed, **FULL_NOISE}) as rig:
            folder = measure_map(rig, tmp_path / f"{name}-{seed}")
            mapped = Mapped(rig, VibrationMap.load(folder.path), folder.path)
            assert error(mapped) < most
            assert mapped.found.table_seconds < 60 * minutes


def test_a_file_put_aside_replaces_no_other(open, tmp_path):
    (plan,) = short(open(), (3,))
    folder = MapFolder.create(tmp_path / "map", plan)
    aside = folder.path / "damaged"
    for content in ("first", "second", "third"):
        folder.file(plan.steps[0]).write_text(content)
        if content == "third":
            (aside / f"{plan.steps[0].name}.0.h5").unlink()
        assert list(folder.left()) == list(plan.steps)
    assert {p.read_text() for p in aside.iterdir()} == {"second", "third"}
