"""Responses made for comparisons of fits, from numbers that nobody chose: plates and free beams.

A beam resembles a measured one: resonances narrower than its lines, rigid-body motion, and an error that
grows with the response, as an estimate from a few hammer blows has.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np

from haploop.calibration import Response


@dataclass(frozen=True, eq=False)
class Case:
    """A response as measured, its true velocity, and the true natural frequencies within its band (Hz).

    Those within the last three lines of a beam's band are left out.
    """

    response: Response
    truth: np.ndarray
    natural: np.ndarray


def generator(*names: object) -> np.random.Generator:
    """Random numbers from the hash of names."""
    return np.random.default_rng(int.from_bytes(hashlib.sha256(repr(names).encode()).digest()[:8], "big"))


def response_of(f: np.ndarray, velocity: np.ndarray, sigma: float = 0.0) -> Response:
    """Response at `f` (Hz) with a standard deviation, if it is known."""
    ones = np.ones(len(f))
    return Response(
        patch="A",
        point="button",
        frequencies=f,
        velocity=velocity,
        deviation=sigma * ones if sigma else np.zeros(0),
        coherence=ones,
        path=ones.astype(complex),
        noise=1e-7 * ones,
        distortion=np.zeros((0, 0)),
        repeats=3,
        level=48.0,
        levels=np.zeros(0),
        level_gain=np.zeros(0, complex),
        pickup_range=0.02,
        excitation="made for a comparison; 0.0 s of measuring",
        source="measured",
        rig="made for a comparison",
        rig_file="",
        simulated=True,
        created="2026-01-01T00:00:00+00:00",
    )


def _noise(rng: np.random.Generator, count: int) -> np.ndarray:
    return (rng.standard_normal(count) + 1j * rng.standard_normal(count)) / np.sqrt(2)


def plate(number: int, modes: int = 12, snr_db: float = 37.0, lines: int = 1228) -> Case:
    """Modes from 40 to 700 Hz, damped by 0.5 to 2 %, one of them 2.5 to 7.5 times as strong as others."""
    rng = generator("plate", number)
    natural = np.linspace(45, 690, modes) + rng.uniform(-180, 180, modes) / modes
    damping = rng.uniform(0.005, 0.02, modes)
    strength = rng.uniform(0.2, 0.6, modes) * rng.choice([-1, 1], modes)
    strength[modes // 3] = 1.5
    f = np.linspace(20, 620, lines)
    s, w = 2j * np.pi * f[:, None], 2 * np.pi * natural
    truth = 5e-5 * (strength * 2 * damping * w * s / (s**2 + 2 * damping * w * s + w**2)).sum(axis=1)
    sigma = float(np.sqrt(np.mean(np.abs(truth) ** 2)) * 10 ** (-snr_db / 20))
    inside = natural[(natural > f[0]) & (natural < f[-1])]
    return Case(response_of(f, truth + sigma * _noise(rng, lines), sigma), truth, inside)


def beam(number: int) -> Case:
    """Free beam, 10 to 999 Hz in steps of 1 Hz; every third one is driven where it is measured.

    Natural frequencies go as the squares below (Blevins, Formulas for Natural Frequency and Mode Shape, table
    8-1), damping is 0.01 to 0.06 %, and each line is wrong by 0.3 to 3 % of itself, half of it alike at
    neighbouring lines.
    """
    rng = generator("beam", number)
    beta = np.array([4.730, 7.853, 10.996, 14.137, 17.279, 20.420, 23.562, 26.704])
    natural = rng.uniform(45, 60) * (beta / beta[0]) ** 2 * (1 + rng.normal(0, 0.003, 8))
    damping = rng.uniform(1e-4, 6e-4, 8)
    shapes = rng.uniform(0.3, 1, (2, 8)) * rng.choice([-1, 1], (2, 8))
    collocated = number % 3 == 0
    product = shapes[0] * shapes[0 if collocated else 1]
    f = np.arange(10, 1000.0)
    s, w = 2j * np.pi * f[:, None], 2 * np.pi * natural
    modal = (product * s**2 / (s**2 + 2 * damping * w * s + w**2)).sum(axis=1)
    truth = modal + rng.uniform(0.2, 1) * (1 if collocated else rng.choice([-1, 1]))
    level = 10 ** rng.uniform(-2.5, -1.5)
    alike = np.convolve(_noise(rng, len(f)), np.ones(3) / np.sqrt(3), "same")
    off = level / np.sqrt(2) * np.abs(truth) * (alike + _noise(rng, len(f)))
    off = off + level / 4 * np.median(np.abs(truth)) * _noise(rng, len(f))
    to_velocity = 2j * np.pi * f
    return Case(response_of(f, (truth + off) / to_velocity), truth / to_velocity, natural[natural < f[-4]])
