"""Contact area against the plant's truth, finger calibration, activation, and what makes them refuse."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haploop.base.errors import ConfigurationError, DataError, LimitError
from haploop.calibration import PressedDrives
from haploop.experiments.contact import (
    Activator,
    Contact,
    FingerCalibration,
    Rendering,
    SeenSurface,
    VerifiedButton,
    activation_areas,
    calibrate_finger,
    calibrate_meter,
    drop_old_frames,
    latency_of,
    learn_background,
    run_button,
    watch_touch,
)
from haploop.experiments.contact.button import without_lead_in
from haploop.instruments import Camera, Rig, Touch, open_rig
from haploop.instruments.driver import Mode
from tests.raising import raises

TARGET = 100e-6
RIG = """
base = "simulated"
[camera]
driver = "opencv"
source = 0
rows = 96
columns = 128
[simulation]
seed = {seed}
faults = [{faults}]
"""


@contextmanager
def rig_with_camera(
    folder: Path, faults: str = "", seed: int = 1, way: Mode = "twin", lines: str = ""
) -> Iterator[tuple[Rig, Any]]:
    """With `way` "wire" OpenCV reads the simulated camera's live stream, and nidaqmx talks to the cards."""
    if way == "wire":
        pytest.importorskip("cv2")
    path = folder / f"rig-{seed}.toml"
    path.write_text(RIG.format(seed=seed, faults=faults) + lines, encoding="utf-8")
    with open_rig(str(path), simulate=way) as rig:
        camera = rig.role(Camera)
        camera.start()
        yield rig, camera


def calibrated(rig: Rig, camera: Any) -> SeenSurface:
    background = learn_background(camera, 12)
    plant = rig.simulation.plant
    plant.target = TARGET
    drop_old_frames(camera, rig.clock)
    meter = calibrate_meter([camera.read() for _ in range(4)], background, TARGET)
    plant.target = 0.0
    drop_old_frames(camera, rig.clock)
    return SeenSurface(rig, camera, meter)


def truth_at(rig: Rig, contacts: list[Contact]) -> Any:
    return rig.simulation.truth.contact_area(np.array([contact.time for contact in contacts]))


@pytest.mark.parametrize(("seed", "way"), [(1, "twin"), (2, "twin"), (2, "wire")])
def test_area_is_within_three_percent_of_the_truth(tmp_path, seed, way):
    """At realistic noise, for fingers of several people, wherever they press with 20 mm^2 and more."""
    with rig_with_camera(tmp_path, seed=seed, way=way) as (rig, camera):
        seen = calibrated(rig, camera)
        for number, pressure in enumerate(("light", "firm"), 1):
            rig.operator.tell(Touch(f"P{seed}0", pressure, number, 2))
            contacts = watch_touch(seen)
            truth = truth_at(rig, contacts)
            found = np.array([contact.area for contact in contacts])
            large = truth > 20e-6
            assert large.sum() >= 8
            assert np.abs(found[large] / truth[large] - 1).max() < 0.03
            assert {contact.problem for contact in contacts} == {""}


@pytest.mark.long
def test_a_finger_calibration_shows_its_repeatability(tmp_path):
    with rig_with_camera(tmp_path) as (rig, camera):
        told: list[tuple[str, int, float]] = []
        found = calibrate_finger(calibrated(rig, camera), "P01", on_press=lambda *press: told.append(press))
        assert [press[:2] for press in told] == [(p, n) for p in ("light", "firm") for n in range(1, 6)]
        touches = rig.simulation.truth.touches
        for touch, (_, _, area) in zip(touches, told, strict=True):
            times = np.linspace(touch.start, touch.stop, 500)
            assert area == pytest.approx(touch.area(times).max(), rel=0.12)
        assert found.a_max > 2 * found.a_min and max(found.scatter) < 0.25


@pytest.mark.parametrize(
    ("light", "firm", "said"),
    [
        ((40, 41, 39, 40, 40), (45, 46, 44, 45, 45), "1.12 times the area"),
        ((40, 80, 20, 40, 40), (150, 150, 150, 150, 150), "light presses of P01 scatter by 50 %"),
        ((40, 40, 40, 40, 41), (60, 160, 60, 60, 60), "firm presses of P01 scatter"),
        ((40, 50, 55, 45, 40), (60, 70, 80, 50, 65), "overlap"),
        ((40, 41, 39, 40, 40), (150, 140, 160, 150, 150), ""),
        ((40,), (150,), "Two light and two firm presses"),
    ],
)
def test_a_calibration_that_is_not_usable(light, firm, said):
    found = FingerCalibration("P01", light, firm)
    assert (said in found.problem) if said else not found.problem


