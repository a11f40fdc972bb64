from __future__ import annotations

import numpy as np
import pytest

from calibration import Response, fit
from instruments import DataError


def plate(seed: int, damping_scale: float = 1.0, snr_db: float = 37.0) -> tuple[Response, np.ndarray, float]:
    """Twelve modes from 40 to 700 Hz, damped by 0.5 to 2 %, the strongest at 263.5 Hz.

    Returns the response as measured, the true velocity, and the strongest mode's frequency.
    """
    rng = np.random.default_rng(seed)
    natural = np.linspace(45, 690, 12) + rng.uniform(-15, 15, 12)
    natural[4] = 263.5 + rng.uniform(-1, 1)
    damping = rng.uniform(0.005, 0.02, 12) * damping_scale
    residues = rng.uniform(0.2, 0.6, 12) * rng.choice([-1, 1], 12)
    residues[4] = 1.5
    # Residues per decay, so that they are the peaks' heights.
    strength = residues * 2 * damping * 2 * np.pi * natural
    f = np.arange(20, 620, 1 / 8.2)
    s, w = 2j * np.pi * f[:, None], 2 * np.pi * natural
    truth = (strength * s / (s**2 + 2 * damping * w * s + w**2)).sum(axis=1) * 5e-5
    sigma = np.sqrt(np.mean(np.abs(truth) ** 2)) * 10 ** (-snr_db / 20)
    noise = sigma / np.sqrt(2) * (rng.standard_normal(len(f)) + 1j * rng.standard_normal(len(f)))
    ones = np.ones(len(f))
    measured = Response(
        patch="A",
        point="button",
        frequencies=f,
        velocity=truth + noise,
        deviation=sigma * ones,
        coherence=ones,
        path=ones.astype(complex),
        noise=1e-7 * ones,
        repeats=3,
        level=48.0,
        levels=np.zeros(0),
        level_gain=np.zeros(0, complex),
        velocity_range=0.02,
        rig="made for a test",
        rig_file="{}",
        simulated=True,
        created="2026-01-01T00:00:00+00:00",
    )
    return measured, np.asarray(truth), float(natural[4])


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    ("damping_scale", "snr_db", "error"), [(1, 37, 0.004), (3, 37, 0.004), (1, 27, 0.012)]
)
def test_the_model_averages_the_noise(seed: int, damping_scale: float, snr_db: float, error: float) -> None:
    response, truth, strongest = plate(seed, damping_scale, snr_db)
    model = fit(response)
    assert model.stable
    assert np.linalg.norm(model.velocity(response.frequencies) - truth) < error * np.linalg.norm(truth)
    assert model.resonance_hz == pytest.approx(strongest, abs=0.3)
    # It says how far it is from what was measured, which is the noise.
    assert model.error == pytest.approx(10 ** (-snr_db / 20), rel=0.1)


def test_resonances_are_the_modes() -> None:
    response, _, strongest = plate(3)
    resonance = max(fit(response).resonances, key=lambda r: r.strength)
    assert resonance.frequency_hz == pytest.approx(strongest, abs=0.05)
    rng = np.random.default_rng(3)
    rng.uniform(-15, 15, 12)
    rng.uniform(-1, 1)
    assert resonance.damping == pytest.approx(rng.uniform(0.005, 0.02, 12)[4], rel=0.02)
    assert resonance.strength == pytest.approx(1.5 * 5e-5, rel=0.03)


def test_noise_alone_is_stable_or_refused() -> None:
    response, _, _ = plate(0, snr_db=-40)
    try:
        model = fit(response)
    except DataError as error:
        assert "resonance" in str(error)
    else:
        assert model.stable
        assert model.error > 0.8
