"""From a press to the volts that make the table repeat it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft, rfftfreq
from scipy.ndimage import uniform_filter1d

from calibration import files
from calibration.inversion import Plan, loudest
from calibration.model import Model
from calibration.record import Calibration
from calibration.response import Response
from calibration.spectra import band_window, fade, resample
from instruments import DataError, Limits
from instruments.arrays import ComplexArray, FloatArray

if TYPE_CHECKING:
    from acquisition import Representative

__all__ = ["BAND", "Drive", "drive_for", "modulate"]

BAND = (75.0, 600.0)
"""Hz: what a drive repeats of a press. Below its first mode a table hardly moves, and the paper's
sweep ends at 625 Hz. The band is the same for every press and table, so that an error is never
small because little was asked for."""
_BEFORE, _AFTER = 0.30, 0.20
"""Seconds that a drive may begin before the press and end after it. The inverse of a table whose
patch and point differ is not causal: it must move the plate before, to be still where it must."""
_FADE = 0.02
_LEAST_RATE = 5000.0
"""Samples/s at least that the drive is optimised at: four samples a period of the highest line."""
_BUDGET = 0.06
"""Expected error that is accepted for the sake of a louder drive. Under a third of what a check
accepts: what cannot be expected needs room too."""
_PLAYS = 8
"""Plays that a check averages, for the noise that is expected in it."""
_SMOOTH = 21
"""Lines (2.5 Hz)."""
_TRIES = 20
_RANGE_USED = 0.8
"""Share of the vibrometer's range that a drive may ask for."""


@dataclass(frozen=True, eq=False)
class Drive:
    """Volts for one patch, and what the surface should then do.

    `volts` is (samples,) V at the patch as commanded, `target` is (samples,) m/s^2, on the same
    clock: the press's acceleration, modulated, cut to `band` (Hz) and multiplied by `scale`.
    `in_band` is the share of the modulated press's energy that lies within the band.
    `predicted_error` is what a check should find: rms of the error over rms of the target.
    """

    button: str
    patch: str
    point: str
    rate_hz: float
    volts: FloatArray
    target: FloatArray
    scale: float
    carrier_hz: float
    band: tuple[float, float]
    in_band: float
    predicted_error: float
    simulated: bool
    sources: tuple[tuple[str, str], ...]
    """Recordings that the press stands for: file name, content hash."""
    calibration: str
    """Content hash of the calibration that it was computed from."""

    @property
    def peak(self) -> float:
        """Largest voltage (V)."""
        return float(np.abs(self.volts).max())

    def save(self, path: str | Path) -> None:
        """Write to a new HDF5 file, whole or not at all. Raises DataError if it exists."""
        files.write(path, "drive", files.flatten(self))

    @classmethod
    def load(cls, path: str | Path) -> Drive:
        """Read what `save` wrote. Raises DataError, one sentence, for anything else."""
        return files.restore(cls, files.read(path, "drive"), path)


def modulate(acceleration: FloatArray, rate_hz: float, carrier_hz: float) -> FloatArray:
    """Equation 1 of the paper: A_digital(t) = A_physical(t) sin(2 pi f_c t), t = 0 at the first sample."""
    t = np.arange(len(acceleration)) / rate_hz
    return np.asarray(acceleration * np.sin(2 * np.pi * carrier_hz * t))


