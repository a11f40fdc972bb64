"""From a press to the drive: the volts of each patch that make the table reproduce it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
import scipy

from ...acquisition import hdf5
from ...instruments import DataError, Limits
from ...instruments.arrays import FloatArray
from ...instruments.notebook import InNotebook
from ...instruments.vibrometer import DERIVATIVE, shown
from ..model import Calibration, Drift
from ..response import Response
from ..spectra import band_window, fade, resample, third_octaves
from .actuation import Actuation
from .inversion import Plan
from .planning import distorted, plan_for, planned_by, quiet_motion
from .trade import BUDGET, STEADY, TRADE, Trade

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
_TRIES = 20
_RANGE_USED = 0.8
"""Share of the vibrometer's range that a drive may use."""
_REACH = 1000.0
"""V: no amplifier of a patch reaches this. A rig's own limits are lower, and are checked before a play."""
_ALL = 0.99
"""Fraction of the target above which nothing is reported as unreached."""


@dataclass(frozen=True, eq=False)
class Drive(InNotebook):
    """Volts for one or several patches, and the target motion of the surface.

    `volts` is (patches, samples) V at each patch as commanded, `target` is (samples,) m/s^2, on the same
    clock: the press's acceleration, modulated if that is the `method`, cut to `band` (Hz) and
    multiplied by `scale`. `in_band` is the share of that acceleration's energy which lies within the
    band. `predicted_error` is the error expected of the whole motion: rms of the error over rms of the
    target. Unmodelled hysteresis of the patch adds some percent; after learning it is the measured error.
    """

    button: str
    patches: tuple[str, ...]
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
    """Content hash of the calibrations used."""
    trade: Trade = TRADE
    """What it was planned for."""
    quiet_at: tuple[str, ...] = ()
    """Points that are to be silent."""
    quiet_motion: tuple[tuple[float, float], ...] = ()
    """For each, the rms motion expected there over the target's: as calibrated, and after the drift."""
    drift: Drift = STEADY
    """Drift of the table that was planned against."""
    drifted_error: float = 0.0
    """Error expected of the whole motion when the table has drifted so, `predicted_error` included; by
    `Drift()` where no drift was planned against."""

    def __post_init__(self) -> None:
        """Raises DataError for signals that no calibration makes, so that nobody plots or plays them."""
        finite = all(np.all(np.isfinite(signal)) for signal in (self.volts, self.target))
        shape = len(self.patches), len(self.target) if np.ndim(self.target) == 1 else 0
        if not finite or not all(shape) or np.shape(self.volts) != shape:
            raise DataError(
                "the drive and its target are not a signal for each patch and one for the target, of one "
                "length with finite values."
            )
        if len(set(self.patches)) < len(self.patches):
            raise DataError(f"the drive has two signals for one patch ({self.patch}).")
        if not 0 < self.rate_hz < np.inf:
            raise DataError(f"the drive has {self.rate_hz:g} samples/s.")
        if self.peak > _REACH:
            raise DataError(f"the drive reaches {self.peak:g} V, and no amplifier of a patch {_REACH:g} V.")

    def __repr__(self) -> str:
        simulated = ", simulated" if self.simulated else ""
        seconds = len(self.target) / self.rate_hz
        return (
            f"<Drive {self.button} at patch {self.patch}: {self.peak:.1f} V peak, {seconds:.2f} s{simulated}>"
        )

    @property
    def patch(self) -> str:
        """Names of the patches, for people."""
        return ", ".join(self.patches)

    @property
    def by_patch(self) -> dict[str, FloatArray]:
        """(samples,) V of each patch, as `Rig.excite_each` takes them."""
        return dict(zip(self.patches, self.volts, strict=True))

    @property
    def expected_error(self) -> float:
        """Error expected before any correction: where a drift is planned against, of a table that drifted."""
        return self.predicted_error if self.drift == STEADY else self.drifted_error

    @property
    def peak(self) -> float:
        """Largest voltage of any patch (V)."""
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
        """(..., grid) at the press's rate to the drive's length and rate."""
        oversampled = resample(signal, signal.shape[-1] * self.oversampling)
        return oversampled[..., : self.drive_length * self.oversampling]

    @property
    def smooth(self) -> FloatArray:
        """`window` on the drive's clock."""
        edge = round(FADE * self.rate_hz) * self.oversampling
        return fade(self.drive_length * self.oversampling, edge, edge)


def target_grid(press: Representative, table: Actuation, method: Method) -> TargetGrid:
    """The target acceleration of a press, before band limit and scale.

    Raises DataError for a press that cannot be driven.
    """
    oversampling = _oversampling(press, table.rate_hz)
    edge = max(1, round(FADE / 2 * press.rate_hz))
    own = np.asarray(press.acceleration) * fade(len(press.acceleration), edge, edge)
    carrier_hz = table.carrier.carrier_hz if method == "modulated" else 0.0
    if method == "modulated":
        own = modulate(own, press.rate_hz, carrier_hz)
    before = round(BEFORE * press.rate_hz)
    drive_length = before + len(own) + round(_AFTER * press.rate_hz)
    ringing = round(table.ringing * press.rate_hz)
    length = scipy.fft.next_fast_len(drive_length + ringing, real=True)
    acceleration, window = np.zeros(length), np.zeros(length)
    acceleration[before : before + len(own)] = own
    fading = round(FADE * press.rate_hz)
    window[:drive_length] = fade(drive_length, fading, fading)
    return TargetGrid(acceleration, window, drive_length, before, oversampling, press.rate_hz, carrier_hz)


