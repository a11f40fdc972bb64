"""From a press to the volts that make the table repeat it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft, rfftfreq

from calibration import actuation, files
from calibration.inversion import Plan, loudest, quiet
from calibration.record import Calibration
from calibration.response import Response
from calibration.spectra import band_window, fade, resample, third_octaves
from instruments import DataError, Limits
from instruments.arrays import FloatArray

if TYPE_CHECKING:
    from acquisition import Representative

__all__ = ["BAND", "Drive", "Method", "drive_for", "modulate"]

Method = Literal["modulated", "broadband"]
"""What the surface shall do: the press modulated with the table's resonance, as in the paper, or the
press itself."""

BAND = (75.0, 600.0)
"""Hz: what a drive repeats of a press. Below its first mode a table hardly moves, and the paper's
sweep ends at 625 Hz. The band is the same for every press and table, so that an error is never
small because little was asked for."""
_BEFORE, _AFTER = 0.30, 0.20
"""Seconds that a drive may begin before the press and end after it. The inverse of a table whose
patch and point differ is not causal: it must move the plate before, to be still where it must."""
FADE = 0.02
"""Seconds in which a drive begins, and ends."""
_LEAST_RATE = 5000.0
"""Samples/s at least that the drive is optimised at: four samples a period of the highest line."""
_BUDGET = 0.005
"""Error that is accepted for the sake of a louder drive. Little, because what cannot be expected (a
patch's hysteresis is known to some percent) comes on top, and learning needs volts to correct that
with; 3 % would make a drive a tenth louder."""
_NOISE_SHARE = 0.3
"""The same, over the noise that a check of a drive without such error has: where that is large, loudness is
worth more. Of twelve plans at eight times a PDV-100's noise, eleven had the least error, noise included, at
0.25 or 0.35; at 0.5 more than 40 % more was missed on purpose, and learning cannot take that away."""
_PLAYS = 8
"""Plays that a check averages, for the noise that is expected in it."""
_TRIES = 20
_RANGE_USED = 0.8
"""Share of the vibrometer's range that a drive may ask for."""
_ALL = 0.99
"""Share that is said to be all."""


@dataclass(frozen=True, eq=False)
class Drive:
    """Volts for one patch, and what the surface should then do.

    `volts` is (samples,) V at the patch as commanded, `target` is (samples,) m/s^2, on the same
    clock: the press's acceleration, modulated if that is the `method`, cut to `band` (Hz) and
    multiplied by `scale`. `in_band` is the share of that acceleration's energy which lies within the
    band. `predicted_error` is what a check should find: rms of the error over rms of the target. What is
    not known of the patch's hysteresis comes on top (some percent), until learning has measured it.
    """

    button: str
    patch: str
    point: str
    rate_hz: float
    volts: FloatArray
    target: FloatArray
    scale: float
    method: str
    """How it was computed: "modulated", "broadband", or in words."""
    carrier_hz: float
    """What the press was modulated with (Hz); 0 when it was not."""
    band: tuple[float, float]
    in_band: float
    predicted_error: float
    unreached: str
    """What could not be reached within the limits, as sentences; empty when everything was."""
    rig: str
    """Name of the rig that the calibration was measured on: the drive fits no other."""
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


@dataclass(frozen=True, eq=False)
class Wanted:
    """A press on the clock of its drive, at the press's own rate; arrays are (grid,).

    The grid is periodic and holds room before the press, the press, room after it (together `record`
    samples, of which each becomes `oversampling` of the drive's), and the ringing that must not wrap.
    """

    acceleration: FloatArray
    window: FloatArray
    """One within the record, with faded ends, and zero after it."""
    record: int
    start: int
    """Sample at which the press begins."""
    oversampling: int
    rate_hz: float
    carrier_hz: float

    @property
    def frequencies(self) -> FloatArray:
        """Of its lines (Hz)."""
        return np.asarray(rfftfreq(len(self.window), 1 / self.rate_hz))

    def within(self, band: tuple[float, float]) -> tuple[FloatArray, float]:
        """(grid,) m/s^2 cut to `band` (Hz), and the share of the energy that is left."""
        spectrum = rfft(self.acceleration)
        cut = spectrum * band_window(self.frequencies, *band)
        share = float((np.abs(cut) ** 2).sum() / (np.abs(spectrum) ** 2).sum())
        return np.asarray(irfft(cut, len(self.window))), share

    def on_drive(self, signal: FloatArray) -> FloatArray:
        """(grid,) at the press's rate to the record at the drive's."""
        return resample(signal, len(signal) * self.oversampling)[: self.record * self.oversampling]

    @property
    def smooth(self) -> FloatArray:
        """`window` on the drive's clock."""
        edge = round(FADE * self.rate_hz) * self.oversampling
        return fade(self.record * self.oversampling, edge, edge)


def wanted_of(press: Representative, calibration: Calibration, method: Method) -> Wanted:
    """What the surface shall do, before the band and the scale.

    Raises DataError when the press will not do.
    """
    oversampling = _oversampling(press, calibration.rate_hz)
    edge = max(1, round(FADE / 2 * press.rate_hz))
    own = np.asarray(press.acceleration) * fade(len(press.acceleration), edge, edge)
    carrier_hz = calibration.model.resonance_hz if method == "modulated" else 0.0
    if method == "modulated":
        own = modulate(own, press.rate_hz, carrier_hz)
    before = round(_BEFORE * press.rate_hz)
    record = before + len(own) + round(_AFTER * press.rate_hz)
    grid = next_fast_len(record + round(actuation.ringing(calibration.model) * press.rate_hz), real=True)
    acceleration, window = np.zeros(grid), np.zeros(grid)
    acceleration[before : before + len(own)] = own
    fading = round(FADE * press.rate_hz)
    window[:record] = fade(record, fading, fading)
    return Wanted(acceleration, window, record, before, oversampling, press.rate_hz, carrier_hz)


def drive_for(
    press: Representative,
    calibration: Calibration | Response,
    limits: Limits,
    *,
    method: Method = "modulated",
    band: tuple[float, float] = BAND,
    inversion: Literal["optimised", "regularised"] = "optimised",
) -> Drive:
    """The drive that makes the calibrated point repeat a press.

    The press is modulated with the point's resonance (equation 1 of the paper), or taken as it is for
    "broadband"; cut to what of `band` (Hz) was measured well, and inverted without asking for
    causality, with the patch's hysteresis undone; then as loud as `limits` and the vibrometer's
    range allow. For loudness 0.5 % of error is accepted, more where the vibrometer's noise is more, or
    the least that can be had (see `inversion.loudest`; `inversion.quiet` for "regularised", which is
    scaled to the limits instead of planned within them). The drive has zero ends and zero mean. A
    response that comes without a calibration is fitted first.

    Raises DataError for a press that cannot be driven or a response that is too noisy, LimitError
    when the limits leave no room.
    """
    if isinstance(calibration, Response):
        calibration = Calibration.of(calibration)
    response = calibration.response
    wanted = wanted_of(press, calibration, method)
    band = actuation.measured_well(response, band)
    target, in_band = wanted.within(band)

    limit = calibration.hysteresis.reach(limits.peak * min(1.0, actuation.path_gain(calibration)))
    plan = plan_for(calibration, target, wanted.window, wanted.rate_hz, band, limits, limit)
    silent = replace(plan, noise=0.0)
    noise = plan.noise * float(np.abs(quiet(silent, _BUDGET)[0]).max())
    invert = loudest if inversion == "optimised" else quiet
    planned, _ = invert(silent, max(_BUDGET, _NOISE_SHARE * noise))

    smooth = wanted.smooth
    strain = wanted.on_drive(planned) * np.minimum(1.0, smooth / 0.05)
    # Back on the plan's grid, to expect what the very signal that will be played does.
    grid = len(wanted.window)
    played = resample(np.pad(strain, (0, grid * wanted.oversampling - len(strain))), grid)
    f = wanted.frequencies
    velocity = irfft(rfft(played) * plan.gain / (2j * np.pi * np.maximum(f, f[1])), grid)
    loudest_seen = _RANGE_USED * response.velocity_range / float(np.abs(velocity).max())
    scale = min(limit / float(np.abs(strain).max()), loudest_seen)
    volts, scale = _within(limits, calibration, strain, smooth, scale)
    expected = replace(plan, noise=plan.noise * limit / (scale * float(np.abs(played).max())))
    error = expected.error(played)
    if scale < loudest_seen:
        by = actuation.binding(calibration, volts, limits)
    else:
        by = f"{_RANGE_USED:.0%} of the vibrometer's {response.velocity_range * 1e3:g} mm/s"
    return Drive(
        button=press.button,
        patch=response.patch,
        point=response.point,
        rate_hz=calibration.rate_hz,
        volts=volts,
        target=scale * wanted.on_drive(target),
        scale=scale,
        method=method,
        carrier_hz=wanted.carrier_hz,
        band=band,
        in_band=in_band,
        predicted_error=error,
        unreached=_unreached(expected, played, wanted.rate_hz, band, scale, in_band, by),
        rig=response.rig,
        simulated=bool(press.simulated or response.simulated),
        sources=tuple((str(name), str(content)) for name, content in press.sources),
        calibration=calibration.digest,
    )


def plan_for(
    calibration: Calibration,
    target: FloatArray,
    window: FloatArray,
    rate_hz: float,
    band: tuple[float, float],
    limits: Limits,
    limit: float,
) -> Plan:
    """The plan, in volts of strain of which `limit` are allowed, for a target ((grid,) m/s^2)."""
    f = rfftfreq(len(target), 1 / rate_hz)
    weight = band_window(f, *band, outside=True) ** 2
    rms = np.sqrt(2 * np.sum(target**2) / len(target))
    noise = np.sqrt(np.sum(weight * actuation.density(calibration, f) ** 2) * (f[1] - f[0]) / _PLAYS)
    slew = min(limits.slew, limits.current_peak / limits.capacitance if limits.capacitance else np.inf)
    return Plan(
        wanted=rfft(target),
        gain=actuation.gain(calibration, f),
        weight=weight,
        doubt=actuation.doubt(calibration, f),
        window=window,
        noise=float(noise / rms / limit),
        steepest=slew / rate_hz / limits.peak,
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
) -> tuple[FloatArray, float]:
    """Volts to command for `strain` times the largest factor up to `scale` that the limits allow.

    Limits hold for the volts commanded and for those that reach the patch. Returns the volts and
    the factor. Raises LimitError when no factor is found.
    """
    for _ in range(_TRIES):
        volts = actuation.commanded(calibration, scale * strain, smooth)
        room = actuation.room(calibration, volts, limits)
        if room >= 1:
            break
        # Hysteresis bends what a factor does to the volts, so that it is approached.
        scale *= room * (1 - 1e-6)
    limits.check(volts, calibration.rate_hz)
    return volts, scale


def _unreached(
    plan: Plan,
    played: FloatArray,
    rate_hz: float,
    band: tuple[float, float],
    scale: float,
    in_band: float,
    by: str,
) -> str:
    sentences = []
    if scale < _ALL:
        sentences.append(
            f"The surface repeats the shape at {scale:.1%} of the recorded acceleration: more than that "
            f"would need more than {by}."
        )
    if in_band < _ALL:
        sentences.append(
            f"{1 - in_band:.0%} of the energy lies outside {band[0]:.0f} to {band[1]:.0f} Hz and is left out."
        )
    missed = irfft((plan.wanted - plan.gain * rfft(played)) * np.sqrt(plan.weight), len(played))
    error = float(np.linalg.norm(missed) / np.linalg.norm(irfft(plan.wanted, len(played))))
    if error > _BUDGET:
        centres, levels = third_octaves(missed, rate_hz, *band)
        sentences.append(
            f"Within it {error:.1%} of the target is missed on purpose, most around "
            f"{centres[int(np.argmax(levels))]:.0f} Hz, to be louder or because it was not measured well."
        )
    return " ".join(sentences)