def drive_for(
    press: Representative,
    calibration: Calibration | Response,
    limits: Limits,
    band: tuple[float, float] = BAND,
) -> Drive:
    """The drive that makes the calibrated point repeat a press, modulated with its resonance.

    The press is modulated (equation 1 of the paper), cut to what of `band` (Hz) was measured well,
    and inverted without asking for causality, with the patch's hysteresis undone; then as loud as
    `limits` and the vibrometer's range allow, at an expected error of 6 %, or the least that can be
    expected (see `inversion.loudest`). The drive has zero ends and zero mean. A response that comes
    without a calibration is fitted first.

    Raises DataError for a press that cannot be driven or a response that is too noisy, LimitError
    when the limits leave no room.
    """
    if isinstance(calibration, Response):
        calibration = Calibration.of(calibration)
    response, model, rate_hz = calibration.response, calibration.model, calibration.rate_hz
    oversampling = _oversampling(press, rate_hz)
    band = _measured_well(response, band)
    carrier_hz = model.resonance_hz

    # One periodic grid holds room before, press, room after, and the ringing that must not wrap.
    edge = max(1, round(_FADE / 2 * press.rate_hz))
    own = np.asarray(press.acceleration) * fade(len(press.acceleration), edge, edge)
    before = round(_BEFORE * press.rate_hz)
    record = before + len(own) + round(_AFTER * press.rate_hz)
    grid = next_fast_len(record + round(_ringing(model) * press.rate_hz), real=True)
    modulated = np.zeros(grid)
    modulated[before : before + len(own)] = modulate(own, press.rate_hz, carrier_hz)
    fading = round(_FADE * press.rate_hz)
    window = np.zeros(grid)
    window[:record] = fade(record, fading, fading)

    path_gain = float(np.median(np.abs(response.path)))
    limit = calibration.hysteresis.reach(limits.peak * min(1.0, path_gain))
    plan, in_band = _plan(calibration, modulated, press.rate_hz, window, limit, band)
    planned, _ = loudest(plan, _BUDGET)

    samples = record * oversampling
    smooth = fade(samples, fading * oversampling, fading * oversampling)
    strain = np.zeros(grid * oversampling)
    strain[:samples] = resample(planned, len(strain))[:samples] * np.minimum(1.0, smooth / 0.05)
    # Back on the plan's grid, to expect what the very signal that will be played does.
    played = resample(strain, grid)
    f = rfftfreq(grid, 1 / press.rate_hz)
    velocity = irfft(rfft(played) * plan.gain / (2j * np.pi * np.maximum(f, f[1])), grid)
    loudest_seen = _RANGE_USED * response.velocity_range / float(np.abs(velocity).max())
    scale = min(limit / float(np.abs(strain).max()), loudest_seen)
    volts, scale = _within(limits, calibration, strain[:samples], smooth, scale, path_gain)
    expected = replace(plan, noise=plan.noise * limit / (scale * float(np.abs(played).max())))
    return Drive(
        button=press.button,
        patch=response.patch,
        point=response.point,
        rate_hz=rate_hz,
        volts=volts,
        target=scale * resample(irfft(plan.wanted, grid), len(strain))[:samples],
        scale=scale,
        carrier_hz=carrier_hz,
        band=band,
        in_band=in_band,
        predicted_error=expected.error(played),
        simulated=bool(press.simulated or response.simulated),
        sources=tuple((str(name), str(content)) for name, content in press.sources),
        calibration=calibration.digest,
    )


def _oversampling(press: Representative, rate_hz: float) -> int:
    """Samples of the drive per sample of the press. Raises DataError when the press will not do."""
    own = np.asarray(press.acceleration)
    if own.ndim != 1 or len(own) < 0.05 * press.rate_hz or not np.all(np.isfinite(own)) or not np.any(own):
        raise DataError(f"The press of {press.button!r} holds no acceleration that could be driven.")
    factor = round(rate_hz / press.rate_hz)
    if abs(factor * press.rate_hz - rate_hz) > 1e-6 * rate_hz or press.rate_hz < _LEAST_RATE:
        raise DataError(
            f"The press of {press.button!r} has {press.rate_hz:g} samples/s, and drives have {rate_hz:g}: "
            f"that must be a multiple, and {_LEAST_RATE:g} is the least."
        )
    return factor


def _within(
    limits: Limits,
    calibration: Calibration,
    strain: FloatArray,
    smooth: FloatArray,
    scale: float,
    path_gain: float,
) -> tuple[FloatArray, float]:
    """Volts to command for `strain` times the largest factor up to `scale` that the limits allow.

    Limits hold for the volts commanded and for those that reach the patch. Returns the volts and
    the factor. Raises LimitError when no factor is found.
    """
    for _ in range(_TRIES):
        volts = calibration.hysteresis.volts(scale * strain) / path_gain
        # A strain of zero may be left with volts that hysteresis holds; they fade out at the end.
        half = len(volts) // 2
        volts[half:] -= volts[-1] * (1 - smooth[half:])
        volts -= smooth * (volts.sum() / smooth.sum())
        room = min(
            _room(volts, calibration.rate_hz, limits), _room(volts * path_gain, calibration.rate_hz, limits)
        )
        if room >= 1:
            break
        # Hysteresis bends what a factor does to the volts, so that it is approached.
        scale *= room * (1 - 1e-6)
    limits.check(volts, calibration.rate_hz)
    return volts, scale


