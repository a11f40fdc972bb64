"""One factor over a response: who may have made it, and what several nights add up to."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from haploop.base.progress import silent
from haploop.calibration import calibrate
from haploop.calibration.recalibration.common_factor import common_factors, factors_since
from haploop.calibration.recalibration.drift import PlaceMetrics, Verdict
from haploop.calibration.recalibration.history import Generation, History
from haploop.calibration.recalibration.look import look_at

METRICS = PlaceMetrics(263.5, 0.01, 1.0, 0.99, 0.01, 0.1)


def seen(patch: str, factor: float, path: float = 1.0, point: str = "button") -> Verdict:
    return Verdict(patch, point, "drifted", METRICS, METRICS, (), factor, path)


@pytest.mark.parametrize(("verdicts", "says"), [
    ([seen("A", 0.85)], ["0.85 times", "32°", "Only one patch was measured", "Nothing is made anew"]),
    ([seen("A", 1.2)], ["1.20 times", "Only one patch"]),
    ([seen("A", 0.85), seen("B", 0.86)], ["patch A", "patch B", "which speaks for the laser"]),
    ([seen("A", 0.85), seen("B", 1.01)], ["patch B is as it was, which speaks for the patch"]),
    ([seen("A", 0.85), seen("B", 1.0, point="37")], ["The other patches do not tell which"]),
    ([seen("A", 1 / 0.85, 0.85)], ["drive monitor shows 0.85 times", "the monitor's divider"]),
])  # fmt: skip
def test_what_can_have_made_a_factor_is_named(verdicts, says):
    told = " ".join(common_factors(verdicts, {}, 0.05))
    assert all(part in told for part in says), told
    assert ("°" in told) == any(v.factor < 0.95 for v in verdicts)


def test_a_small_factor_is_accepted_and_an_amplifier_is_none():
    assert common_factors([seen("A", 0.97), seen("B", 1.0, path=0.8)], {}, 0.05) == ()


def test_small_factors_of_several_nights_add_up_until_a_person_adopts():
    def generation(name: str, parent: str, factor: float | None, content: str) -> Any:
        places = [{"patch": "A", "point": "button", "factor": factor}] if factor else None
        files = {"calibrations/A-button.h5": content, "buttons/push.h5": content}
        details = {} if places is None else {"places": places}
        return SimpleNamespace(name=name, folder=Path(name), parent=parent, details=details, files=files)

    chain = {
        one.name: one
        for one in (
            generation("0001", "", None, "a"),
            generation("0002", "0001", 0.5, "b"),
            generation("0003", "0002", None, "c"),  # calibrated by a person
            generation("0004", "0003", 0.97, "d"),
            generation("0005", "0004", None, "d"),  # a person added a button, and measured nothing here
            generation("0006", "0005", 0.97, "e"),
        )
    }
    history = cast(History, SimpleNamespace(find=chain.__getitem__))
    since = factors_since(history, cast(Generation, chain["0006"]))
    assert since == {("A", "button"): pytest.approx(0.97**2)}
    told = common_factors([seen("A", 0.97)], since, 0.05)
    assert "0.91 times" in told[0]


@pytest.mark.requires("simulation")
@pytest.mark.many_plays
@pytest.mark.night
def test_another_patch_speaks_for_the_laser_or_for_the_patch(calibrated, open):
    both = calibrated.calibration, calibrate(open(), "B")
    for fault, says in (
        ({"kind": "laser-askew", "scale": 0.85}, ["patch A", "patch B", "speaks for the laser"]),
        ({"kind": "patch-gain", "gain": 0.85, "patches": ["A"]}, ["patch A", "speaks for the patch"]),
        ({"kind": "amplifier-gain", "gain": 43.0}, []),
    ):
        faults = [fault, {"kind": "mode-drift", "frequency_each": 0.005, "damping_each": 0.1}]
        look = look_at(open(faults=faults), both, {}, None, silent)
        told = common_factors(look.verdicts, {}, 0.05)
        assert [verdict.kind for verdict in look.verdicts] == ["drifted", "drifted"], (fault, look.sentences)
        assert all(part in " ".join(told) for part in says) and bool(told) == bool(says), told
