"""From a press to the drive: the volts that make the table reproduce it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
import scipy

from ...acquisition import hdf5
from ...instruments import DataError, Limits
from ...instruments.arrays import FloatArray
from ...instruments.notebook import InNotebook
from ...instruments.vibrometer import DERIVATIVE, shown
from ..model import Calibration
from ..response import Response
from ..spectra import band_window, fade, resample, third_octaves
from . import actuation
from .inversion import Plan, max_output, min_peak
from .trade import BUDGET, TRADE, Trade

if TYPE_CHECKING:
    from ...acquisition import Representative

__all__ = ["BAND", "Drive", "Method", "drive_for", "modulate"]

Method = Literal["modulated", "broadband"]
"""Target of the surface: the press modulated with the table's resonance, as in the paper, or the press
itself."""

BAND = (75.0, 600.0)
"""Hz: the band of a press that a drive reproduces. Below its first mode a table hardly moves, and the
paper's sweep ends at 625 Hz. The band is the same for every press and table, so that an error is never
small because the target is small."""
BEFORE, _AFTER = 0.30, 0.20
"""Seconds that a drive may begin before the press and end after it. Where patch and point differ, the
inverse is not causal: it moves the plate before the press, so that the point moves as the target does."""
FADE = 0.02
"""Fade time (s) at the start and at the end of a drive."""
_LEAST_RATE = 5000.0
"""Lowest sample rate (samples/s) at which a drive is optimised: eight samples a period at 600 Hz."""
_SPREAD = 0.6
"""Error of a drive over that which distortion would make if it were spread evenly over the band: part of it
stays near the drive's own lines, where the table moves little (measured on simulated tables)."""
_TRIES = 20
_RANGE_USED = 0.8
"""Share of the vibrometer's range that a drive may use."""
_REACH = 1000.0
"""V: no amplifier of a patch reaches this. A rig's own limits are lower, and are checked before a play."""
_ALL = 0.99
"""Fraction of the target above which nothing is reported as unreached."""


@dataclass(frozen=True, eq=False)
class Drive(InNotebook):
    """Volts for one patch, and the target motion of the surface.

    `volts` is (samples,) V at the patch as commanded, `target` is (samples,) m/s^2, on the same
    clock: the press's acceleration, modulated if that is the `method`, cut to `band` (Hz) and
    multiplied by `scale`. `in_band` is the share of that acceleration's energy which lies within the
    band. `predicted_error` is the error expected of the whole motion: rms of the error over rms of the
    target. Unmodelled hysteresis of the patch adds some percent; after learning it is the measured error.
    """

    button: str
    patch: str
    point: str
    rate_hz: float
    volts: FloatArray
    target: FloatArray
    scale: float
    method: str
    """Method of computation: "modulated", "broadband", or in words."""
    carrier_hz: float
    """Carrier frequency of the modulation (Hz); 0 without modulation."""
    band: tuple[float, float]
    in_band: float
    known: tuple[float, float]
    """Frequencies (Hz) between which the response was measured: beyond them the drive has no power."""
    predicted_error: float
    unreached: str
    """Shortfalls against the target caused by the limits, as sentences; empty when there are none."""
    rig: str
    """Name of the rig that the calibration was measured on: the drive fits no other."""
    simulated: bool
    sources: tuple[tuple[str, str], ...]
    """Recordings that the press stands for: file name, content hash."""
    calibration: str
    """Content hash of the calibration used."""

    def __post_init__(self) -> None:
        """Raises DataError for signals that no calibration makes, so that nobody plots or plays them."""
        signals = (self.volts, self.target)
        finite = all(np.ndim(signal) == 1 and np.all(np.isfinite(signal)) for signal in signals)
        if not finite or not 0 < len(self.volts) == len(self.target):
            raise DataError("the drive and its target are not two signals of one length with finite values.")
        if not 0 < self.rate_hz < np.inf:
            raise DataError(f"the drive has {self.rate_hz:g} samples/s.")
        if self.peak > _REACH:
            raise DataError(f"the drive reaches {self.peak:g} V, and no amplifier of a patch {_REACH:g} V.")

    def __repr__(self) -> str:
        simulated = ", simulated" if self.simulated else ""
        seconds = len(self.volts) / self.rate_hz
        return (
            f"<Drive {self.button} at patch {self.patch}: {self.peak:.1f} V peak, {seconds:.2f} s{simulated}>"
        )

    @property
    def peak(self) -> float:
        """Largest voltage (V)."""
        return float(np.abs(self.volts).max())

    def save(self, path: str | Path) -> None:
        """Write to a new HDF5 file, whole or not at all. Raises DataError if it exists."""
        hdf5.write(path, "drive", hdf5.flatten(self))

    @classmethod
    def load(cls, path: str | Path) -> Drive:
        """Read what `save` wrote. Raises DataError, one sentence, for anything else."""
        return hdf5.restore(cls, hdf5.read(path, "drive"), path)


