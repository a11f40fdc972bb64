"""The beam is what the textbook says, and the whole loop runs on it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from haploop_acme_beam import Beam

import haploop
from haploop.base.errors import ConfigurationError
from haploop.instruments import Rig, load_rig_file
from haploop.instruments.rig import rig_schema

RIG = load_rig_file(Path(__file__).parents[1] / "beam.toml")


@pytest.mark.parametrize(
    ("support", "expected"),
    [
        ("simple", [np.pi, 2 * np.pi, 3 * np.pi, 4 * np.pi]),
        # The roots that textbooks tabulate.
        ("cantilever", [1.875104, 4.694091, 7.854757, 10.995541]),
    ],
)
def test_modes_are_the_textbooks(support: str, expected: list[float]) -> None:
    beam = Beam(support=support)
    modes = beam.make(RIG, np.random.default_rng(0)).modes(0.0)
    stiffness = np.sqrt(beam.modulus * beam.thickness**2 / 12 / beam.density)
    known = (np.array(expected) / beam.length) ** 2 * stiffness / (2 * np.pi)
    np.testing.assert_allclose(modes.natural_hz[:4], known, rtol=1e-6)
    x = (np.arange(2000) + 0.5) / 2000
    shapes = np.array([modes.shape((at, 0.5)) for at in x])[:, :8]
    mass = beam.density * beam.width * beam.thickness * beam.length
    np.testing.assert_allclose(shapes.T @ shapes / len(x) * mass, np.eye(8), atol=1e-4)


@pytest.mark.parametrize("support", ["simple", "cantilever"])
def test_a_patch_bends_the_beam_as_a_pair_of_moments_does(support: str) -> None:
    """Static deflection between the patch's ends and beyond them: kappa = M / (E I) under the patch only."""
    beam = Beam(support=support, patch_length=0.05)
    modes = beam.make(RIG, np.random.default_rng(0)).modes(0.0)
    centre, half = beam.patches["A"] * beam.length, beam.patch_length / 2
    moment = 62e9 * 180e-12 * beam.patch_width * (beam.thickness + 0.2e-3) / 2
    kappa = moment / (beam.modulus * beam.width * beam.thickness**3 / 12)
    x = np.linspace(0, 1, 101)
    left, right = centre - half, centre + half

    def bent(at: np.ndarray) -> np.ndarray:
        """Double integral of the curvature, from rest at the left end."""
        inside = np.clip(at, left, right) - left
        return kappa * (inside**2 / 2 + np.maximum(at - right, 0.0) * (right - left))

    exact = bent(x * beam.length)
    if support == "simple":
        exact -= x * exact[-1]
    static = modes.coupling["A"] / (2 * np.pi * modes.natural_hz) ** 2
    summed = np.array([modes.shape((at, 0.5)) @ static for at in x])
    assert np.abs(summed - exact).max() < 0.01 * np.abs(exact).max()


@pytest.mark.requires("simulation")
def test_the_whole_loop(rig: Rig, tmp_path: Path) -> None:
    recording = haploop.record(rig, "toggle", "P01", 4, tmp_path)
    press = haploop.representative([recording])
    calibration = haploop.calibrate(rig, "A", "button")
    truth = rig.simulation.truth
    assert calibration.model.resonance_hz == pytest.approx(truth.resonance_hz, abs=0.3)
    drive = haploop.drive_for(press, calibration, rig.limits)
    checked = haploop.check(rig, drive)
    assert checked.passed, checked.reasons
    learned = haploop.calibration.learn(rig, drive, calibration, iterations=1)
    assert learned.best_again <= learned.first_again


@pytest.mark.requires("simulation")
def test_a_script_gives_the_object(open_rig) -> None:
    """Without an entry point: another beam, in the same rig."""
    rig = open_rig(plant=Beam(support="cantilever", length=0.4))
    third = (7.854757 / 0.4) ** 2 * np.sqrt(200e9 * 3e-3**2 / 12 / 7850) / (2 * np.pi)
    assert rig.simulation.truth.resonance_hz == pytest.approx(third, abs=0.1)
    assert rig.file.simulation.settings["support"] == "cantilever"


def test_its_settings_are_checked_and_known_to_editors() -> None:
    with pytest.raises(ConfigurationError, match=r"unknown key 'simulation.lenght'; did you mean 'length'"):
        haploop.open_rig(RIG, simulation={"lenght": 1.0})
    with pytest.raises(ConfigurationError, match=r"patches A, and .* also names B, C, D"):
        haploop.open_rig(RIG, simulation={"patches": {"A": 0.5}})
    plants = rig_schema()["$defs"]["SimulationSettings"]
    assert "beam" in plants["properties"]["plant"]["enum"]
