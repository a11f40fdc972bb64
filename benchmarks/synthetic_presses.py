"""Presses whose template is known, and how far an estimate is from it.

Two families that share nothing but the idea of a click, neither of them built from the warps that the
product fits. "tempo" is the one that the product's settings were chosen on (seeds 0 to 2); "hands" and
every other seed were held out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import least_squares
from scipy.signal import lfilter

__all__ = ["FAMILIES", "RATE", "Family", "Presses", "chance", "error", "shape_error", "spectrum_error"]

Curve = NDArray[np.float64]
Event = tuple[float, float, float, float]
"""s from the activation, Hz, m/s^2, decay in s."""

RATE = 5000.0
TIMES = (np.arange(2000) - 600) / RATE


@dataclass(frozen=True, eq=False)
class Presses:
    """`curves` is (participants, presses, samples)."""

    curves: Curve
    template: Curve
    limit: Curve
    """Best possible estimate, with the warps known: the template at the mean of their times, with the
    noise left in the mean. (Without a warp, the template.)"""


@dataclass(frozen=True)
class Family:
    """One way that presses come about."""

    template: Callable[[Curve, Curve], Curve]
    """At times (s), with one delay (s) an event."""
    events: int
    shifts: Callable[[np.random.Generator, int, int, float], Curve]
    """(participants, presses, samples) s, zero at the activation, for a relative change of tempo."""
    noise: Callable[[np.random.Generator, tuple[int, ...]], Curve]
    """Noise of unit variance."""
    loudness: float
    """Relative scatter of the amplitude."""

    def warped(
        self, seed: int, participants: int = 12, presses: int = 10, stretch: float = 0.05, noise: float = 0.05
    ) -> Presses:
        """Presses whose tempo changes smoothly and differently."""
        rng = np.random.default_rng(seed)
        shifts = self.shifts(rng, participants, presses, stretch)
        still = np.zeros(self.events)
        clean = np.array([[self.template(TIMES + s, still) for s in one] for one in shifts])
        # When each instant of the template came, on the mean of all presses.
        came = np.mean([np.interp(TIMES, TIMES + s, TIMES) for one in shifts for s in one], axis=0)
        at_mean = self.template(np.interp(TIMES, came, TIMES), still)
        return self._heard(rng, clean, self.template(TIMES, still), at_mean, noise)

    def jittered(
        self, seed: int, participants: int = 12, presses: int = 10, jitter: float = 0.006, noise: float = 0.05
    ) -> Presses:
        """Presses whose events come early or late (s), each on its own."""
        rng = np.random.default_rng(seed)
        delays = rng.normal(0, jitter, (participants, presses, self.events))
        clean = np.array([[self.template(TIMES, d) for d in one] for one in delays])
        at_mean = self.template(TIMES, delays.mean(axis=(0, 1)))
        return self._heard(rng, clean, self.template(TIMES, np.zeros(self.events)), at_mean, noise)

    def _heard(
        self, rng: np.random.Generator, clean: Curve, template: Curve, at_mean: Curve, noise: float
    ) -> Presses:
        level = noise * float(np.std(template))
        loud = np.exp(self.loudness * rng.standard_normal((*clean.shape[:2], 1)))
        added = level * self.noise(rng, clean.shape)
        return Presses(loud * clean + added, template, loud.mean() * at_mean + added.mean(axis=(0, 1)))


def error(curve: Curve, truth: Curve) -> float:
    """Normalised root mean square error."""
    return float(np.sqrt(np.mean((curve - truth) ** 2) / np.mean(truth**2)))


def shape_error(curve: Curve, truth: Curve) -> float:
    """The error that is left once the best smooth warp is taken away: a shift on 14 monotone knots.

    Fitted from several starts, each event's own lag among them, for a click is a trap for small steps.
    """
    knots = np.linspace(TIMES[0], TIMES[-1], 14)
    spline = CubicSpline(TIMES, curve)
    scale = float(np.sqrt(np.mean(truth**2) * len(truth)))

    def shift(values: Curve) -> Curve:
        return np.asarray(PchipInterpolator(knots, values)(TIMES))

    def rest(values: Curve) -> Curve:
        moved = spline(np.clip(TIMES + 1e-3 * shift(values), TIMES[0], TIMES[-1]))
        # So little that it only keeps knots in silence where they are.
        return np.concatenate([(moved - truth) / scale, 1e-3 * np.diff(values)])

    starts = [np.zeros(14), 1e3 * _lags(curve, truth, knots)]
    best = min(
        (least_squares(rest, start, diff_step=1e-3, max_nfev=60).x for start in starts),
        key=lambda x: float(np.sum(rest(x) ** 2)),
    )
    return float(np.linalg.norm(rest(best)[: len(TIMES)]))


def spectrum_error(curve: Curve, truth: Curve) -> float:
    """Root mean square error of the amplitudes in third-octave bands from 50 to 1000 Hz, relative."""
    frequencies = np.fft.rfftfreq(len(TIMES), 1 / RATE)
    edges = 50 * 2 ** (np.arange(14) / 3)
    power = np.array([np.abs(np.fft.rfft(c)) ** 2 for c in (curve, truth)])
    bands = np.array([(frequencies >= a) & (frequencies < b) for a, b in pairwise(edges)])
    mine, true = np.sqrt(power @ bands.T)
    return float(np.linalg.norm(mine - true) / np.linalg.norm(true))


def _lags(curve: Curve, truth: Curve, knots: Curve) -> Curve:
    """Delay (s) of the curve around each knot, by cross-correlation within 20 ms."""
    half, reach = round(0.03 * RATE), round(0.02 * RATE)
    padded = np.pad(curve, half + reach)
    lags = []
    for knot in knots:
        middle = int(np.argmin(np.abs(TIMES - knot)))
        piece = np.pad(truth, half)[middle : middle + 2 * half] * np.hanning(2 * half)
        near = padded[middle : middle + 2 * half + 2 * reach]
        lags.append(int(np.argmax(np.correlate(near, piece))) - reach if piece @ piece > 1e-6 else 0)
    return np.asarray(lags) / RATE


def _ring(times: Curve, event: Event) -> Curve:
    at, hz, peak, decay = event
    since = np.maximum(times - at, 0)
    return np.asarray(
        peak * (1 - np.exp(-since / 3e-4)) * np.exp(-since / decay) * np.sin(2 * np.pi * hz * since)
    )


_THUD, _SNAP, _EDGE, _RETURN = (
    (-0.05, 180, 6, 0.009),
    (0.0, 235, 10, 0.008),
    (0.004, 405, 4, 0.005),
    (0.18, 235, -5, 0.008),
)


def _tempo_template(times: Curve, delays: Curve) -> Curve:
    """A first click, a snap of two tones, and the return's click."""
    return _crowded_template(times, delays[[0, 1, 1, 2]])