def modulate(acceleration: FloatArray, rate_hz: float, carrier_hz: float) -> FloatArray:
    """Equation 1 of the paper: A_digital(t) = A_physical(t) sin(2 pi f_c t), t = 0 at the first sample."""
    t = np.arange(len(acceleration)) / rate_hz
    return np.asarray(acceleration * np.sin(2 * np.pi * carrier_hz * t))


@dataclass(frozen=True, eq=False)
class TargetGrid:
    """A press on the clock of its drive, at the press's own rate; arrays are (grid,).

    The grid is periodic and holds a margin before the press, the press, a margin after it (together
    `drive_length` samples, each of which becomes `oversampling` of the drive's), and the ringing, which
    must not wrap.
    """

    acceleration: FloatArray
    window: FloatArray
    """One within the drive, with faded ends, and zero after it."""
    drive_length: int
    """Length of the drive in samples at the press's rate."""
    start: int
    """Sample at which the press begins."""
    oversampling: int
    rate_hz: float
    carrier_hz: float

    @property
    def frequencies(self) -> FloatArray:
        """Frequencies of its lines (Hz)."""
        return np.asarray(scipy.fft.rfftfreq(len(self.window), 1 / self.rate_hz))

    def within(self, band: tuple[float, float]) -> tuple[FloatArray, float]:
        """(grid,) m/s^2 cut to `band` (Hz), and the share of the energy that is left."""
        spectrum = scipy.fft.rfft(self.acceleration)
        cut = spectrum * band_window(self.frequencies, *band)
        share = float((np.abs(cut) ** 2).sum() / (np.abs(spectrum) ** 2).sum())
        return np.asarray(scipy.fft.irfft(cut, len(self.window))), share

    def on_drive(self, signal: FloatArray) -> FloatArray:
        """(grid,) at the press's rate to the drive's length and rate."""
        return resample(signal, len(signal) * self.oversampling)[: self.drive_length * self.oversampling]

    @property
    def smooth(self) -> FloatArray:
        """`window` on the drive's clock."""
        edge = round(FADE * self.rate_hz) * self.oversampling
        return fade(self.drive_length * self.oversampling, edge, edge)


def target_grid(press: Representative, calibration: Calibration, method: Method) -> TargetGrid:
    """The target acceleration of a press, before band limit and scale.

    Raises DataError for a press that cannot be driven.
    """
    oversampling = _oversampling(press, calibration.rate_hz)
    edge = max(1, round(FADE / 2 * press.rate_hz))
    own = np.asarray(press.acceleration) * fade(len(press.acceleration), edge, edge)
    carrier_hz = calibration.carrier_hz if method == "modulated" else 0.0
    if method == "modulated":
        own = modulate(own, press.rate_hz, carrier_hz)
    before = round(BEFORE * press.rate_hz)
    drive_length = before + len(own) + round(_AFTER * press.rate_hz)
    ringing = round(actuation.ringing(calibration.model) * press.rate_hz)
    length = scipy.fft.next_fast_len(drive_length + ringing, real=True)
    acceleration, window = np.zeros(length), np.zeros(length)
    acceleration[before : before + len(own)] = own
    fading = round(FADE * press.rate_hz)
    window[:drive_length] = fade(drive_length, fading, fading)
    return TargetGrid(acceleration, window, drive_length, before, oversampling, press.rate_hz, carrier_hz)