def test_activation_areas_follow_the_recorded_forces():
    """Largest for the latch, smallest for the toggle, all between A_min and A_max."""
    found = FingerCalibration("P01", (40e-6,) * 5, (160e-6,) * 5)
    areas = activation_areas(found, {"latch": 8.0, "toggle": 2.2, "push": 4.0})
    assert found.a_min < areas["toggle"] < areas["push"] < areas["latch"] < found.a_max
    assert areas["toggle"] == pytest.approx(70e-6) and areas["latch"] == pytest.approx(130e-6)
    for forces in ({}, {"latch": 0.0}, {"latch": float("nan")}):
        raises(DataError, "positive mean force", activation_areas, found, forces)


SPOILT = (
    ('{ kind = "ambient-light", after = 2.0 }', "The light changed by"),
    # Alone it lies partly outside this small picture.
    ('{ kind = "second-finger", after = 2.0 }', "more than one finger|partly outside the picture"),
    ('{ kind = "defocus" }', "focus the camera"),
    ('{ kind = "ambient-light", light = 200.0 }', "too bright"),
)
WHILE_IT_LEARNS = (
    ('{ kind = "ambient-light", after = 0.1 }', "Something moved"),
    ('{ kind = "second-finger", after = 0.26 }', "2 bright spots|differs by more than 1 %"),
)


@pytest.mark.parametrize(
    ("fault", "said", "way"),
    [*((*one, "twin") for one in (*SPOILT, *WHILE_IT_LEARNS)), *((*one, "wire") for one in SPOILT)],
)
def test_what_spoils_an_image_is_named(tmp_path, fault, said, way):
    with rig_with_camera(tmp_path, fault, way=way) as (rig, camera), pytest.raises(DataError, match=said):
        seen = calibrated(rig, camera)
        rig.clock.sleep(2.1 - rig.clock.now())
        calibrate_finger(seen, "P01", presses=1, timeout=1.5)
    assert rig.simulation is not None and rig.simulation.faults[0].fired


@pytest.mark.parametrize("way", ["twin", "wire"])
def test_lost_frames_are_gaps_in_the_numbers(tmp_path, way):
    fault = '{ kind = "frames-lost", after = 0.4, times = 3 }'
    with rig_with_camera(tmp_path, fault, way=way) as (rig, camera):
        camera.read()
        rig.clock.sleep(0.3 - rig.clock.now())
        camera.start()
        numbers = [camera.read().number for _ in range(20)]
    assert sorted(np.diff(numbers)) == [1] * 18 + [4]


def contact(area: float, time: float = 0.0, problem: str = "") -> Contact:
    return Contact(0, time, area, 0, 0, 0.0, problem)


def presses(activator: Activator, areas: list[float]) -> list[str]:
    return [what for area in areas if (what := activator.see(contact(area)))]


@settings(max_examples=200, deadline=None)
@given(st.lists(st.floats(0.4, 3.0), max_size=200), st.booleans())
def test_one_press_for_each_touch_however_the_finger_trembles(areas, release):
    """Whatever the area does above the level at which a finger counts as lifted."""
    found = presses(Activator(1.0, 0.4, 0.7 if release else None), [0.0, *areas])
    assert found.count("press") == (1 if any(area > 1 for area in areas) else 0)
    assert found.count("release") <= found.count("press")
    assert not release or found in ([], ["press"], ["press", "release"])


def test_a_finger_that_rests_from_the_beginning_is_no_press():
    assert presses(Activator(1.0, 0.4), [2.0, 2.0, 0.5, 2.0]) == []
    assert presses(Activator(1.0, 0.4), [2.0, 0.1, 2.0, 0.1, 0.0, 1.5]) == ["press", "press"]


def test_a_frame_that_is_not_to_be_trusted_activates_nothing():
    activator = Activator(1.0, 0.4)
    activator.see(contact(0.0))
    assert activator.see(contact(2.0, problem="There is more than one finger.")) is None
    # One of two fingers was lifted: nobody crossed the area.
    assert activator.see(contact(2.0)) is None and activator.lifts == 0
    assert activator.see(contact(0.0)) is None and activator.lifts == 1
    assert activator.see(contact(2.0)) == "press"


@pytest.mark.parametrize("areas", [(1.0, 0.0, None), (1.0, 1.0, None), (1.0, 0.4, 0.3), (1.0, 0.4, 1.0)])
def test_areas_in_the_wrong_order_are_refused(areas):
    raises(ConfigurationError, "lifted <= release < activation", Activator, *areas)


def burst(peak: float, rate_hz: float = 50_000.0) -> Any:
    """A drive of 0.1 s that begins with 0.05 s of nearly nothing."""
    times = np.arange(round(0.1 * rate_hz)) / rate_hz
    turns = np.pi * times / 0.05
    shape = np.where(times > 0.05, np.sin(turns - np.pi) ** 2, 1e-4 * np.sin(turns))
    volts = peak * shape * np.sin(2 * np.pi * 260 * times)
    return SimpleNamespace(
        volts=volts[np.newaxis], target=volts, rate_hz=rate_hz, patches=("A",), by_patch={"A": volts}
    )


