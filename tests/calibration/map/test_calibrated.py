"""Calibrations of grid points that are taken from a map."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest

from haploop.base.errors import ConfigurationError
from haploop.calibration import (
    Calibration,
    DigitalButton,
    Multisine,
    TradeOff,
    VibrationMap,
    build_button,
    calibrate,
    drive_for,
    map_plan,
    measure_map,
    with_map,
)
from haploop.calibration.drive import STEADY
from haploop.calibration.drive.actuation import Actuation
from haploop.instruments import Rig, open_rig
from tests.calibration.conftest import make_press

pytestmark = pytest.mark.long

SEED = 3
F = np.arange(80.0, 600.0, 0.5)


def opened(seed: int = SEED, **plant: float) -> Rig:
    return open_rig("four-channel", simulate="twin", simulation={"seed": seed, **plant})


def quickly(rig: Rig, point: str) -> tuple[Calibration, ...]:
    return tuple(calibrate(rig, patch, point, excitation=Multisine()) for patch in "ABCD")


@dataclass(frozen=True)
class Mapped:
    rig: Rig
    own: tuple[Calibration, ...]
    map: VibrationMap


@pytest.fixture(scope="module")
def mapped(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Mapped]:
    folder = tmp_path_factory.mktemp("map") / "map"
    with opened() as rig:
        measure_map(rig, folder, map_plan(rig, points=(0, 13, 40, 57, 75, 83)))
        yield Mapped(rig, quickly(rig, "button"), VibrationMap.load(folder))


def apart(taken: Sequence[Calibration], measured: Sequence[Calibration]) -> tuple[float, float]:
    """Difference of what a map and what calibrations say of a point, and what both state, over the response.

    The laws are those of the button's calibrations: a map's, measured together, differ in scale.
    """
    one, other = Actuation.of(taken), Actuation.of(measured)
    gain, truth = one.gain(F)[0], other.gain(F)[0]
    stated = [np.einsum("ppl->pl", table.covariance(F)[0].real).sum() for table in (one, other)]
    size = float(np.linalg.norm(truth))
    return float(np.linalg.norm(gain - truth)) / size, float(np.sqrt(np.sum(stated))) / size


def test_a_point_of_the_map_is_known_as_well_as_is_said(mapped):
    taken = with_map(mapped.own, mapped.map, ["57"])
    assert taken[:4] == mapped.own and [one.response.patch for one in taken[4:]] == list("ABCD")
    assert all("map" in one.response.source and one.response.point == "57" for one in taken[4:])
    difference, stated = apart(taken[4:], quickly(mapped.rig, "57"))
    assert difference < 0.006 and difference < 3 * stated < 0.02


@pytest.mark.night
def test_a_map_of_before_the_drift_is_used_with_the_modes_of_now(mapped):
    with opened(mode_drift=0.005) as rig:
        own, there = quickly(rig, "button"), quickly(rig, "57")
    difference, stated = apart(with_map(own, mapped.map, ["57"])[4:], there)
    assert difference < 0.03 and difference < 3 * stated < 0.1
    # Left where they were, the modes would make it useless, and less is known of it than of a fresh map.
    old, _ = apart(with_map(mapped.own, mapped.map, ["57"])[4:], there)
    assert old > 0.2
    fresh = apart(with_map(mapped.own, mapped.map, ["57"])[4:], with_map(mapped.own, mapped.map, ["57"])[4:])
    assert stated > 1.5 * fresh[1]


def test_one_point_plays_and_one_is_silent_that_nobody_calibrated(mapped, tmp_path):
    press, rig = make_press(), mapped.rig
    alone = drive_for(press, mapped.own[0], rig.limits)
    every = with_map(mapped.own, mapped.map, ["57", "75"])
    tick = replace(press, button="tick", acceleration=np.roll(press.acceleration, 100))
    trade, wanted = TradeOff(scale=alone.scale, drift=STEADY), {"57": tick, "75": None}
    made = build_button(rig, press, every, trade=trade, elsewhere=wanted, iterations=0, plays=4)
    (silence,), (other,), planned = made.check.silent, made.check.others, made.drive.elsewhere
    assert silence.contrast_db > 20 and silence.motion.root < 2.5 * planned[1].expected[0]
    assert made.check.within.root < 0.1 and other.within.root < 0.15
    # A map ends at 625 Hz, and beyond it the drive has no power: what it would move there nobody knows.
    assert made.drive.known[1] < 630
    assert other.outside.root < 0.3 and made.check.outside.root < 0.3
    for one in planned:
        assert 0 < one.known_to < 0.02 and "map" in one.known_from
        assert "above 625 Hz was not measured there, and is expected as at the cal" in one.known_from
    # What distortion moves beyond is expected of a button, by what it moves at the calibrated point.
    assert other.whole.interval[0] / 1.5 < planned[0].expected[0] < 1.5 * other.whole.interval[1]
    assert planned[0].expected[0] > 2 * other.within.root
    made.save(tmp_path / "quiet.h5")
    assert DigitalButton.load(tmp_path / "quiet.h5").digest == made.digest


def test_what_nobody_measured_above_a_map_is_said_to_be_unknown(mapped):
    nothing = tuple(replace(one, beyond=np.zeros((3, 0)), above=None) for one in mapped.own)
    every, press = with_map(nothing, mapped.map, ["57"]), make_press()
    drive = drive_for(press, every, mapped.rig.limits, elsewhere={"57": press})
    assert drive.elsewhere[0].known_from.endswith("there, and is not expected: it is not known")


def test_a_map_that_does_not_fit_is_refused_in_a_sentence(mapped, tmp_path):
    assert with_map(mapped.own, mapped.map, []) == mapped.own
    foreign, fewer = (
        replace(mapped.map, plan=replace(mapped.map.plan, **new))
        for new in ({"rig": "x"}, {"patches": tuple("ABC")})
    )
    moved = replace(mapped.map, modes=replace(mapped.map.modes, poles=1.03 * mapped.map.modes.poles))
    with opened(seed=11) as rig:
        other = (calibrate(rig, "A", excitation=Multisine()),)
    for says, own, found, point in (
        (r"The map has no point 5:", mapped.own, mapped.map, "5"),
        (r"The map is of the rig 'x'", mapped.own, foreign, "57"),
        (r"The map has no patch D:", mapped.own, fewer, "57"),
        (r"does not fit the calibrations: .* at -2\.9% in freq", mapped.own, moved, "57"),
        ("does not fit the calibrations", other, mapped.map, "57"),
    ):
        with pytest.raises(ConfigurationError, match=says):
            with_map(own, found, [point])
