"""Measure a calibration: the response, the patch's even order, what is left, and the response above.

The even order is found from a drive and its negative. Everything odd in the patch and everything linear in
the table answers the negative with the negative, so that the mean of both motions holds the even order alone,
with noise, and with the ringing that both plays found. The even order is the known response applied to a kink
and a square of the linear volts: two unknown parts, beside the free decay of the modes. Noise scatters the
parts; an error of the response scales them. An even order of another shape, or one that lags in its own way,
leaves a residual, which the distortion counts. After Pintelon and Schoukens, System Identification, 2012,
chapter 3 (even and odd nonlinear contributions).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy

from ...base.arrays import ComplexArray, FloatArray
from ...base.progress import Progress, silent
from ...instruments import Rig
from ..response import (
    SWEEP,
    BothSigns,
    Excitation,
    Waveforms,
    beyond,
    distortion,
    even_terms,
    hidden,
    measure_above,
    measure_both_signs,
    measure_response,
    rows,
    terms_of,
)
from .calibration import Calibration

_RING = 2.0
"""Time (s) after the drive in which the simulated table falls silent, so that nothing wraps."""
_SIGNIFICANT = 12.0
"""Decrease of the squared residual, over that of a line of what is left, from which there is an even order:
noise alone takes more than that once in a thousand times."""
_UNSEEN = 1e-9
"""Singular values, over the largest, of columns that the others hold."""


def even_order(calibration: Calibration, both: BothSigns) -> FloatArray:
    """(2,): `Hysteresis.even` of a patch; zeros where the plays show none beyond their noise."""
    law, model, channels = calibration.hysteresis, calibration.model, both.channels
    samples = both.volts.shape[-1]
    at = scipy.fft.rfftfreq(samples, 1 / channels.rate_hz)
    inside = (at >= model.band[0]) & (at <= model.band[1])
    long = scipy.fft.next_fast_len(samples + round(_RING * channels.rate_hz), real=True)
    f = scipy.fft.rfftfreq(long, 1 / channels.rate_hz)
    f = f[f <= model.band[1]]
    lag = law.gain(calibration.response.level)
    path = model.velocity(f) / lag * np.exp(-2j * np.pi * f * channels.drive_delay)

    def moved(linear_volts: FloatArray) -> ComplexArray:
        """(..., lines) m/s that linear volts make while they last."""
        spectra = scipy.fft.rfft(linear_volts, long)[..., : len(f)] * path
        return np.asarray(scipy.fft.rfft(scipy.fft.irfft(spectra, long)[..., :samples])[..., inside])

    seen = channels.velocity(scipy.fft.rfft(both.velocity.mean(axis=0))[inside], at[inside])
    odd = np.array([law.odd(one) for one in both.volts])
    # Where the two drives differ by more than their sign, the surface moves by that as well.
    seen = seen - moved(odd.mean(axis=0))
    columns = moved(np.mean([even_terms(one, law.level) for one in odd], axis=0))
    decays = terms_of(model.poles, at[inside])[1]
    _, without = _fitted(decays, seen)
    parts, left = _fitted(np.concatenate([columns, decays]), seen)
    per_line = left / (2 * int(inside.sum()) - len(columns) - len(decays))
    return parts[:2] if without - left > _SIGNIFICANT * per_line else np.zeros(2)


def _fitted(columns: ComplexArray, seen: ComplexArray) -> tuple[FloatArray, float]:
    """Real parts (columns,) of least squares, and the squared residual."""
    matrix, measured = rows(columns), rows(seen)
    norms = np.linalg.norm(matrix, axis=1)
    norms[norms == 0] = 1.0
    found = np.linalg.lstsq((matrix / norms[:, None]).T, measured, rcond=_UNSEEN)[0] / norms
    return found, float(((measured - found @ matrix) ** 2).sum())


def calibrate(
    rig: Rig,
    patch: str = "A",
    point: str = "button",
    progress: Progress = silent,
    *,
    excitation: Excitation = SWEEP,
) -> Calibration:
    """Measure the response of a patch at a point, fit a model to it, and measure the response above its band.

    Both kinds of excitation measure the patch's hysteresis as well.

    `progress` is called with the seconds measured. Raises what `measure_response` and `fit` raise.

    For example:

        >>> calibration = haploop.calibrate(rig, patch="A", point="button")
        >>> calibration.save("calibration.h5")
        >>> calibration.response.patch, calibration.response.point
        ('A', 'button')
    """
    found = Calibration.of(measure_response(rig, patch, point, progress, excitation=excitation))
    return examined(rig, found, progress)


def calibrate_keeping(
    rig: Rig,
    patch: str = "A",
    point: str = "button",
    progress: Progress = silent,
    *,
    excitation: Excitation = SWEEP,
) -> tuple[Calibration, Waveforms]:
    """`calibrate`, and the volts of every play that it was computed from, of which it can be computed again.

    Raises what `calibrate` raises.
    """
    with rig.captures() as captures:
        found = calibrate(rig, patch, point, progress, excitation=excitation)
    return found, Waveforms.of(rig, captures, found.digest, patch, point)


def examined(rig: Rig, calibration: Calibration, progress: Progress = silent) -> Calibration:
    """Add to a calibration the patch's even order, the distortion left, and the response above its band.

    To be called after its response was measured, with the laser still at the point. Raises what
    `measure_response` raises. A generator plays nothing but sweeps, which show none of that: then nothing is
    added.
    """
    if rig.feeds_amplifier("generator"):
        return calibration
    patch, point = calibration.response.patch, calibration.response.point
    both = measure_both_signs(rig, patch, point, progress)
    law = replace(calibration.hysteresis, even=even_order(calibration, both))
    above = measure_above(rig, patch, point, law, progress)
    found = replace(calibration, hysteresis=law, above=above, distortion=distortion(both, law))
    if above is None:
        return found
    return replace(found, beyond=beyond(both, law, above), hidden=hidden(both, law, above))