def verified(rig: Rig, drive: Any, date: Callable[[], str] | None = None) -> VerifiedButton:
    from haploop.experiments.contact.button import _today

    button: Any = SimpleNamespace(press=SimpleNamespace(button="push"))
    check: Any = SimpleNamespace(drive=drive)
    return VerifiedButton(button, check, rig, (date or _today)(), 0.0)


def test_a_button_plays_once_a_press_within_a_frame_of_the_crossing(tmp_path):
    with rig_with_camera(tmp_path) as (rig, camera):
        seen = calibrated(rig, camera)
        truth = rig.simulation.truth
        outputs = truth.record()
        area = 90e-6
        found = []
        for number in range(1, 4):
            rig.operator.tell(Touch("P01", "as a button", number, 3))
            found += run_button(seen, Rendering(verified(rig, burst(20.0))), Activator(area, 20e-6))
        for played, touch in zip(found, truth.touches, strict=True):
            times = np.linspace(touch.start, touch.stop, 20_001)
            crossing = times[np.argmax(touch.area(times) > area * 1.03)]
            before = times[np.argmax(touch.area(times) > area * 0.97)]
            assert before - 1e-9 <= played.contact.time <= crossing + 1 / camera.rate_hz
            moved = [
                o.start + o.period * int(np.argmax(np.abs(o.volts) > 0.5))
                for o in outputs
                if np.abs(o.volts).max() > 0.5
            ]
            begun = min(time for time in moved if time > played.contact.time)
            # The program's bound on the first sample is true, and not far off.
            assert played.contact.time + played.latency <= begun <= played.contact.time + played.onset + 0.01
        told = latency_of(found)
        assert told.count == 3 and 0.02 < told.median <= told.p95 <= told.worst < 0.1
        assert truth.peak < 22 and not truth.closed


@pytest.mark.parametrize("sensor", ["true", "false"])
def test_the_force_at_the_press_chooses_the_drive(tmp_path, sensor):
    """Without a force sensor under the table it is the nominal one; the choice costs a hundredth of a
    second."""
    with rig_with_camera(tmp_path, lines=f"[table]\nforce = {sensor}") as (rig, camera):
        seen = calibrated(rig, camera)
        drives = tuple(burst(volts) for volts in (10.0, 15.0, 20.0))
        pressed = PressedDrives("P01", 0.4, (0.4, 2.5, 9.0), drives)
        button = replace(verified(rig, burst(5.0)), pressed=pressed)

        def ask():
            rig.operator.tell(Touch("P01", "as a button", 1, 1))

        [played] = run_button(seen, Rendering(button), Activator(110e-6, 20e-6), ask=ask)
        plant = rig.simulation.plant
        if sensor == "true":
            true = plant.touches[-1].force(np.array(played.contact.time + 0.02))
            assert played.force == pytest.approx(float(true), abs=0.4) and played.made_for == 2.5
        else:
            assert played.force is None and played.made_for == 0.4
        assert plant.peak == pytest.approx(15.0 if sensor == "true" else 10.0, rel=0.1)
        assert played.latency < 0.06


def test_no_drive_outside_the_limits(tmp_path):
    with rig_with_camera(tmp_path) as (rig, camera):
        seen = calibrated(rig, camera)
        rig.operator.tell(Touch("P01", "as a button", 1, 1))
        with pytest.raises(LimitError):
            run_button(seen, Rendering(verified(rig, burst(80.0))), Activator(90e-6, 20e-6))
        assert rig.simulation.truth.peak < 1.1  # the volt that proves the gain


def test_only_a_button_that_was_verified_here_today(tmp_path):
    with rig_with_camera(tmp_path) as (rig, camera):
        seen = calibrated(rig, camera)
        stale = verified(rig, burst(20.0), lambda: "2020-01-01")
        with pytest.raises(ConfigurationError, match="verify it again on this rig today"):
            run_button(seen, Rendering(stale), Activator(90e-6, 20e-6))
        other = verified(SimpleNamespace(name="other"), burst(20.0))
        with pytest.raises(ConfigurationError, match="verify it again on this rig today"):
            run_button(seen, Rendering(other), Activator(90e-6, 20e-6))
        with pytest.raises(DataError, match=r"not pressed within 0\.2 s"):
            run_button(seen, Rendering(verified(rig, burst(20.0))), Activator(90e-6, 20e-6), timeout=0.2)


@pytest.mark.parametrize("share", [-0.1, 0.02, float("nan")])
def test_no_more_than_a_lead_in_is_left_out(share):
    raises(ConfigurationError, r"use 0 to 0\.01", without_lead_in, burst(1.0), share)
