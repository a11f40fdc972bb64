"""Agreement of several plays with a target: errors without the plays' noise, and their confidence intervals.

The squared error is estimated from products of different plays, in which independent noise averages to zero
(see `intervals`). A tone that is in step with the plays is not independent
noise: it makes the power negative, or its deviation vanish (`dependence`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from ...base.arrays import BoolArray, ComplexArray, FloatArray
from ...base.wording import error_said
from ..intervals import CONFIDENCE, common, not_negative, quantile, student

_UNLIKELY = 1e-5
"""Probability of calling plays without a trend drifting."""
_ODD = 3.0
"""Distance of a play to the nearest other one, over the median of all, from which it is unlike the others."""
_MOST_PLAYS = 64
_IMPOSSIBLE = 1e-4
"""Probability that independent noise makes a power so negative that it counts as impossible."""
_ROUNDING = 1e-6
"""Deviation, over the power or its noise, below which it is nothing but rounding."""
_NARROW = 1e-3
"""Probability that independent noise makes a deviation so small that it counts as impossible."""


@dataclass(frozen=True)
class SharedPower:
    """Power common to `plays` plays, its standard deviation, and the power of the noise in their mean."""

    value: float
    deviation: float
    noise: float
    plays: int
    least: float = 0.0
    """Deviation that noise of this power would make if it were independent from play to play, at least."""

    @property
    def possible(self) -> bool:
        """False for a power more negative, or better known, than that of plays with independent noise."""
        reach = student(self.plays, 1 - _IMPOSSIBLE) * self.deviation
        # Written so that NaN, which is another matter, is possible.
        if self.least < _ROUNDING * max(abs(self.value), abs(self.noise)):
            return True
        # The squared deviation, of one value for each play, spreads as a chi-squared variable.
        freedom = (self.plays - 1) / 2
        narrow = float(np.sqrt(scipy.special.gammaincinv(freedom, _NARROW) / freedom))
        return not (self.value < -reach or self.deviation < narrow * self.least)

    @property
    def root(self) -> float:
        """Root of the power: zero for a negative one within the noise, NaN for one that is not possible."""
        return float(np.sqrt(max(self.value, 0.0))) if self.possible else float("nan")

    @property
    def clear(self) -> bool:
        """True for a power that noise makes with a probability of less than 1e-4."""
        return self.value > student(self.plays, 1 - _IMPOSSIBLE) * max(self.deviation, self.least)

    @property
    def floor(self) -> float:
        """Root power of the noise in the mean of the plays: its standard error."""
        return float(np.sqrt(max(self.noise, 0.0)))

    @property
    def interval(self) -> tuple[float, float]:
        """Confidence interval of the root (`CONFIDENCE`), from the plays alone; NaN if not possible."""
        if not self.possible:
            return float("nan"), float("nan")
        reach = quantile(self.plays) * self.deviation
        # The noise's own deviation is known from all lines, and has no Student's t.
        low, high = not_negative(
            self.value, max(reach, scipy.special.ndtri(0.5 + CONFIDENCE / 2) * self.least)
        )
        return float(np.sqrt(low)), float(np.sqrt(high))

    @property
    def said(self) -> str:
        """The root with its interval: see `error_said`."""
        return error_said(self.root, self.interval)

    @property
    def brief(self) -> str:
        """As `said`, without the interval of an estimate."""
        return error_said(self.root, self.interval, brief=True)

    def summary(self) -> dict[str, Any]:
        """Plain values for JSON: root, interval and floor; NaN becomes null."""
        return {
            "error": finite(self.root),
            "interval": [finite(edge) for edge in self.interval],
            "floor": finite(self.floor),
        }


def finite(value: float) -> float | None:
    """The value for JSON, which has no NaN."""
    return float(value) if np.isfinite(value) else None


def error_spectra(
    accelerations: FloatArray, target: FloatArray, over: FloatArray | None = None
) -> ComplexArray:
    """(plays, lines) of the differences of (plays, samples) from the target, whose power is one.

    The sum of the squared magnitudes over all lines is the squared error: over that of the target, or of the
    signal `over`, as where the target is zero.
    """
    wanted = _lines(target)
    return np.asarray(
        (_lines(accelerations) - wanted) / np.linalg.norm(wanted if over is None else _lines(over))
    )


def followed(missed: ComplexArray, target: FloatArray) -> tuple[float, float]:
    """Share of the target in the motion, from `error_spectra`, and the standard error of that."""
    wanted = _lines(target)
    shares = 1 + (missed @ wanted.conj()).real / float(np.linalg.norm(wanted))
    return abs(float(shares.mean())), float(shares.std(ddof=1) / np.sqrt(len(shares)))


def lines_inside(band: tuple[float, float], samples: int, rate_hz: float) -> BoolArray:
    """(lines,) True for those within a band (Hz), its ends included."""
    f = np.fft.rfftfreq(samples, 1 / rate_hz)
    return np.asarray((f >= band[0]) & (f <= band[1]))


def shared_power(spectra: ComplexArray) -> SharedPower:
    """Estimate the power that (plays, lines) spectra have in common, summed over the lines.

    Raises ValueError for fewer than three plays.
    """
    plays = len(spectra)
    products = (spectra @ spectra.conj().T).real
    value, deviation = common(products)
    noise = (float(np.trace(products)) / plays - value) / plays
    # The product of two plays' noise has, on each line, half of the product of their powers as its variance.
    # The median, unlike the mean, has nothing of a single play that was disturbed.
    middle = np.median(spectra.real, axis=0) + 1j * np.median(spectra.imag, axis=0)
    apart = np.abs(spectra - middle) ** 2
    pairs = apart @ apart.T
    least = float(np.sqrt((pairs.sum() - np.trace(pairs)) / 4)) * 2 / (plays * (plays - 1))
    return SharedPower(value, deviation, noise, plays, least)


def summed(powers: Sequence[SharedPower]) -> SharedPower:
    """The sum of powers that were measured in different plays, each in as many."""
    deviation, least = (
        float(np.linalg.norm([getattr(one, name) for one in powers])) for name in ("deviation", "least")
    )
    value, noise = sum(one.value for one in powers), sum(one.noise for one in powers)
    return SharedPower(value, deviation, noise, powers[0].plays, least)


def dependence(whole: ComplexArray, inside: BoolArray) -> str:
    """Evidence that noise is not independent from play to play, in a clause; empty when there is none.

    `whole` is (plays, lines), `inside` (lines,) True for one of its parts.
    """
    for name, part in (
        ("the whole", slice(None)),
        ("the part in band", inside),
        ("the part outside", ~inside),
    ):
        power = shared_power(whole[:, part])
        if power.possible:
            continue
        if power.value < 0:
            share = power.value / max(power.noise * power.plays, 1e-300)
            return f"the squared error of {name} came out negative, {share:.0%} of the noise of a play"
        return f"the error of {name} came out with an interval of no width, in noise of {power.floor:.1%}"
    return ""


def plays_needed(power: SharedPower, limit: float) -> int | None:
    """Number of plays whose interval of the root would not contain `limit`; None when 64 do not suffice.

    Products of noise alone fall with the number of plays, what else spreads with its root. What the value has
    beyond an error of 100 % is taken for noise, which more plays would not find again.
    """
    now, value = power.plays, min(max(power.value, 0.0), 1.0)
    noise = power.least**2 * now * (now - 1)
    spread = max(power.deviation**2 - power.least**2, 0.0) * now
    for plays in range(now + 1, _MOST_PLAYS + 1):
        reach = quantile(plays) * np.sqrt(spread / plays + noise / (plays * (plays - 1)))
        if abs(value - limit**2) > reach:
            return plays
    return None


def told_by_noise(squares: float, plays: int) -> float:
    """Upper end of the interval of a power of zero, from `plays` plays of noise alone.

    `squares` is the sum over the lines of the squared power of one play's noise.
    """
    return float(quantile(plays) * np.sqrt(squares / (plays * (plays - 1))))


def trend(spectra: ComplexArray) -> float:
    """Root power of the change from the first to the last of (plays, lines) spectra; 0 if not significant.

    The power along the order of the plays is compared with that along all other contrasts by an F test:
    stationary noise has the same along each. Lines of little noise tell little of its power, so that the
    degrees of freedom are those of as many lines of equal noise.
    """
    plays = len(spectra)
    along = np.arange(plays) - (plays - 1) / 2
    size = float(np.linalg.norm(along))
    changed = float((np.abs(along @ spectra / size) ** 2).sum())
    around = (np.abs(spectra - spectra.mean(axis=0)) ** 2).sum(axis=0)
    noise = (float(around.sum()) - changed) / (plays - 2)
    freedom = 2 * float(around.sum() ** 2 / max((around**2).sum(), 1e-300))
    if not changed > noise * scipy.special.fdtri(freedom, freedom * (plays - 2), 1 - _UNLIKELY):
        return 0.0
    return float(np.sqrt(changed - noise) * (plays - 1) / size)


def odd_play(spectra: ComplexArray) -> tuple[int, float]:
    """Number (from 1) of a play unlike all others, and its root power from the nearest; (0, 0) if none.

    Products of different plays take a single odd one for noise, so that it must be looked for. `spectra` is
    (plays, lines).
    """
    apart = np.linalg.norm(spectra[:, None] - spectra, axis=2)
    np.fill_diagonal(apart, np.inf)
    nearest = apart.min(axis=1)
    odd = int(np.argmax(nearest))
    if not nearest[odd] > _ODD * float(np.median(nearest)):
        return 0, 0.0
    return odd + 1, float(nearest[odd])


def _lines(signals: FloatArray) -> ComplexArray:
    """(..., lines) of (..., samples), scaled so that the sum of the squared magnitudes is the mean square."""
    samples = signals.shape[-1]
    spectra = np.fft.rfft(signals) * (np.sqrt(2) / samples)
    spectra[..., 0] /= np.sqrt(2)
    if samples % 2 == 0:
        spectra[..., -1] /= np.sqrt(2)
    return np.asarray(spectra)
