"""Modes that bodies couple, against a full solution of their whole matrix."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from haploop.mocks.plant import Contact, Fingertip, Modes
from haploop.mocks.plant.table import make_plate
from haploop.mocks.plant.touched import Coupled, touched_velocity
from haploop.mocks.plant.touches import Palm

LAID = {
    "nothing": (),
    "a finger": Fingertip().at("finger", (0.31, 0.42), 1.0),
    "a finger that comes": Fingertip().at("finger", (0.31, 0.42), 0.01),
    "a finger on nodes": Fingertip().at("finger", (0.5, 0.5), 5.0),
    "a finger at the edge": Fingertip().at("finger", (0.0, 0.5), 1.0),
    "a palm": Palm().at("palm", (0.4, 0.6), 5.0),
    "a palm across nodes": Palm().at("palm", (0.25, 0.5), 0.01),
    "two people": (*Palm(1.5).at("palm", (0.7, 0.3), 5.0), *Fingertip().at("finger", (0.5, 0.5), 2.0)),
    "a damper": (Contact("damper", (0.31, 0.42), 100.0, 30.0, 0.01),),
}


def pane(highest_hz: float, mass: float, seed: int = 3) -> Modes:
    plate = make_plate(np.random.default_rng(seed), highest_hz=highest_hz)
    return replace(plate, masses=np.full(len(plate.natural_hz), mass / 4))


def whole(modes: Modes, contacts: Sequence[Contact]) -> np.ndarray:
    """A of X' = A X, of displacements of modes and bodies and then their velocities."""
    assert modes.masses is not None
    w, count, n = 2 * np.pi * modes.natural_hz, len(modes.natural_hz), len(modes.natural_hz) + len(contacts)
    mass = np.concatenate([modes.masses, [one.mass for one in contacts]])
    stiffness, damping = np.zeros((n, n)), np.zeros((n, n))
    stiffness[:count, :count] = np.diag(modes.masses * w**2)
    damping[:count, :count] = np.diag(modes.masses * 2 * modes.damping * w)
    for k, one in enumerate(contacts):
        across = np.zeros(n)
        across[:count], across[count + k] = modes.shape(one.place), -1.0
        stiffness += one.stiffness * np.outer(across, across)
        damping += one.damping * np.outer(across, across)
    below = np.concatenate([-stiffness, -damping], axis=1) / mass[:, None]
    return np.concatenate([np.eye(2 * n)[n:], below])


@pytest.mark.long
@pytest.mark.parametrize("laid", LAID)
@pytest.mark.parametrize(("highest_hz", "mass"), [(843.2, 0.96), (10_000.0, 0.96), (10_000.0, 0.02)])
def test_few_bodies_couple_many_modes_as_the_whole_matrix_does(laid, highest_hz, mass):
    modes, contacts = pane(highest_hz, mass), LAID[laid]
    count, n = len(modes.natural_hz), len(modes.natural_hz) + len(contacts)
    matrix = whole(modes, contacts)
    poles, vectors, inverse = Coupled(modes, contacts).solved()
    want = np.linalg.eigvals(matrix)
    assert 2 * np.sum(poles.imag > 0) + np.sum(poles.imag == 0) == 2 * n
    far = np.abs(poles[:, None] - want).min(axis=1) / np.abs(poles)
    assert far.max() < 1e-9
    # Every state is told by the poles, and comes back.
    assert np.abs((vectors @ inverse).real - np.eye(2 * n))[:n, :n].max() < 1e-7
    place, f = (0.62, 0.37), np.array([0.0, 40.0, 263.0, 264.0, 700.0, 5000.0, 9000.0])
    forces = np.zeros((2 * n, 4))
    forces[n : n + count] = np.array(list(modes.coupling.values())).T
    told = np.array(list(touched_velocity(modes, contacts, place, f).values()))
    row = np.concatenate([np.zeros(n), modes.shape(place), np.zeros(len(contacts))])
    solved = np.array([row @ np.linalg.solve(2j * np.pi * hz * np.eye(2 * n) - matrix, forces) for hz in f]).T
    by_poles = np.zeros(solved.shape, dtype=np.complex128)
    for s, left, right in zip(poles, row @ vectors, inverse @ forces, strict=True):
        share = left * right[:, None] / 2
        by_poles += share / (2j * np.pi * f - s) + share.conj() / (2j * np.pi * f - s.conj())
    for found in (told, by_poles):
        assert np.abs(found - solved).max() < 1e-9 * np.abs(solved).max()


def test_a_root_that_is_met_exactly_is_one():
    """One finger in 300 on this table met one, where the small matrix cannot be solved."""
    rng = np.random.default_rng(43)
    modes = pane(10_000.0, 0.96, 0)
    for _ in range(12):
        (x, y), force = rng.uniform(0.02, 0.98, 2), float(rng.uniform(0.01, 8))
        poles, _, _ = Coupled(modes, Fingertip.of(rng).at("finger", (x, y), force)).solved()
        assert 2 * len(poles) == 2 * (236 + 1)