def _crowded_template(times: Curve, delays: Curve) -> Curve:
    """The same, with a snap whose two tones, 4 ms apart, come each on its own."""
    events = (_THUD, _SNAP, _EDGE, _RETURN)
    return np.asarray(sum(_ring(times - d, e) for d, e in zip(delays, events, strict=True)))


def _tempo_shifts(rng: np.random.Generator, participants: int, presses: int, stretch: float) -> Curve:
    """A tempo that is a cubic through seven normal values, of every press anew."""
    knots = np.linspace(TIMES[0], TIMES[-1], 7)
    tempo = CubicSpline(knots, rng.normal(0, stretch, (participants, presses, 7)), axis=-1)(TIMES)
    return _anchored(tempo)


def _hands_template(times: Curve, delays: Curve) -> Curve:
    """A dull thump, a bright two-toned snap that sweeps down, and a rattle."""
    first, second, third = (
        np.maximum(times - at - d, 0) for at, d in zip((-0.07, 0.0, 0.11), delays, strict=True)
    )
    thump = 4 * (first / 0.006) * np.exp(1 - first / 0.006) * np.sin(2 * np.pi * 95 * first)
    sweep = 9 * np.exp(-((second / 0.013) ** 1.5)) * np.sin(2 * np.pi * (320 * second - 2500 * second**2))
    tone = 3 * np.exp(-second / 0.012) * np.sin(2 * np.pi * 145 * second)
    rattle = 5 * np.exp(-third / 0.015) * np.sin(2 * np.pi * 190 * third + 2 * np.sin(2 * np.pi * 37 * third))
    rattle = rattle * np.minimum(third / 0.001, 1)
    return np.asarray(thump + sweep + tone + rattle)


def _hands_shifts(rng: np.random.Generator, participants: int, presses: int, stretch: float) -> Curve:
    """A tempo that is white noise smoothed by 40 ms; half its variance is the participant's own."""

    def tempo(*shape: int) -> Curve:
        smooth = gaussian_filter1d(rng.standard_normal((*shape, 3 * len(TIMES))), 200, axis=-1)
        return np.asarray(smooth[..., len(TIMES) : 2 * len(TIMES)] / np.std(smooth))

    return _anchored(stretch * np.sqrt(0.5) * (tempo(participants, 1) + tempo(participants, presses)))


def _white(rng: np.random.Generator, shape: tuple[int, ...]) -> Curve:
    return rng.standard_normal(shape)


def _coloured(rng: np.random.Generator, shape: tuple[int, ...]) -> Curve:
    """First-order noise with a corner near 500 Hz, as behind an accelerometer's pole."""
    pole = np.exp(-2 * np.pi * 500 / RATE)
    return np.asarray(lfilter([np.sqrt(1 - pole**2)], [1, -pole], rng.standard_normal(shape), axis=-1))


def _anchored(tempo: Curve) -> Curve:
    shift = np.cumsum(tempo, axis=-1) / RATE
    return np.asarray(shift - shift[..., 600][..., None])


def chance(rng: np.random.Generator) -> Family:
    """A button that nobody has seen: 2 to 5 events, 6 to 80 ms apart, of 70 to 420 Hz."""
    count = int(rng.integers(2, 6))
    gaps = np.exp(rng.uniform(np.log(0.006), np.log(0.08), count - 1))
    at = np.cumsum([0.0, *gaps])
    at -= at[rng.integers(0, count)]
    hz = np.exp(rng.uniform(np.log(70), np.log(420), count))
    peak = rng.uniform(3, 10, count) * rng.choice([-1, 1], count)
    events = list(zip(at, hz, peak, np.exp(rng.uniform(np.log(0.004), np.log(0.02), count)), strict=True))

    def template(times: Curve, delays: Curve) -> Curve:
        return np.asarray(sum(_ring(times - d, e) for d, e in zip(delays, events, strict=True)))

    shifts = _tempo_shifts if rng.random() < 0.5 else _hands_shifts
    noise = _white if rng.random() < 0.5 else _coloured
    return Family(template, count, shifts, noise, float(rng.choice([0.0, 0.1])))


FAMILIES = {
    "tempo": Family(_tempo_template, 3, _tempo_shifts, _white, 0.0),
    "hands": Family(_hands_template, 3, _hands_shifts, _coloured, 0.1),
    "crowded": Family(_crowded_template, 4, _tempo_shifts, _white, 0.0),
}
