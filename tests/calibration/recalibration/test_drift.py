"""A response is laid over the active one, and what differs is a drift or a broken place."""

import hashlib
import re
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

from haploop.calibration import Calibration, Response
from haploop.calibration.recalibration import drift
from haploop.calibration.recalibration.drift import compare
from haploop.calibration.recalibration.overlay import lay_over
from haploop.instruments.config.rig_file import Recalibration

pytestmark = pytest.mark.many_plays

WHEN = datetime(2026, 7, 31, 2, 15, tzinfo=UTC)


def moved(
    calibration: Calibration, shift: float = 0.0, damping: float = 1.0, gain: float = 1.0, path: float = 1.0
) -> Response:
    """The response that the calibrated place would show had its table changed so, exactly."""
    response, model = calibration.response, calibration.model
    poles = (1 + shift) * (damping * model.poles.real + 1j * model.poles.imag)
    velocity = gain * replace(model, poles=poles).velocity(response.frequencies)
    return replace(response, velocity=velocity, path=path * response.path)


@pytest.mark.parametrize(("change", "kind", "says"), [
    ({}, "unchanged", r"\(.0.00%\)"),
    ({"shift": 0.001}, "unchanged", r"\(\+0.10%\)"),
    ({"shift": -0.001}, "unchanged", r"\(-0.10%\)"),
    ({"damping": 1.15, "gain": 0.95}, "unchanged", ""),
    ({"shift": 0.03}, "drifted", r"resonance of patch A at the button point changed by \+3.00%"),
    ({"shift": -0.0035}, "drifted", r"changed by -0.35%, and 0.30% is accepted"),
    ({"damping": 1.3}, "drifted", r"damping .* changed by \+30%, and 20%"),
    ({"gain": 0.85}, "drifted", r"gain .* changed by -15.0%, and 10.0%"),
    ({"path": 0.8}, "drifted", r"gain .* changed by -20.0%"),
    ({"gain": 0.5}, "broken", "0.50 times what it was"),
    ({"shift": 0.118}, "broken", "more than 10% is no drift"),
])  # fmt: skip
def test_a_response_laid_over(calibrated, change, kind, says):
    active = calibrated.calibration
    verdict = compare(active, moved(active, **change), {})
    assert verdict.kind == kind
    assert len(verdict.sentences) == 1
    assert pytest.approx(1 + change.get("shift", 0)) == (
        verdict.now.resonance_hz / verdict.before.resonance_hz if verdict.now else None
    )
    assert re.search(says, verdict.sentences[0])


def test_what_is_not_the_same_place_is_broken(calibrated):
    active = calibrated.calibration
    response = active.response
    mirrored = replace(response, velocity=response.velocity * np.exp(0.02j * response.frequencies))
    verdict = compare(active, mirrored, {})
    assert verdict.kind == "broken"
    assert "the laser still looks at the point" in verdict.sentences[0]


SEEDS = [int.from_bytes(hashlib.sha256(f"drift {k}".encode()).digest()[:4], "big") for k in range(2)]


@pytest.mark.long
@pytest.mark.parametrize("seed", SEEDS)
def test_each_mode_may_move_by_its_own_amount(calibrated, drive, seed):
    active = calibrated.calibration
    model, response = active.model, active.response
    rng = np.random.default_rng(seed)
    shift, damping = 1 + 0.02 * rng.standard_normal((2, len(model.poles)))
    poles = shift * (damping * model.poles.real + 1j * model.poles.imag)
    velocity = replace(model, poles=poles).velocity(response.frequencies)
    verdict = compare(active, replace(response, velocity=velocity), {"push": drive})
    assert verdict.kind == "drifted" and verdict.changes["push"] > 0.1
    main = int(np.argmin(np.abs(np.abs(model.poles) / (2 * np.pi) - model.resonance_hz)))
    assert verdict.now.resonance_hz / verdict.before.resonance_hz == pytest.approx(shift[main], abs=2e-3)
    assert "moved each on its own" in " ".join(verdict.sentences)


