"""Targets of a drive: the presses that points are to follow, on the clock of the drive.

Other points than the drive's own have a button of their own, or silence (`OtherPoint`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from ...base.arrays import FloatArray
from ...base.errors import ConfigurationError, DataError
from ...base.filters import correlate, fast_length, resample_poly
from ..spectra import band_window, fade, resample
from .actuation import Actuation

if TYPE_CHECKING:
    from ...acquisition import AverageMethod, Representative
    from .drive import Drive


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
    oversampling: int
    rate_hz: float
    carriers: tuple[float, ...]
    """Carrier of each point (Hz); 0 without modulation."""

    @property
    def frequencies(self) -> FloatArray:
        """Frequencies of its lines (Hz)."""
        return np.asarray(np.fft.rfftfreq(len(self.window), 1 / self.rate_hz))

    def within(self, band: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
        """(points, grid) m/s^2 cut to `band` (Hz), and the shares (points,) of the energy that is left."""
        spectrum = np.fft.rfft(self.acceleration)
        cut = spectrum * band_window(self.frequencies, *band)
        left, whole = ((np.abs(one) ** 2).sum(axis=1) for one in (cut, spectrum))
        shares = np.where(whole > 0, left / np.where(whole > 0, whole, 1.0), 1.0)
        return np.asarray(np.fft.irfft(cut, len(self.window))), shares

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
    length = fast_length(drive_length + ringing)
    acceleration, window = np.zeros((len(presses), length)), np.zeros(length)
    carriers = table.carriers if method == "modulated" else (0.0,) * len(presses)
    for row, signal, carrier_hz in zip(acceleration, moved, carriers, strict=True):
        if signal is None:
            continue
        own = signal * fade(len(signal), edge, edge)
        row[before : before + len(own)] = modulate(own, rate_hz, carrier_hz) if carrier_hz else own
    fading = round(FADE * rate_hz)
    window[:drive_length] = fade(drive_length, fading, fading)
    return TargetGrid(acceleration, window, drive_length, oversampling, rate_hz, carriers)


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


def activation_time(press: Representative, drive: Drive) -> float:
    """Time (s) of the activation on the drive's clock, from the best fit of its modulation to the target."""
    step = round(drive.rate_hz / press.rate_hz)
    coarse = drive.target[::step]
    modulated = modulate(press.acceleration, press.rate_hz, drive.carrier_hz)
    fit = correlate(coarse, modulated)
    first = int(np.argmax(fit)) - (len(modulated) - 1)
    return float((first + press.activation_index) / press.rate_hz)


def _at_rate(press: Representative, rate_hz: float) -> FloatArray:
    """(samples,) m/s^2 of a press at another rate; what it does not hold is not added."""
    ratio = Fraction(rate_hz / press.rate_hz).limit_denominator(_RATES)
    return resample_poly(press.acceleration, ratio.numerator, ratio.denominator)


Wanted: TypeAlias = "Mapping[str, Representative | tuple[Representative, float] | None]"
"""What is wanted at other points: a press that is to be played there, alone or with its size over that of the
drive's own press, or None for silence."""

NOWHERE: Wanted = {}
_MOST = 100.0


def sized(wanted: Wanted) -> list[tuple[Representative | None, float]]:
    """Of each other point its press, None where it is silent, and its size over the drive's own.

    Raises ConfigurationError for a size that no press has.
    """
    each = [one if isinstance(one, tuple) else (one, 1.0) for one in wanted.values()]
    for point, (_, size) in zip(wanted, each, strict=True):
        if not 1 / _MOST <= size <= _MOST:
            raise ConfigurationError(
                f"The button at point {point} cannot be {size:g} times the size of the drive's own: it is "
                f"{1 / _MOST:g} to {_MOST:g} times."
            )
    return each


def load_elsewhere(
    also: Iterable[tuple[str, str | Path]],
    quiet_at: Iterable[str],
    times: Iterable[tuple[str, float]] = (),
    method: AverageMethod = "automatic",
) -> Wanted:
    """Read what is wanted at other points: `also` is points with a file of their press each, or with several
    recordings of it; the points `quiet_at` are to be silent; `times` are sizes of presses over the
    drive's own.

    Raises ConfigurationError for a point that is both, or a size without a press; and what `load_press`
    raises.
    """
    from ...acquisition import load_press  # noqa: PLC0415 - most plays read no press of a file

    files: dict[str, list[str | Path]] = {}
    for point, path in also:
        files.setdefault(point, []).append(path)
    silent, sizes = dict.fromkeys(quiet_at), dict(times)
    if both := sorted(files.keys() & silent.keys()):
        raise ConfigurationError(f"Point {both[0]} cannot be silent and play a press: leave one out.")
    if nowhere := sorted(sizes.keys() - files.keys()):
        raise ConfigurationError(f"A size is given for point {nowhere[0]}, and no press to play there.")
    own = {point: load_press(paths, method) for point, paths in files.items()}
    return {**{point: (press, sizes.get(point, 1.0)) for point, press in own.items()}, **silent}


@dataclass(frozen=True, eq=False)
class OtherPoint:
    """A point with a button of its own, in the words of `Drive`; or a silent one, whose target is zero."""

    point: str
    button: str
    """Name of the button; empty for a point that is to be silent."""
    target: FloatArray
    scale: float
    carrier_hz: float
    in_band: float
    sources: tuple[tuple[str, str], ...]
    unreached: str
    expected: tuple[float, float]
    """Rms error expected over the target's rms: as calibrated, and after the drift that is planned against.
    Of a silent point it is all motion, over the target of the drive's own point."""
    known_to: float
    """Standard deviation of the responses there, over them (rms)."""
    known_from: str
    """Source of the responses there, in words, and what above them is not known."""
