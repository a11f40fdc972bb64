"""Fingers on a pane whose modes are known, without a rig: every response is exact, to the last digit."""

import zlib
from dataclasses import dataclass, replace

import numpy as np
import pytest

from haploop.base.errors import ConfigurationError, DataError
from haploop.calibration import Calibration, Finger
from haploop.calibration.model import PlateModes, at_force, under_finger
from haploop.calibration.model.finger_finding import Look, find_finger
from haploop.calibration.model.model import fit
from haploop.calibration.response import Response
from haploop.calibration.response.response import LINEAR
from haploop.instruments.operator import RestFinger
from haploop.mocks.plant import Fingertip, Modes, Palm
from haploop.mocks.plant.surface import Contact
from haploop.mocks.plant.touched import touched_velocity
from haploop.mocks.plant.touches import Hand
from tests.raising import raises

F = np.arange(60.0, 640.0, 1.0)
BAND = (F >= 75) & (F <= 600)
PLACES = {"button": (0.31, 0.37), "21": (0.36, 0.37), "22": (0.68, 0.30)}


def shape(place: tuple[float, float]) -> np.ndarray:
    """Six modes of a pane that rests on its edges; their mean square over the pane is one."""
    across, along = (np.sin(np.pi * np.arange(1, 4)[:, None] * at)[:, 0] for at in place)
    pairs = ((0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (2, 1))
    return np.array([2 * across[m] * along[n] for m, n in pairs])


@dataclass(frozen=True)
class Pane:
    """Its modes, and what a calibration of it holds."""

    modes: Modes
    bare: Calibration

    def response(self, contacts: tuple[Contact, ...] = (), point: str = "button") -> Response:
        velocity = touched_velocity(self.modes, contacts, PLACES[point], F)["A"]
        return replace(self.bare.response, velocity=velocity, point=point)

    def found(self, contacts: tuple[Contact, ...], unlike: float = 0.0, seed: int = 1) -> Finger:
        """The finger by the response at its point, of which `unlike`, over the change, no finger explains."""
        under = self.response(contacts)
        rng, size = (
            np.random.default_rng(seed),
            np.linalg.norm((under.velocity - self.bare.response.velocity)[BAND]),
        )
        other = rng.standard_normal(len(F)) + 1j * rng.standard_normal(len(F))
        spoilt = under.velocity + unlike * size * other / np.linalg.norm(other[BAND])
        look = Look(self.bare.response, replace(under, velocity=spoilt))
        return find_finger(self.bare, [look], RestFinger("P07", "button", 1.0))

    def factor(self, force: float) -> np.ndarray:
        """What the finger makes of the response, (lines,), by the plant."""
        under = self.response(tip(force)).velocity
        return np.asarray((under / self.bare.response.velocity)[BAND])


def pane(mass: float) -> Pane:
    hz, damping = np.array([96.0, 171.0, 243.0, 322.0, 401.0, 533.0]), np.array([9, 7, 8, 11, 9, 10]) * 1e-3
    force = {"A": np.array([0.9, 1.1, -1.6, 0.7, 1.2, -0.8]) * 1e-2}
    modes = Modes(hz, damping, force, shape, masses=np.full(6, mass))
    none, empty = np.zeros(0), np.zeros(0, complex)
    velocity = modes.velocity("A", PLACES["button"], F)
    response = Response(
        "A", "button", F, velocity, 1e-4 * np.abs(velocity), none, np.ones(len(F), complex), none,
        np.zeros((0, 0)), 1, 50.0, none, empty, 0.1, "exact", "by hand", "none", "", True, "2026-11-25",
    )  # fmt: skip
    return Pane(modes, Calibration(response, fit(response), LINEAR, 20000.0))


@pytest.fixture(scope="module")
def light() -> Pane:
    return pane(0.2)


@pytest.fixture(scope="module")
def heavy() -> Pane:
    return pane(0.96)


def relative(found: np.ndarray, true: np.ndarray) -> float:
    return float(np.linalg.norm(found - true) / np.linalg.norm(true))


def tip(force: float = 1.0, place: str = "button") -> tuple[Contact, ...]:
    return Fingertip().at("a finger", PLACES[place], force)


def test_a_finger_is_found_and_follows_its_law_to_other_forces(light):
    found = light.found(tip())
    for force in (0.25, 1.0, 4.0):
        assert relative(found.factor(F[BAND], force), light.factor(force)) < 0.01, force
    assert found.misfit < 0.002 and found.force == 1.0
    # Z of the theory: r = k / c and d = c / m.
    assert found.stiff == pytest.approx(1300 / 1.8, rel=0.2) and found.slow == pytest.approx(300, rel=0.2)
    bare = light.bare.response.velocity[BAND]
    assert found.changed == pytest.approx(relative(light.factor(1.0) * bare, bare), rel=0.02)


def test_what_no_fingertip_explains_is_refused_beyond_its_limit(light, heavy):
    """3 % of what the finger changed, and 0.4 % of the response for noise."""
    for one, force, least, most in ((light, 1.0, 0.02, 0.025), (heavy, 0.1, 0.06, 0.08)):
        kept = one.found(tip(force), least)
        limit = 0.03 * kept.changed + 0.004
        assert 0.8 * limit < kept.misfit < limit
        raises(DataError, r"leaves .* of it unexplained", one.found, tip(force), most)


def test_a_palm_and_two_fingers_are_refused_on_a_light_pane(light):
    two = (*tip(), *Fingertip().at("another", (0.62, 0.55), 1.0))
    for hands in (Palm().at("a palm", PLACES["button"], 5.0), two):
        raises(DataError, "unexplained", light.found, hands)


@pytest.mark.long
def test_a_palm_is_too_heavy_for_a_fingertip_where_it_looks_like_one(heavy):
    rng = np.random.default_rng(zlib.crc32(b"larch button"))
    for force in (0.5, 5.0):
        palm = Palm.of(rng).at("a palm", PLACES["button"], force)
        raises(DataError, "heavier than a fingertip, as a palm is", heavy.found, palm)
        for _ in range(2):
            assert heavy.found(Fingertip.of(rng).at("a finger", PLACES["button"], force)).misfit < 0.01


def test_nothing_is_no_finger_and_the_lightest_is_one(heavy):
    with pytest.raises(DataError, match=r"Nothing seems to rest .* P07 rests a fingertip"):
        heavy.found(Fingertip(13.0, 0.018, 6e-5).at("a crumb", PLACES["button"], 1.0))
    crumb = Fingertip(65.0, 0.09, 3e-4).at("five of them", PLACES["button"], 1.0)
    assert 0.015 < heavy.found(crumb).changed < 0.025


@pytest.mark.long
def test_the_uncertainty_is_that_of_a_hand_that_wanders(light, heavy):
    """With an exact response nothing else is left: 3 % of the force that was held for two seconds."""
    for one, force in ((light, 1.0), (light, 5.0), (heavy, 1.0)):
        found, bare = one.found(tip(force)), one.bare.response.velocity[BAND]
        low, high = (one.factor(share * force) * bare for share in (0.969, 1.031))
        wanders = float(np.linalg.norm(high - low) / 2 / np.linalg.norm(one.factor(force) * bare))
        assert found.uncertainty == pytest.approx(wanders, rel=0.05)
    spoilt, found = light.found(tip(), 0.015), light.found(tip())
    assert spoilt.uncertainty == pytest.approx(np.hypot(spoilt.misfit, found.uncertainty), rel=0.1)


@pytest.mark.night
def test_people_s_fingers_are_as_far_off_as_is_stated():
    """Each holds a force that wanders; the truth is the pane's at the force that was asked for."""
    seed, over = zlib.crc32(b"alder thimble"), []
    for number, mass in enumerate((0.24, 0.1, 0.03)):
        one = pane(mass)
        for person in range(8):
            rng = np.random.default_rng([seed, number, person])
            who, force = Fingertip.of(rng), float(rng.choice([0.25, 1.0, 5.0]))
            held = Hand("a finger", who, PLACES["button"], force, 0.0, rng)
            mean = float(held.felt(1 + rng.uniform(0, 60) + np.linspace(0, 2.05, 100)).mean())
            seen, true = (one.response(who.at("", PLACES["button"], f)) for f in (mean, force))
            look = Look(one.bare.response, seen)
            found = find_finger(one.bare, [look], RestFinger("P07", "button", force))
            bare = one.bare.response.velocity[BAND]
            over.append(relative(found.factor(F[BAND]) * bare, true.velocity[BAND]) / found.uncertainty)
    assert 0.75 < float(np.sqrt(np.mean(np.square(over)))) < 1.35


@pytest.mark.parametrize("mapped", [False, True])
def test_what_is_seen_beside_tells_of_the_finger_s_own_point(light, mapped):
    points = tuple(PLACES)
    poles = (
        2 * np.pi * light.modes.natural_hz * (-light.modes.damping + 1j * np.sqrt(1 - light.modes.damping**2))
    )
    shapes = np.array([shape(PLACES[point]) for point in points]).T
    plate = PlateModes(("20", *points[1:]), "20", poles, shapes, np.full(3, 0.01)) if mapped else None
    looks = [Look(light.response((), point), light.response(tip(), point)) for point in points[1:]]
    found = find_finger(light.bare, looks, RestFinger("P07", "button", 1.0), plate)
    assert relative(found.factor(F[BAND]), light.factor(1.0)) < 0.01
    assert found.beside == ("21", "22") and found.mapped is mapped
    if plate is None:
        return
    # A table drifts after its map was measured.
    drifted = replace(plate, poles=1.02 * plate.poles)
    again = find_finger(light.bare, looks, RestFinger("P07", "button", 1.0), drifted)
    assert relative(again.factor(F[BAND]), light.factor(1.0)) < 0.01
    # What the map leaves of the points' motion, once here and once there, is how well ratios are known.
    worse = replace(plate, residual=np.full(3, 0.1))
    told = find_finger(light.bare, looks, RestFinger("P07", "button", 1.0), worse).uncertainty
    assert told > 2 * found.uncertainty


def test_beside_the_finger_a_tenth_may_be_left(light):
    rng = np.random.default_rng(2)

    def looked(unlike: float) -> Finger:
        looks = []
        for point in ("21", "22"):
            bare, under = light.response((), point), light.response(tip(), point)
            other = rng.standard_normal(len(F)) + 1j * rng.standard_normal(len(F))
            size = np.linalg.norm((under.velocity - bare.velocity)[BAND]) / np.linalg.norm(other[BAND])
            looks.append(Look(bare, replace(under, velocity=under.velocity + unlike * size * other)))
        return find_finger(light.bare, looks, RestFinger("P07", "button", 1.0))

    assert looked(0.055).beside == ("21", "22")
    raises(DataError, "unexplained", looked, 0.08)


@pytest.mark.long
def test_a_force_that_no_fingertip_rests_with_has_no_response(light):
    made = under_finger(light.bare, light.found(tip()))
    for force in (0.0, -1.0, float("nan"), 30.0):
        raises(ConfigurationError, r"rests with 0\.1 to 20 N", at_force, made, force)
    assert at_force(made, 0.1).finger is not None


@pytest.mark.long
def test_a_calibration_at_another_force_is_of_one_finger_and_can_be_taken_back(light):
    made = under_finger(light.bare, light.found(tip()))
    firm = at_force(made, 4.0)
    assert made.finger is not None and firm.finger is not None and firm.finger.force == 4.0
    bare = light.bare.response.velocity
    assert np.allclose(firm.response.velocity, made.finger.factor(F, 4.0) * bare, rtol=1e-9)
    assert np.allclose(firm.finger.factor(F), made.finger.factor(F, 4.0), rtol=1e-9)
    assert np.allclose(at_force(firm, 1.0).response.velocity, made.response.velocity, rtol=1e-9)


def test_a_real_pole_is_no_mode_that_a_finger_loads(light):
    found = light.found(tip())
    more = replace(found, poles=np.append(found.poles, -600.0), load=np.append(found.load, 1e3))
    assert np.array_equal(more.factor(F), found.factor(F))