@pytest.mark.long
@pytest.mark.parametrize("change", [0.02, -0.02])
def test_a_single_mode_that_moved_is_a_drift(calibrated, drive, change):
    active = calibrated.calibration
    model, response = active.model, active.response
    for hz in (model.resonance_hz, 200):
        poles = model.poles.copy()
        poles[int(np.argmin(np.abs(np.abs(poles) / (2 * np.pi) - hz)))] *= 1 + change
        velocity = replace(model, poles=poles).velocity(response.frequencies)
        verdict = compare(active, replace(response, velocity=velocity), {"push": drive})
        assert verdict.kind == "drifted", verdict.sentences
        assert "moved each on its own" in " ".join(verdict.sentences)


def test_a_pole_far_above_the_band_is_no_mode_that_moved(calibrated):
    """It stands for what is far away, and no line shows where it is; its peak would be the highest of all."""
    active = calibrated.calibration
    model = active.model
    far, strength = 2 * np.pi * 1846 * (-4e-4 + 1j), 30 * np.abs(model.residues).max()
    whole = replace(
        model,
        poles=np.append(model.poles, far),
        residues=np.append(model.residues, strength),
        resonant=np.append(model.resonant, False),
        decay_deviation=np.append(model.decay_deviation, 1.0),
    )
    f = np.arange(75.0, 600.0, 0.5)
    laid = lay_over(whole, f, replace(whole, poles=1.01 * whole.poles).velocity(f))
    assert laid.weight[-1] == 0 and laid.weight.max() == 1
    main = int(np.argmin(np.abs(np.abs(model.poles) / (2 * np.pi) - model.resonance_hz)))
    assert laid.weight[main] > 0.9 and laid.shift[main] == pytest.approx(0.01, rel=1e-3)


@pytest.mark.requires("simulation")
@pytest.mark.parametrize(("patch", "point"), [
    ("A", "19"), *(pytest.param(*at, marks=pytest.mark.long) for at in (("A", "32"), ("B", "button"))),
])  # fmt: skip
def test_the_next_point_and_another_patch_are_broken(calibrated, patch, point):
    """The true responses, with the lag that the active calibration's hysteresis has at its level."""
    active = calibrated.calibration
    lag = active.hysteresis.gain(active.response.level)
    truth = calibrated.rig.simulation.truth
    velocity = lag * truth.velocity_response(patch, point, active.response.frequencies)
    assert compare(active, replace(active.response, velocity=velocity), {}).kind == "broken"


@pytest.mark.parametrize(("weight", "kind"), [(0.1, "broken"), (0.01, "drifted")])
def test_a_mode_that_moved_further_than_any_drift_is_another_point(calibrated, monkeypatch, weight, kind):
    """As a table's next grid point looked: the modes moved by -2 to +10.5 %, and nearly a drift was left."""
    active = calibrated.calibration
    laid = lay_over(active.model, active.response.frequencies, active.response.velocity)
    weak = int(np.argmin(laid.weight))
    own = np.arange(len(laid.weight)) == weak
    moved = replace(
        laid,
        shift=np.where(own, 0.105, laid.shift),
        weight=np.where(own, weight, laid.weight),
        residual=0.24,
    )
    monkeypatch.setattr(drift, "lay_over", lambda *_: moved)
    verdict = compare(active, active.response, {})
    assert verdict.kind == kind
    assert ("the laser still looks at the point" in verdict.sentences[0]) == (kind == "broken")


def test_coherence_is_judged_first(calibrated):
    active = calibrated.calibration
    weak = replace(moved(active), coherence=np.full(len(active.response.frequencies), 0.7))
    assert compare(active, weak, {}).kind == "broken"
    assert compare(active, weak, {}, thresholds=Recalibration(coherence=0.6)).kind == "unchanged"
    assert compare(active, moved(active, 0.001), {}, None, Recalibration(resonance=0.0005)).kind == "drifted"