def drive_for(
    press: Representative,
    calibration: Calibration | Response | Sequence[Calibration],
    limits: Limits,
    *,
    method: Method = "modulated",
    band: tuple[float, float] = BAND,
    inversion: Literal["optimised", "regularised"] = "optimised",
    trade: Trade = TRADE,
    quiet_at: Sequence[str] = (),
) -> Drive:
    """The drive that makes the calibrated point reproduce a press.

    `calibration` may be several, of several patches at that point, which an amplifier with a channel for each
    then drives at once. The press is modulated with the point's resonance (equation 1 of the paper), or taken
    as it is for "broadband"; cut to the well-measured part of `band` (Hz), inverted non-causally, with each
    patch's hysteresis compensated; then scaled to the largest output within `limits` and the vibrometer's
    range. `trade` says how much error is accepted for output, and which drift of the table is planned against
    (see `inversion.max_output`; `inversion.min_peak` for "regularised", which is scaled to the limits instead
    of planned within them). Wherever the response was measured, motion outside the band counts as error;
    elsewhere the drive has no power. Points of `quiet_at` are kept silent: each patch must be calibrated
    there too, and there are fewer of them than patches. The drive has zero ends and zero mean. A response
    given without a calibration is fitted first.

    Raises DataError for a press that cannot be driven or a response that is too noisy, LimitError
    when the limits leave no headroom.
    """
    if isinstance(calibration, Response):
        calibration = Calibration.of(calibration)
    table = Actuation.of(calibration, quiet_at)
    grid = target_grid(press, table, method)
    band = table.measured_well(band)
    target, in_band = grid.within(band)
    drift = trade.drift_for(table)
    targets = np.concatenate([target[None], np.zeros((len(quiet_at), len(target)))])
    drifting = plan_for(table, targets, grid, band, limits, Drift() if drift == STEADY else drift)
    steady = replace(drifting, drift=0.0)
    plan = steady if drift == STEADY else drifting
    planned = planned_by(plan, trade, trade.budget(drift), float(table.reach(limits).max()), inversion)

    smooth = grid.smooth
    linear_volts = grid.on_drive(planned) * np.minimum(1.0, smooth / 0.05)
    # Back on the plan's grid, to predict the motion of the exact signal that will be played.
    length = len(grid.window)
    finer = length * grid.oversampling
    played = resample(np.pad(linear_volts, ((0, 0), (0, finer - linear_volts.shape[1]))), length)
    response = table.own[0].response
    omega = 2j * np.pi * np.maximum(grid.frequencies, 1.0)
    shown_by = plan.moved(scipy.fft.rfft(played))[0] * omega ** (DERIVATIVE[response.pickup] - 1)
    range_scale = _RANGE_USED * response.pickup_range / float(np.abs(scipy.fft.irfft(shown_by, length)).max())
    wanted = np.inf if trade.scale is None else trade.scale
    reached = float((table.reach(limits) / np.abs(linear_volts).max(axis=1)).min())
    volts, scale = _within(limits, table, linear_volts, smooth, min(reached, range_scale, wanted))
    if scale == wanted:
        by = "the scale asked for"
    elif scale < range_scale:
        _, by = table.headroom(volts, limits)
    else:
        by = f"{_RANGE_USED:.0%} of the vibrometer's {shown(response.pickup, response.pickup_range)}"
    missed = distorted(table, plan, played)
    return Drive(
        button=press.button,
        patches=table.patches,
        point=table.points[0],
        rate_hz=table.rate_hz,
        volts=volts,
        target=scale * grid.on_drive(target),
        scale=float(scale),
        method=method,
        carrier_hz=grid.carrier_hz,
        band=band,
        in_band=in_band,
        known=table.known,
        predicted_error=float(np.hypot(steady.error(played), missed)),
        unreached=_unreached(steady, played, grid.rate_hz, band, scale, in_band, by),
        rig=response.rig,
        simulated=bool(press.simulated or response.simulated),
        sources=tuple((str(name), str(content)) for name, content in press.sources),
        calibration=table.digest,
        trade=trade,
        quiet_at=tuple(quiet_at),
        quiet_motion=quiet_motion(table, plan, played, grid, drift),
        drift=drift,
        drifted_error=float(np.hypot(drifting.error(played), missed)),
    )


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
    limits: Limits, table: Actuation, linear_volts: FloatArray, smooth: FloatArray, scale: float
) -> tuple[FloatArray, float]:
    """Volts to command for `linear_volts` times the largest factor up to `scale` within the limits.

    Limits hold for the volts commanded and for those that reach each patch. Returns the volts and
    the factor. Raises LimitError when no factor is found.
    """
    for _ in range(_TRIES):
        volts = table.commanded(scale * linear_volts, smooth)
        headroom, _ = table.headroom(volts, limits)
        if headroom >= 1:
            break
        # Hysteresis makes the volts nonlinear in the factor, so that it is found by iteration.
        scale *= headroom * (1 - 1e-6)
    for own in volts:
        limits.check(own, table.rate_hz)
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
    length = played.shape[1]
    missed = scipy.fft.irfft(plan.missed(scipy.fft.rfft(played))[0] * plan.known, length)
    error = float(np.linalg.norm(missed) / np.linalg.norm(scipy.fft.irfft(plan.target[0], length)))
    if error > BUDGET:
        centres, levels = third_octaves(missed, rate_hz, *band)
        sentences.append(
            f"{error:.1%} of the target is given up, most near "
            f"{centres[int(np.argmax(levels))]:.0f} Hz, for a larger output or because the response is not "
            "known better."
        )
    return " ".join(sentences)
