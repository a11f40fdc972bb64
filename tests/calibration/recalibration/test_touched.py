"""Somebody leans on the table while it is recalibrated: it is told from a drift, and never adopted."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from haploop.calibration.model.model import fit
from haploop.calibration.recalibration import recalibration
from haploop.calibration.recalibration.drift import compare
from haploop.calibration.recalibration.recalibration import Outcome, recalibrate
from haploop.calibration.response import Response
from haploop.mocks.plant import Fingertip, Hand
from haploop.mocks.plant.touched import touched_velocity
from tests.calibration.conftest import Calibrated
from tests.calibration.recalibration.conftest import WHEN
from tests.calibration.recalibration.test_recalibration import changed_nothing, content, left_alone

pytestmark = [pytest.mark.many_plays, pytest.mark.requires("simulation"), pytest.mark.long]


def hand(**settings: Any) -> dict[str, Any]:
    return {"kind": "hand-on-table", **settings}


def found(outcome: Outcome) -> str:
    return " ".join(outcome.sentences)


@pytest.mark.parametrize(
    ("mass", "force", "palm"), [(0.96, 5.0, True), (0.32, 5.0, False), (0.096, 0.25, False)]
)
def test_a_hand_is_named(open, history, mass, force, palm):
    before = content(history)
    rig = left_alone(open(pane_mass=mass, faults=[hand(force=force, palm=palm, point="31")]))
    rig.clock.sleep(1.0)
    outcome = recalibrate(rig, history, when=WHEN)
    assert changed_nothing(history, outcome, before, "touched")
    assert "Something seems to rest on the table" in found(outcome) and "Take hands" in found(outcome)
    assert not outcome.after


def test_somebody_who_is_asked_takes_the_hand_away(open, history):
    before = content(history)
    rig = open(pane_mass=0.2, faults=[hand(point="31")])
    rig.clock.sleep(1.0)
    outcome = recalibrate(rig, history, when=WHEN)
    assert changed_nothing(history, outcome, before, "unchanged")
    assert "Something" not in found(outcome)


@pytest.mark.night
def test_dampings_that_somebody_confirms_are_a_drift(open, history):
    """A boundary that damps one mode more looks like a hand; whoever sees that there is none decides."""
    changed = {"kind": "mode-drift", "damping": 1.0, "near": 263.5}
    outcome = recalibrate(left_alone(open(faults=[changed])), history, when=WHEN)
    assert outcome.kind == "touched"
    outcome = recalibrate(open(faults=[changed]), history, when=WHEN, iterations=0)
    assert outcome.kind == "restored" and "Somebody confirmed" in found(outcome)


@pytest.mark.parametrize("when", ["before the calibration", "after the calibration"])
def test_a_hand_that_comes_while_buttons_are_made_is_not_adopted(open, history, monkeypatch, when):
    """The look found a drift alone, and the hand comes then."""
    before = content(history)
    rig = left_alone(open(pane_mass=0.3, mode_drift=0.01))
    real = recalibration.calibrate_keeping if when.startswith("before") else recalibration.build_button

    def leaning(*args: Any, **more: Any) -> Any:
        now, rng = rig.clock.now(), np.random.default_rng(1)
        rig.simulation.plant.hands.append(Hand("a test's", Fingertip(), (0.3, 0.3), 1.0, now, rng))
        return real(*args, **more)

    monkeypatch.setattr(recalibration, real.__name__, leaning)
    outcome = recalibrate(rig, history, when=WHEN, iterations=0)
    assert changed_nothing(history, outcome, before, "touched"), found(outcome)
    assert outcome.verdicts[0].kind == "drifted" and not outcome.verdicts[0].dampings.touched


@pytest.mark.night
def test_a_hand_that_leaves(open, history, monkeypatch):
    """Somebody confirmed that nothing rests on the table, and was wrong about it."""
    before = content(history)
    rig = open(pane_mass=0.3, mode_drift=0.01, faults=[hand(point="31")])
    rig.clock.sleep(1.0)
    monkeypatch.setattr(rig.operator, "confirm", lambda _request: True)
    real = recalibration.build_button

    def leaving(*args: Any, **more: Any) -> Any:
        rig.simulation.plant.lift()
        rig.clock.sleep(0.5)
        return real(*args, **more)

    monkeypatch.setattr(recalibration, "build_button", leaving)
    outcome = recalibrate(rig, history, when=WHEN, iterations=0)
    assert changed_nothing(history, outcome, before, "touched")
    assert "has left the table" in found(outcome)


def modes(calibrated: Calibrated) -> Any:
    return calibrated.rig.simulation.truth.surface.modes(0.0)


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.night) for seed in range(1, 4))])
def test_drift_is_no_hand_but_a_hand_on_a_drifted_table_is(calibrated, seed):
    """Against the plant's own response, with noise as in a look: frequencies, dampings alike, both."""
    rng, active = np.random.default_rng(seed), calibrated.calibration
    whole, f = modes(calibrated), active.response.frequencies
    place = calibrated.rig.simulation.plant.place("button")
    lag = active.model.velocity(f) / whole.velocity("A", place, f)

    def touched(changed: Any, contacts: tuple[Any, ...] = ()) -> bool:
        shown = touched_velocity(changed, contacts, place, f)["A"] * lag
        noise = rng.standard_normal((2, len(f)))
        shown = shown + 0.002 * np.sqrt(np.mean(np.abs(shown) ** 2)) * (noise[0] + 1j * noise[1])
        found = compare(active, replace(active.response, velocity=shown), {})
        assert found.now is not None
        return found.dampings.touched

    each = 1 + 0.01 * rng.standard_normal(len(whole.natural_hz))
    drifted = replace(whole, natural_hz=1.01 * whole.natural_hz * each)
    assert not touched(whole) and not touched(drifted)
    for factor in (0.7, 1.3):
        assert not touched(replace(drifted, damping=factor * whole.damping))
    light = replace(drifted, masses=whole.masses * rng.choice([0.1, 0.33]))
    force, where = rng.uniform(0.5, 5), (rng.uniform(0.15, 0.85), rng.uniform(0.15, 0.85))
    assert touched(light, Fingertip.of(rng).at("a finger", where, force))


@pytest.mark.parametrize("patch", ["A", *(pytest.param(one, marks=pytest.mark.night) for one in "BCD")])
def test_no_patch_takes_a_drift_for_a_hand(calibrated, patch, full):
    """It sees some modes weakly, beside others or at the band's edge: no response tells their dampings."""
    rng, active = np.random.default_rng(7), calibrated.calibration
    whole, f = modes(calibrated), active.response.frequencies
    place = calibrated.rig.simulation.plant.place("button")

    def response(changed: Any) -> Response:
        shown = touched_velocity(changed, (), place, f)[patch]
        noise = rng.standard_normal((2, len(f)))
        shown = shown + 0.002 * np.sqrt(np.mean(np.abs(shown) ** 2)) * (noise[0] + 1j * noise[1])
        return replace(active.response, patch=patch, velocity=shown)

    bare = response(whole)
    own = replace(active, response=bare, model=fit(bare))
    each = [
        1 + 0.01 * rng.standard_normal(len(whole.natural_hz)) for _ in range(8 if full or patch == "D" else 3)
    ]
    for factor in (0.98, 0.99, 1.0, 1.005, 1.01, 1.02, *each):
        drifted = replace(whole, natural_hz=factor * whole.natural_hz)
        assert not compare(own, response(drifted), {}).dampings.touched, factor
