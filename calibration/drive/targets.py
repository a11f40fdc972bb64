"""Targets of a drive: the presses that points are to follow, on the clock of the drive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Literal

import numpy as np
import scipy

from ...base.arrays import FloatArray
from ...base.errors import DataError
from ..spectra import band_window, fade, resample
from .actuation import Actuation

if TYPE_CHECKING:
    from ...acquisition import Representative

Method = Literal["modulated", "broadband"]
"""Target of the surface: the press modulated with the table's resonance, as in the paper, or the press
itself."""

BEFORE, _AFTER = 0.30, 0.20
"""Seconds that a drive may begin before the press and end after it. Where patch and point differ, the
inverse is not causal: it moves the plate before the press, so that the point moves as the target does."""
FADE = 0.02
"""Fade time (s) at the start and at the end of a drive."""
_LEAST_RATE = 5000.0
"""Lowest sample rate (samples/s) at which a drive is optimised: eight samples a period at 600 Hz."""
_RATES = 10_000
"""Largest term of a ratio of two rates."""


def modulate(acceleration: FloatArray, rate_hz: float, carrier_hz: float) -> FloatArray:
    """Equation 1 of the paper: A_digital(t) = A_physical(t) sin(2 pi f_c t), t = 0 at the first sample."""
    t = np.arange(len(acceleration)) / rate_hz
    return np.asarray(acceleration * np.sin(2 * np.pi * carrier_hz * t))


@dataclass(frozen=True, eq=False)
class TargetGrid:
    """Presses on the clock of their drive, at their own rate.

    The grid is periodic and holds a margin before the presses, the longest of them, a margin after it
    (together `drive_length` samples, each of which becomes `oversampling` of the drive's), and the ringing,
    which must not wrap. `acceleration` is (points, grid) m/s^2, zero where nothing is to move, `window`
    (grid,).
    """

    acceleration: FloatArray
    window: FloatArray
    """One within the drive, with faded ends, and zero after it."""
    drive_length: int
    """Length of the drive in samples at the presses' rate."""
    start: int
    """Sample at which the presses begin."""
    oversampling: int
    rate_hz: float
    carriers: tuple[float, ...]
    """Carrier of each point (Hz); 0 without modulation."""

    @property
    def frequencies(self) -> FloatArray:
        """Frequencies of its lines (Hz)."""
        return np.asarray(scipy.fft.rfftfreq(len(self.window), 1 / self.rate_hz))

    def within(self, band: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
        """(points, grid) m/s^2 cut to `band` (Hz), and the shares (points,) of the energy that is left."""
        spectrum = scipy.fft.rfft(self.acceleration)
        cut = spectrum * band_window(self.frequencies, *band)
        left, whole = ((np.abs(one) ** 2).sum(axis=1) for one in (cut, spectrum))
        shares = np.where(whole > 0, left / np.where(whole > 0, whole, 1.0), 1.0)
        return np.asarray(scipy.fft.irfft(cut, len(self.window))), shares

    def on_drive(self, signal: FloatArray) -> FloatArray:
        """(..., grid) at the presses' rate to the drive's length and rate."""
        oversampled = resample(signal, signal.shape[-1] * self.oversampling)
        return oversampled[..., : self.drive_length * self.oversampling]

    @property
    def smooth(self) -> FloatArray:
        """`window` on the drive's clock."""
        edge = round(FADE * self.rate_hz) * self.oversampling
        return fade(self.drive_length * self.oversampling, edge, edge)


def target_grid(presses: Sequence[Representative | None], table: Actuation, method: Method) -> TargetGrid:
    """The target acceleration of each point, before band limit and scale: a press, or None for silence.

    The first is a press. Presses whose rate does not divide the drive's are resampled. Raises DataError for a
    press that cannot be driven.
    """
    rate_hz, oversampling = _rate([press for press in presses if press is not None], table.rate_hz)
    moved = [None if press is None else _at_rate(press, rate_hz) for press in presses]
    edge, before = max(1, round(FADE / 2 * rate_hz)), round(BEFORE * rate_hz)
    longest = max(len(own) for own in moved if own is not None)
    drive_length = before + longest + round(_AFTER * rate_hz)
    ringing = round(table.ringing * rate_hz)
    length = scipy.fft.next_fast_len(drive_length + ringing, real=True)
    acceleration, window = np.zeros((len(presses), length)), np.zeros(length)
    carriers = table.carriers if method == "modulated" else (0.0,) * len(presses)
    for row, signal, carrier_hz in zip(acceleration, moved, carriers, strict=True):
        if signal is None:
            continue
        own = signal * fade(len(signal), edge, edge)
        row[before : before + len(own)] = modulate(own, rate_hz, carrier_hz) if carrier_hz else own
    fading = round(FADE * rate_hz)
    window[:drive_length] = fade(drive_length, fading, fading)
    return TargetGrid(acceleration, window, drive_length, before, oversampling, rate_hz, carriers)


def _rate(presses: Sequence[Representative], drive_hz: float) -> tuple[float, int]:
    """Samples/s of the presses' grid, and samples of the drive per sample of it.

    The lowest rate that divides the drive's, and is none of the presses' rates too low for: a press of 5000
    samples/s is driven at 51,200/s on a grid of 5120. Raises DataError for a press that cannot be driven.
    """
    for press in presses:
        own = np.asarray(press.acceleration)
        moves = own.ndim == 1 and np.all(np.isfinite(own)) and np.any(own)
        if not moves or len(own) < 0.05 * press.rate_hz:
            raise DataError(f"The press of {press.button!r} holds no acceleration that could be driven.")
    if drive_hz < _LEAST_RATE:
        raise DataError(f"Drives have {drive_hz:g} samples/s, and {_LEAST_RATE:g} is the least.")
    wanted = max(_LEAST_RATE, *(press.rate_hz for press in presses))
    oversampling = max(1, int(drive_hz / wanted * (1 + 1e-6)))
    return drive_hz / oversampling, oversampling


def _at_rate(press: Representative, rate_hz: float) -> FloatArray:
    """(samples,) m/s^2 of a press at another rate; what it does not hold is not added."""
    ratio = Fraction(rate_hz / press.rate_hz).limit_denominator(_RATES)
    own = np.asarray(press.acceleration)
    return (
        own if ratio == 1 else np.asarray(scipy.signal.resample_poly(own, ratio.numerator, ratio.denominator))
    )
