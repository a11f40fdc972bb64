"""Shared poles from plays that neither settle nor are told apart, against modes that are known."""

import numpy as np
import pytest

from haploop.calibration.response.excitation import Multisine
from haploop.calibration.response.modes import Modes, Plays, fit_modes

HZ = np.array([66.0, 134.0, 236.0, 263.5, 410.0, 590.0])
POLES = 2 * np.pi * HZ * (1j - 0.008)
PERIOD = 1.0
LINES = np.arange(15, 626)
F = LINES / PERIOD


def made(own: int, of: int, points: int, noise: float, rng: np.random.Generator) -> tuple[Plays, np.ndarray]:
    """Plays of `of` patches at once (from the patch `own` on), and the responses that they show."""
    s = 2j * np.pi * F
    near, mirror = 1 / (s[:, None] - POLES), 1 / (s[:, None] - POLES.conj())

    def modal() -> np.ndarray:
        r = 1e-3 * (rng.normal(size=(points, len(POLES))) + 0.1j * rng.normal(size=(points, len(POLES))))
        return np.asarray((near @ r.T + mirror @ r.conj().T).T)

    inputs, responses = [], []
    for patch in range(of):
        lines = Multisine(period=PERIOD, lines=(patch, of) if of > 1 else "odd").excited()
        linear_volts = np.zeros(len(F), dtype=np.complex128)
        excited = np.isin(LINES, lines)
        linear_volts[excited] = np.exp(2j * np.pi * rng.random(int(excited.sum())))
        inputs.append(linear_volts)
        responses.append(modal())
    velocity = sum(x * H for x, H in zip(inputs, responses, strict=True)) + 0.3 * modal()
    velocity = velocity + noise * np.std(velocity) * (
        rng.normal(size=velocity.shape) + 1j * rng.normal(size=velocity.shape)
    )
    patches = tuple(range(own, own + of))
    return Plays(F, patches, np.array(inputs)[:, None], velocity.T), np.array(responses)


@pytest.mark.parametrize("together", [False, True])
def test_modes_are_found_though_the_table_still_rings(together):
    rng = np.random.default_rng(1)
    groups = [made(0, 3, 10, 0.01, rng)] if together else [made(k, 1, 10, 0.01, rng) for k in range(3)]
    modes = fit_modes([plays for plays, _ in groups], 3)
    nearest = np.abs(np.abs(modes.poles)[:, None] / (2 * np.pi) - np.abs(POLES) / (2 * np.pi)).min(axis=0)
    assert nearest.max() < 0.05
    for plays, true in groups:
        shares, left = modes.shares(plays)
        found = modes.velocity(np.swapaxes(shares, 1, 2), F)
        assert np.linalg.norm(found - true) / np.linalg.norm(true) < 0.006
        assert np.all(left < 0.04)


def test_no_pole_is_unstable():
    plays, _ = made(0, 1, 4, 0.3, np.random.default_rng(2))
    modes = fit_modes([plays], 1)
    assert isinstance(modes, Modes) and np.all(modes.poles.real < 0)