def _plan(
    calibration: Calibration,
    modulated: FloatArray,
    rate_hz: float,
    window: FloatArray,
    limit: float,
    band: tuple[float, float],
) -> tuple[Plan, float]:
    """What is wanted of the table within the band, and the share of the press's energy in it."""
    f = rfftfreq(len(modulated), 1 / rate_hz)
    spectrum = rfft(modulated)
    wanted = spectrum * band_window(f, *band)
    energy = float((np.abs(spectrum) ** 2).sum())
    share = float((np.abs(wanted) ** 2).sum()) / energy
    weight = band_window(f, *band, outside=True) ** 2
    rms = np.sqrt(2 * share * energy) / len(modulated)
    left = np.sqrt(np.sum(weight * _density(calibration, f) ** 2) * (f[1] - f[0]) / _PLAYS)
    noise = float(left / rms / limit)
    return Plan(wanted, _gain(calibration, f), weight, _doubt(calibration, f), window, noise), share


def _ringing(model: Model) -> float:
    """Seconds after which the slowest mode has fallen to a hundredth."""
    slowest = min(2 * np.pi * r.frequency_hz * r.damping for r in model.resonances)
    return float(np.clip(np.log(100) / slowest, 0.3, 2.0))


def _measured_well(response: Response, band: tuple[float, float]) -> tuple[float, float]:
    """What of `band` lies between the first and the last frequency with a coherence of 0.8 or more."""
    good = response.frequencies[response.coherence >= 0.8]
    low, high = (max(band[0], good[0]), min(band[1], good[-1])) if len(good) else (1.0, 0.0)
    if low >= high:
        raise DataError(
            f"The response of patch {response.patch} at the {response.point} point is too noisy for a "
            f"drive between {band[0]:g} and {band[1]:g} Hz: its coherence is "
            f"{float(response.coherence.max()):.2f} at best, and 0.8 is needed."
        )
    return float(low), float(high)


def _gain(calibration: Calibration, f: FloatArray) -> ComplexArray:
    """m/s^2 per V of strain commanded, at `f` (Hz).

    The model averages the sweeps' noise, and holds the lag that hysteresis has at the sweeps'
    level: it is taken out. The path's gain is left out as well, because it acts before the
    hysteresis; its delay may stay, because hysteresis does not depend on time.
    """
    response = calibration.response
    path = np.interp(f, response.frequencies, response.path.real) + 1j * np.interp(
        f, response.frequencies, response.path.imag
    )
    path /= np.median(np.abs(response.path)) * calibration.hysteresis.gain(response.level)
    return np.asarray(calibration.model.velocity(f) * 2j * np.pi * f * path)


def _doubt(calibration: Calibration, f: FloatArray) -> FloatArray:
    """Standard deviation of `_gain`: what the model leaves of the measured response.

    It is averaged over a few lines first, as the model averages over all of them: what changes from
    line to line is the sweeps' noise and the harmonics of the patch, and no fault of the model.
    """
    response = calibration.response
    left = response.velocity - calibration.model.velocity(response.frequencies)
    smooth = uniform_filter1d(left.real, _SMOOTH) + 1j * uniform_filter1d(left.imag, _SMOOTH)
    return np.asarray(np.sqrt(np.mean(np.abs(smooth) ** 2)) * 2 * np.pi * f)


def _density(calibration: Calibration, f: FloatArray) -> FloatArray:
    """Acceleration noise of one play (m/s^2 per sqrt(Hz), one-sided) at `f` (Hz)."""
    response = calibration.response
    return np.asarray(np.interp(f, response.frequencies, response.noise) * 2 * np.pi * f)


def _room(volts: FloatArray, rate_hz: float, limits: Limits) -> float:
    """The largest factor that keeps `volts` within every limit."""
    steps = np.abs(np.diff(volts, prepend=0.0, append=0.0)) * rate_hz
    current = limits.capacitance * steps
    shares = (
        (float(np.abs(volts).max()), limits.peak),
        (float(steps.max()), limits.slew),
        (float(current.max()), limits.current_peak),
        (float(current.mean()) / 2, limits.current_average),
    )
    return min(limit / value for value, limit in shares if value > 0)
