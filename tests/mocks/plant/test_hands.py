"""Fingers and palms on the simulated table, through a rig."""

from typing import Any

import numpy as np
import pytest

from haploop.base.errors import ConfigurationError
from haploop.instruments import Rig
from haploop.instruments.operator import LiftFinger, RestFinger
from haploop.mocks.plant import Fingertip, random_modal
from tests.conftest import OpenRig
from tests.raising import raises

BAND = np.arange(75.0, 600.0, 0.25)


def hand(**settings: Any) -> dict[str, Any]:
    return {"kind": "hand-on-table", **settings}


def response(rig: Rig, point: str = "button", patch: str = "A") -> np.ndarray:
    rig.simulation.truth.velocity(point, np.array([rig.clock.now()]))
    return np.asarray(rig.simulation.truth.velocity_response(patch, point, BAND))


def changed(open: OpenRig, mass: float = 0.96, **settings: Any) -> tuple[np.ndarray, np.ndarray]:
    """The response bare, and under a hand that has rested for a second."""
    bare, under = open(pane_mass=mass), open(pane_mass=mass, faults=[hand(**settings)])
    under.clock.sleep(1.0)
    return response(bare), response(under)


def test_the_mean_finger_changes_the_paper_s_pane_as_the_prototype_did(open):
    """At the antinode of the main mode: 1.7 dB less at the resonance at 1 N, 3.1 dB at 5 N."""
    rig = open()
    surface = rig.simulation.truth.surface
    modes = surface.modes(0.0)
    place = (0.25, 0.25)
    at = np.linspace(255, 272, 2000)
    bare = np.abs(modes.velocity("A", place, at)).max()
    for force, least, most in ((1.0, 1.2, 2.2), (5.0, 2.4, 3.8)):
        surface.touched(Fingertip().at("finger", place, force))
        lost = 20 * np.log10(bare / np.abs(surface.response("A", place, at, 0.0)).max())
        assert least < lost < most
    surface.touched(())


@pytest.mark.long
def test_a_finger_is_more_to_a_light_pane_and_a_palm_more_than_a_finger(open):
    def change(**settings):
        bare, under = changed(open, **settings)
        return float(np.linalg.norm(under - bare) / np.linalg.norm(bare))

    heavy, third, light = (change(mass=mass, force=1.0) for mass in (0.96, 0.32, 0.096))
    assert 0.03 < heavy < 0.2 and 1.8 * heavy < third and 1.5 * third < light
    assert change(force=0.25) < heavy < change(force=5.0) < change(force=5.0, palm=True)
    assert np.all(changed(open)[0] == changed(open, mass=0.096)[0])


@pytest.mark.long
def test_people_differ_and_the_same_seed_is_the_same_person(open):
    def under(participant, **settings):
        return changed(open, participant=participant, **settings)[1]

    assert np.all(under("P01") == under("P01"))
    assert np.linalg.norm(under("P02") - under("P01")) > 0.01 * np.linalg.norm(under("P01"))


@pytest.mark.long
def test_a_hand_comes_and_leaves_in_the_middle_of_a_play(open, unproved):
    """What the laser shows is what the surface does: bare, then less, then bare again."""
    seen = []
    t = np.arange(75_000) / 50_000
    drive = 20 * np.sin(2 * np.pi * 263.5 * t) * np.minimum(1, np.minimum(t, t[-1] - t) / 0.1)
    for faults in ([], [hand(after=1.0, duration=0.2, force=5.0)]):
        rig = open(vibrometer_noise_scale=0, pane_mass=0.3, faults=faults)
        rig.clock.sleep(0.5)
        played = rig.simulation.truth.record()
        shown = rig.vibrometer.to_si(rig.excite(drive, ["A"], ["laser"]).volts[0])
        begin = next(part.start for part in played if part.volts.any())
        own = rig.simulation.truth.velocity("button", begin + t)
        seen.append((np.abs(own), np.abs(shown)))
        assert [fault.fired for fault in rig.simulation.faults] == [1] * len(faults)
    (bare, bare_shown), (under, shown) = seen
    early, during, late = slice(5000, 22_000), slice(32_000, 36_000), slice(62_000, 69_000)
    for one, other in ((bare, under), (bare_shown, shown)):
        assert np.abs(other[early] - one[early]).max() < 1e-6 * one.max()
        assert other[during].max() < 0.75 * one[during].max()
        assert other[late].max() == pytest.approx(one[late].max(), rel=0.01)


def test_a_simulated_operator_rests_and_lifts_a_finger(open):
    rig = open(pane_mass=0.3)
    bare = response(rig)
    assert rig.operator.confirm(RestFinger("P01", "button", 1.0))
    rig.clock.sleep(0.5)
    under = response(rig)
    assert np.linalg.norm(under - bare) > 0.1 * np.linalg.norm(bare)
    assert rig.operator.confirm(LiftFinger())
    rig.clock.sleep(0.5)
    np.testing.assert_allclose(response(rig), bare)


def test_what_cannot_carry_a_hand_refuses_it_when_the_rig_is_opened(open):
    raises(ConfigurationError, "Nothing can rest", open, faults=[hand(after=5.0)], softening=0.02)
    with pytest.raises(ConfigurationError, match="tells no masses"):
        open(plant=random_modal(np.random.default_rng(1)), faults=[hand()])
    raises(ConfigurationError, r'give "button" or the number', open, faults=[hand(point="somewhere")])