def drive_for(
    press: Representative,
    calibration: Calibration | Response,
    limits: Limits,
    *,
    method: Method = "modulated",
    band: tuple[float, float] = BAND,
    inversion: Literal["optimised", "regularised"] = "optimised",
    trade: Trade = TRADE,
) -> Drive:
    """The drive that makes the calibrated point reproduce a press.

    The press is modulated with the point's resonance (equation 1 of the paper), or taken as it is for
    "broadband"; cut to the well-measured part of `band` (Hz), inverted non-causally, with the patch's
    hysteresis compensated; then scaled to the largest output within `limits` and the vibrometer's
    range. For output `trade.error` is accepted (0.5 %), or the least possible (see `inversion.max_output`;
    `inversion.min_peak` for "regularised", which is scaled to the limits instead of planned within them).
    Wherever the response was measured, motion outside the band counts as error; elsewhere the drive has no
    power. The drive has zero ends and zero mean. A response given without a calibration is fitted first.

    Raises DataError for a press that cannot be driven or a response that is too noisy, LimitError
    when the limits leave no headroom.
    """
    if isinstance(calibration, Response):
        calibration = Calibration.of(calibration)
    response = calibration.response
    grid = target_grid(press, calibration, method)
    band = actuation.measured_well(response, band)
    target, in_band = grid.within(band)

    limit = calibration.hysteresis.reach(limits.peak * min(1.0, actuation.path_gain(calibration)))
    plan = plan_for(calibration, target, grid.window, grid.rate_hz, band, limits)
    invert = max_output if inversion == "optimised" else min_peak
    planned, _ = invert(plan, trade.error or BUDGET)

    smooth = grid.smooth
    linear_volts = grid.on_drive(planned) * np.minimum(1.0, smooth / 0.05)
    # Back on the plan's grid, to predict the motion of the exact signal that will be played.
    length = len(grid.window)
    played = resample(np.pad(linear_volts, (0, length * grid.oversampling - len(linear_volts))), length)
    omega = 2j * np.pi * np.maximum(grid.frequencies, 1.0)
    shown_by = scipy.fft.rfft(played) * plan.gain * omega ** (DERIVATIVE[response.pickup] - 1)
    seen = scipy.fft.irfft(shown_by, length)
    range_scale = _RANGE_USED * response.pickup_range / float(np.abs(seen).max())
    scale = min(limit / float(np.abs(linear_volts).max()), range_scale)
    volts, scale = _within(limits, calibration, linear_volts, smooth, scale)
    if scale < range_scale:
        _, by = actuation.headroom(calibration, volts, limits)
    else:
        by = f"{_RANGE_USED:.0%} of the vibrometer's {shown(response.pickup, response.pickup_range)}"
    return Drive(
        button=press.button,
        patch=response.patch,
        point=response.point,
        rate_hz=calibration.rate_hz,
        volts=volts,
        target=scale * grid.on_drive(target),
        scale=scale,
        method=method,
        carrier_hz=grid.carrier_hz,
        band=band,
        in_band=in_band,
        known=actuation.known(calibration),
        predicted_error=float(np.hypot(plan.error(played), _distorted(calibration, plan, played))),
        unreached=_unreached(plan, played, grid.rate_hz, band, scale, in_band, by),
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
) -> Plan:
    """The plan, in linear volts, for a target ((grid,) m/s^2) within `band` (Hz).

    Motion that is not wanted counts wherever the response was measured, also outside the band.
    """
    f = scipy.fft.rfftfreq(len(target), 1 / rate_hz)
    low, high = actuation.known(calibration)
    known = (f >= low) & (f <= high)
    gain = np.where(known, actuation.gain(calibration, np.clip(f, low, high)), 0.0)
    slew = min(limits.slew, limits.current_peak / limits.capacitance if limits.capacitance else np.inf)
    return Plan(
        target=scipy.fft.rfft(target),
        gain=gain,
        known=known,
        uncertainty=actuation.uncertainty(calibration, f),
        window=window,
        typical=float(np.median(np.abs(gain[(f >= band[0]) & (f <= band[1])]) ** 2)),
        slew=slew / rate_hz / limits.peak,
    )


def _distorted(calibration: Calibration, plan: Plan, linear_volts: FloatArray) -> float:
    """Error expected from distortion, over the target's rms.

    Linear volts that the hysteresis model misses are spread over the band by it; the table then moves as it
    does there, also where the drive itself has little power.
    """
    target = np.abs(plan.target) ** 2
    inside = target > 1e-6 * target.max()
    spread = (np.abs(scipy.fft.rfft(linear_volts)) ** 2).sum() / inside.sum()
    missed = calibration.distortion**2 * spread * (np.abs(plan.gain[plan.known]) ** 2).sum()
    return float(_SPREAD * np.sqrt(missed / target.sum()))


def _oversampling(press: Representative, rate_hz: float) -> int:
    """Samples of the drive per sample of the press. Raises DataError for a press that cannot be driven."""
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
    linear_volts: FloatArray,
    smooth: FloatArray,
    scale: float,
) -> tuple[FloatArray, float]:
    """Volts to command for `linear_volts` times the largest factor up to `scale` within the limits.

    Limits hold for the volts commanded and for those that reach the patch. Returns the volts and
    the factor. Raises LimitError when no factor is found.
    """
    for _ in range(_TRIES):
        volts = actuation.commanded(calibration, scale * linear_volts, smooth)
        headroom, _ = actuation.headroom(calibration, volts, limits)
        if headroom >= 1:
            break
        # Hysteresis makes the volts nonlinear in the factor, so that it is found by iteration.
        scale *= headroom * (1 - 1e-6)
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
            f"The surface reproduces the shape at {scale:.1%} of the recorded acceleration, limited by {by}."
        )
    if in_band < _ALL:
        sentences.append(
            f"{1 - in_band:.0%} of the energy lies outside {band[0]:.0f} to {band[1]:.0f} Hz and is left out."
        )
    missed = scipy.fft.irfft((plan.target - plan.gain * scipy.fft.rfft(played)) * plan.known, len(played))
    error = float(np.linalg.norm(missed) / np.linalg.norm(scipy.fft.irfft(plan.target, len(played))))
    if error > BUDGET:
        centres, levels = third_octaves(missed, rate_hz, *band)
        sentences.append(
            f"{error:.1%} of the target is given up, most near "
            f"{centres[int(np.argmax(levels))]:.0f} Hz, for a larger output or because the response is not "
            "known better."
        )
    return " ".join(sentences)
