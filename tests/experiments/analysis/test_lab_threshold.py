import tomllib
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from haploop.base.errors import DataError
from haploop.calibration.perception import LabThreshold, levels_of, pressing_act, thresholds
from haploop.experiments import Threshold, lab_threshold_of, people_table
from haploop.instruments.config import RigFile
from tests.calibration.conftest import make_press

RATE = 20000.0


def played(size: float = 1.0, simulated: bool = False) -> Any:
    """A digital button whose motion is a snap, `size` times."""
    t = np.arange(round(0.9 * RATE)) / RATE
    motion = size * np.exp(-(((t - 0.4) / 0.012) ** 2)) * np.sin(2 * np.pi * 264 * t)
    check = SimpleNamespace(accelerations=motion[None], measured=motion, rate_hz=RATE)
    return SimpleNamespace(press=make_press(), check=check, simulated=simulated)


def of(amplitudes: list[float], standard: float | None = 0.0) -> list[Threshold]:
    return [
        Threshold((f"P{n}",), one, (0.9 * one, 1.1 * one), 0.1, 0.0, 60, standard)
        for n, one in enumerate(amplitudes)
    ]


def test_a_persons_threshold_is_the_level_of_the_motion_that_is_just_felt():
    whole = levels_of(played().check.measured, RATE).pressing
    lab = lab_threshold_of(of([0.2, 0.2 * 10**0.1, 0.2 * 10**-0.1]), played())
    assert lab.shift == pytest.approx(whole + 20 * np.log10(0.2))
    assert lab.spread == pytest.approx(2.0) and lab.people == 3
    # A button that is twice as loud is felt at half the amplitude, and the people are the same.
    louder = lab_threshold_of(of([0.1, 0.1 * 10**0.1, 0.1 * 10**-0.1]), played(2.0))
    assert louder.shift == pytest.approx(lab.shift)


def test_the_stated_interval_of_the_mean_person_is_right_about_it():
    rng, truth, spread = np.random.default_rng(90210), -7.0, 5.0
    whole = levels_of(played().check.measured, RATE).pressing
    inside, spreads = [], []
    for _ in range(200):
        levels = truth + spread * rng.normal(size=8)
        lab = lab_threshold_of(of(list(10 ** ((levels - whole) / 20))), played())
        inside.append(abs(lab.shift - truth) <= lab.uncertainty)
        spreads.append(lab.spread**2)
    assert 0.92 < np.mean(inside) < 0.98
    assert np.sqrt(np.mean(spreads)) == pytest.approx(spread, rel=0.05)


@pytest.mark.parametrize(
    ("found", "said"),
    [
        (of([0.2, 0.3]), "at least 3 people"),
        (of([0.2, 0.3, 0.4])[:2] + of([0.2]), "of 2 people"),
        (of([0.2, 0.3, 0.4], standard=0.5), "has the standard 0"),
        (of([0.2, 0.3, -0.1]), "above 0"),
    ],
)
def test_what_is_no_detection_threshold_of_people_is_refused(found, said):
    with pytest.raises(DataError, match=said):
        lab_threshold_of(found, played())


def test_the_table_of_the_rig_file_says_the_same(tmp_path):
    lab = lab_threshold_of(of([0.2, 0.3, 0.25]), played(simulated=True))
    table = tomllib.loads(people_table(lab))["people"]
    people = RigFile.model_validate({"name": "x", "daq": {"driver": "twin"}, "people": table}).people
    assert people is not None and people.simulated and people.number == 3 and people.button == "push"
    assert people.threshold == pytest.approx(lab.shift, abs=0.05)
    assert people.spread == pytest.approx(lab.spread, abs=0.05)


def test_the_labs_threshold_replaces_the_estimate():
    lab = LabThreshold(12, -6.0, 2.0, 4.0, "push", 3.8, False)
    act, table = pressing_act(lab), thresholds().act("pressing")
    hz = np.array([250.0])
    assert act.level(hz) == pytest.approx(table.level(hz) - 6)
    assert (act.higher, act.lower, act.spread, act.mark) == (2.0, 2.0, 4.0, "measured")
    assert "12 people of this lab, measured with its push button at 3.8 N" in act.basis
    assert pressing_act(None) is table
