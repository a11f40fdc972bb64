"""Excitation waveforms to measure the response of a patch, and their durations."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import ceil, exp, log
from typing import Literal

import numpy as np

from ...base.arrays import FloatArray, IntArray
from ...base.errors import ConfigurationError
from ...base.filters import fast_length
from ..spectra import fade

_FADE_IN, _FADE_OUT = 0.1, 0.03
"""Fade times of a sweep (s). A step at its end would excite every mode; at the paper's 89 Hz/s the fade
takes the last 2.7 Hz."""
_RISE = 0.02
"""Fade-in time (s) of a multisine with settling: a step would excite every mode."""
_CLIPPINGS = 300
"""Rounds of crest optimisation: 1.57 on the default lines after these, 1.50 after a thousand."""
_LINES = 1500
"""Lines up to which there are so many rounds; of more lines there are fewer, for as much time."""
_GROUP_ODD, _GROUP = 4, 8
"""Size of the groups of lines in which one line is left out, to measure distortion or noise there."""
_RINGING = 0.15
"""Relative error of a response measured from rest as if it had settled: 0.05 to 0.19 was measured."""
_MOST_PERIODS = 200
_LEAST_SHARE = 0.25
"""Lowest level of a plan over the largest: hysteresis makes a patch differ between few volts and many."""
_LOCAL_GAIN = 0.7
"""Error of the local rational method over that of a plain ratio of one settled period, because it averages
neighbouring lines: 0.45 to 0.62 was measured."""


@dataclass(frozen=True)
class LinearSweep:
    """The paper's excitation: a sine whose frequency rises linearly from 0 to `stop_hz` in `seconds`.

    It is played `repeats` times, then once at each of the fractions `shares` of its level; `tail` seconds
    of silence are recorded after each. Raises ConfigurationError for fewer than two repeats.
    """

    stop_hz: float = 625.0
    """Hz; paper, "Experimental Setup"."""
    seconds: float = 7.0
    tail: float = 1.2
    repeats: int = 3
    shares: tuple[float, ...] = (0.5, 0.25, 0.1)

    def __post_init__(self) -> None:
        if self.repeats < 2:
            raise ConfigurationError("A response needs at least 2 repeats: their difference is its noise.")

    @property
    def duration(self) -> float:
        """Measuring time of all repeats and levels together (s)."""
        return (self.repeats + len(self.shares)) * (self.seconds + self.tail)

    def volts(self, rate_hz: float, peak: float) -> FloatArray:
        """One sweep, (samples,) V. Raises ConfigurationError when it cannot be sampled."""
        return linear_sweep(rate_hz, self.seconds, self.stop_hz, peak)

    def __str__(self) -> str:
        return (
            f"linear sine sweep, 0 to {self.stop_hz:g} Hz in {self.seconds:g} s, {self.repeats} times, "
            f"and at {len(self.shares)} smaller levels; {self.duration:.1f} s of measuring"
        )


@dataclass(frozen=True)
class Multisine:
    """Equally strong sines on lines of 1 / `period` (Hz), from `low` to `high` (Hz).

    Phases start at random (`seed`) and are optimised for a small crest factor, by clipping and
    restoring the amplitudes (Van der Ouderaa, Schoukens and Renneboog, IEEE Trans. Instrum. Meas.
    37, 1988). It starts near zero volts, has zero mean, and ends where it started.

    `lines` are the "odd" ones, so that even distortion falls between them; "all"; or (k, n): every
    n-th of all, from the k-th on, so that n patches can be driven at once on separate lines.
    In every group of four (eight, if not "odd") one random line is left out, to measure odd
    distortion and noise there (Pintelon and Schoukens, System Identification, 2012, chapter 4).

    The first `settle` seconds let the table settle and are discarded; `periods` follow. One
    period without settling is the shortest measurement: the table starts from rest, and the local
    rational method separates the transient from the response. Raises ConfigurationError for a
    period of fewer than 20 lines, or several periods without settling.
    """

    low: float = 15.0
    high: float = 625.0
    period: float = 2.05
    """Seconds. The narrowest resonance should be wider than a line: 1 / period Hz."""
    periods: int = 1
    settle: float = 0.0
    lines: Literal["odd", "all"] | tuple[int, int] = "odd"
    seed: int = 0

    def __post_init__(self) -> None:
        if not (0 < self.low < self.high and (self.high - self.low) * self.period >= 20):
            raise ConfigurationError(
                f"A multisine from {self.low:g} to {self.high:g} Hz with a period of {self.period:g} s has "
                "fewer than 20 lines: make the band wider or the period longer."
            )
        if self.periods < 1 or self.settle < 0 or (self.periods > 1 and self.settle <= 0):
            raise ConfigurationError(
                "A multisine has at least one period, and several need time to settle first (0.8 s, say): "
                "only from one can the start from rest be told apart."
            )
        if not isinstance(self.lines, str) and not 0 <= self.lines[0] < self.lines[1]:
            raise ConfigurationError(
                f"Lines {self.lines} are none: (k, n) takes the k-th of every n, from 0 on."
            )

    @property
    def duration(self) -> float:
        """Measuring time of settling and all periods together (s)."""
        return self.settle + self.periods * self.period

    @property
    def from_rest(self) -> bool:
        """True when it is evaluated from its first sample on."""
        return self.settle == 0

    def excited(self) -> IntArray:
        """Numbers of the excited lines; their frequencies are these over the period."""
        return _lines(self)[0]

    def silent(self) -> tuple[IntArray, IntArray]:
        """Numbers of the even and of the odd lines within the band that no patch excites.

        There are even ones only if `lines` is "odd".
        """
        return _lines(self)[1:]

    def samples(self, rate_hz: float) -> int:
        """Samples of one period."""
        return round(self.period * rate_hz)

    def volts(self, rate_hz: float, peak: float) -> FloatArray:
        """(samples,) V: settling and all periods. Raises ConfigurationError when that cannot be sampled."""
        if not self.high < rate_hz / 4:
            raise ConfigurationError(
                f"A multisine to {self.high:g} Hz cannot be played at {rate_hz:g} samples/s: "
                "it must end below a quarter of the sample rate."
            )
        one = peak * _period(self, self.samples(rate_hz))
        count = round(self.settle * rate_hz)
        repeated = np.tile(one, self.periods + ceil(count / len(one)))
        drive = repeated[len(repeated) - count - self.periods * len(one) :]
        if count:
            drive[:count] *= fade(count, min(count, round(_RISE * rate_hz)), 0)
        return np.asarray(drive)

    def __str__(self) -> str:
        which = (
            self.lines
            if isinstance(self.lines, str)
            else "every {1}. from the {0}. on of the".format(*self.lines)
        )
        start = "from rest" if self.from_rest else f"after {self.settle:g} s of settling"
        return (
            f"multisine on {which} lines of {1 / self.period:.3g} Hz, {self.low:g} to {self.high:g} Hz, "
            f"{self.periods} period(s) {start}; {self.duration:.2f} s of measuring"
        )


Excitation = LinearSweep | Multisine


@dataclass(frozen=True)
class Planned:
    """Result of `plan_excitation`: the excitation, its peak (V at the patch), and the expected error."""

    excitation: Multisine
    level: float
    expected_error: float

    @property
    def duration(self) -> float:
        """Measuring time (s)."""
        return self.excitation.duration


def plan_excitation(
    target_error: float,
    snr_db: float,
    *,
    peak: float,
    decay: float = 0.3,
    low: float = 15.0,
    high: float = 625.0,
) -> Planned:
    """The shortest multisine that measures a response within a target error, at the lowest level.

    `target_error` is the relative rms error of the response over the band. `snr_db` is the velocity
    over the noise, both within the band, for a multisine of `peak` V: see `Response.snr_db`.
    `decay` is the slowest mode's time constant (s), which sets line spacing and settling. The plan is
    one period from rest if that suffices; otherwise settling and an average over several periods.
    Raises ConfigurationError for a target that 200 periods do not reach.
    """
    if not (0 < target_error < 1 and peak > 0 and decay > 0 and np.isfinite(snr_db)):
        raise ConfigurationError(
            "A plan needs a target error between 0 and 1, a signal-to-noise ratio in dB, a peak and a decay."
        )
    # About two lines per half-power width, 1 / (pi decay), and at least the 2.05 s of the paper's table.
    short = Multisine(low=low, high=high, period=max(2.05, 6 * decay))
    share = len(short.excited()) / ((high - low) * short.period)
    single = 10 ** (-snr_db / 20) * float(np.sqrt(share))
    quick = _LOCAL_GAIN * single
    if quick <= target_error:
        used = max(quick / target_error, _LEAST_SHARE)
        return Planned(short, peak * used, quick / used)
    # Half of the squared error is allowed for the remaining transient, half for the noise.
    settle = max(decay * log(2**0.5 * _RINGING / target_error), 0.1)
    periods = ceil(2 * (single / target_error) ** 2)
    if periods > _MOST_PERIODS:
        raise ConfigurationError(
            f"An error of {target_error:.2%} at {snr_db:.0f} dB would take {periods} periods "
            f"({periods * short.period:.0f} s), and {_MOST_PERIODS} are the most: "
            "raise the level or the target."
        )
    long = Multisine(low=low, high=high, period=short.period, periods=periods, settle=settle)
    left = _RINGING * exp(-settle / decay)
    return Planned(long, peak, float(np.hypot(single / periods**0.5, left)))


def linear_sweep(rate_hz: float, duration: float, stop_hz: float, peak: float) -> FloatArray:
    """The paper's sweep: a sine whose frequency rises linearly from 0 to `stop_hz`.

    Returns (samples,) V of `duration` seconds at `rate_hz`, with zero ends, zero mean and the
    given peak. Raises ConfigurationError when that cannot be sampled.
    """
    if not 0 < stop_hz < rate_hz / 2 or duration < 2 * (_FADE_IN + _FADE_OUT):
        raise ConfigurationError(
            f"A sweep to {stop_hz:g} Hz in {duration:g} s cannot be played at {rate_hz:g} samples/s: "
            "it must end below half the sample rate and last longer than its fades."
        )
    samples = round(duration * rate_hz)
    t = np.arange(samples) / rate_hz
    window = np.ones(samples)
    for seconds, part in ((_FADE_IN, slice(None)), (_FADE_OUT, slice(None, None, -1))):
        n = round(seconds * rate_hz)
        window[part][:n] = 0.5 - 0.5 * np.cos(np.pi * np.arange(n) / n)
    sweep = window * np.sin(np.pi * stop_hz / duration * t**2)
    sweep -= window * (sweep.sum() / window.sum())
    return np.asarray(sweep * (peak / np.abs(sweep).max()))


@lru_cache(maxsize=16)
def _lines(multisine: Multisine) -> tuple[IntArray, IntArray, IntArray]:
    """Numbers of the excited lines, and of the even and the odd lines that no patch excites.

    The choice does not depend on k, so patches driven together leave out the same lines.
    """
    numbers = np.arange(ceil(multisine.low * multisine.period), int(multisine.high * multisine.period) + 1)
    odd_only = multisine.lines == "odd"
    candidates = numbers[numbers % 2 == 1] if odd_only else numbers
    rng = np.random.default_rng(multisine.seed)
    group = _GROUP_ODD if odd_only else _GROUP
    whole = candidates[: len(candidates) // group * group].reshape(-1, group)
    left_out = rng.permuted(whole, axis=1)[:, 0]
    kept = np.setdiff1d(candidates, left_out)
    if not isinstance(multisine.lines, str):
        k, n = multisine.lines
        kept = kept[k::n]
    even = numbers[numbers % 2 == 0] if odd_only else numbers[:0]
    return kept, even, left_out


@lru_cache(maxsize=16)
def _period(multisine: Multisine, samples: int) -> FloatArray:
    """One period (samples,) with a peak of one, starting where the waveform is closest to zero."""
    lines = multisine.excited()
    coarse = fast_length(8 * int(lines[-1]))
    rng = np.random.default_rng([multisine.seed, 1])
    phases = np.exp(2j * np.pi * rng.random(len(lines)))
    rounds = _CLIPPINGS * _LINES // max(_LINES, len(lines))
    for step in range(rounds):
        spectrum = np.zeros(coarse // 2 + 1, dtype=np.complex128)
        spectrum[lines] = phases
        wave = np.fft.irfft(spectrum, coarse)
        # Hard clipping at first, later only of the highest peaks.
        ceiling = np.abs(wave).max() * (0.65 + 0.27 * step / rounds)
        clipped = np.fft.rfft(np.clip(wave, -ceiling, ceiling))[lines]
        phases = clipped / np.abs(clipped)
    spectrum = np.zeros(samples // 2 + 1, dtype=np.complex128)
    spectrum[lines] = phases
    wave = np.fft.irfft(spectrum, samples)
    ends = np.maximum(np.abs(wave), np.abs(np.roll(wave, 1)))
    one = np.roll(wave, -int(np.argmin(ends))) / np.abs(wave).max()
    one.setflags(write=False)
    return np.asarray(one)
