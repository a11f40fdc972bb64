"""The closed loop: play a drive, measure the surface, and compare with the target."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft, rfftfreq
from scipy.signal import hilbert

from haploop.acquisition import hdf5
from haploop.calibration.drive.drive import Drive
from haploop.calibration.response import overloaded, prepare
from haploop.calibration.spectra import band_window, fade, third_octaves
from haploop.instruments import Capture, ConfigurationError, Rig
from haploop.instruments.arrays import FloatArray
from haploop.instruments.progress import Progress, part_of, silent

if TYPE_CHECKING:
    from haploop.acquisition import Representative

__all__ = ["Check", "check"]

TOLERANCE = 0.20
"""About the just noticeable difference of vibration amplitude (docs/hardware.md, "Buttons and people")."""
FLOORS = 1.6
"""Tolerance over the floor, at least: a tolerance cannot lie much below the spread of the plays."""
CORRELATION = 0.97
LEAST_IN_BAND = 0.25
"""Smallest share of the modulated press's energy in the drive's band: matching less is no match."""
LEAST_MOVED = 0.3
"""Measured over target motion, below which the surface counts as not following the drive."""
UNSEEN = "the patch is not connected, or the laser does not see the surface"
_TAIL = 0.1
"""Recording time (s) after the drive, so that the vibrometer's delay truncates nothing."""
_EXCESS = 1.02
"""Measured volts over the limit that are attributed to the monitor's noise and gain error."""
_HELD = 30.0
"""Range (dB) below the strongest third-octave band within which a band is compared."""


@dataclass(frozen=True, eq=False)
class Check:
    """Measured motion of a drive against its target, with no gain or lag fitted.

    `measured` is (samples,) m/s^2, the mean of the plays, on the clock of `drive.target` and in its
    band. `nrmse` is the rms of the difference over the target's rms; `floor` is the standard error
    of the mean of the plays, over the same. `octaves_hz` are the centres of third-octave bands,
    `target_db` and `measured_db` the levels in them (dB re 1 m/s^2); the error is the rms difference
    over the bands within 30 dB of the strongest. `reasons` are the reasons for a failure, empty when it
    passed.
    """

    drive: Drive
    plays: int
    measured: FloatArray
    nrmse: float
    correlation: float
    envelope_correlation: float
    floor: float
    octaves_hz: FloatArray
    target_db: FloatArray
    measured_db: FloatArray
    third_octave_error_db: float
    drive_measured_peak: float
    """Largest voltage measured at the patch (V)."""
    overload: bool
    tolerance: float
    reasons: tuple[str, ...]
    simulated: bool

    @property
    def passed(self) -> bool:
        """True when there is no reason to fail."""
        return not self.reasons

    @property
    def beyond_noise(self) -> float:
        """Error without the plays' noise, over the target: it stems from model and limits."""
        return float(np.sqrt(max(self.nrmse**2 - self.floor**2, 0.0)))

    def save(self, path: str | Path) -> None:
        """Write to a new HDF5 file, whole or not at all. Raises DataError if it exists."""
        hdf5.write(path, "check", hdf5.flatten(self))

    @classmethod
    def load(cls, path: str | Path) -> Check:
        """Read what `save` wrote. Raises DataError, one sentence, for anything else."""
        return hdf5.restore(cls, hdf5.read(path, "check"), path)

    def __str__(self) -> str:
        verdict = "pass" if self.passed else "fail. " + " ".join(self.reasons)
        return (
            f"error {self.nrmse:.3f}, correlation {self.correlation:.3f}, floor {self.floor:.3f}: {verdict}"
        )


def check(
    rig: Rig,
    drive: Drive,
    press: Representative | None = None,
    *,
    plays: int = 8,
    progress: Progress = silent,
) -> Check:
    """Play a drive `plays` times and compare the motion of the surface with the drive's target.

    `press`, if given, must be the one that the drive was computed for: ConfigurationError
    otherwise. `progress` is called after each play. A signal that leaves its range, a dead
    patch or a blocked laser fails the check, with its reason. Raises ConfigurationError for fewer than
    two plays or a drive made for another rig or sample rate, and what `Rig.excite` raises.
    """
    if plays < 2:
        raise ConfigurationError("A check needs at least 2 plays: their difference is its floor.")
    refuse_foreign(rig, drive)
    if press is not None and (press.button, tuple(press.sources)) != (drive.button, drive.sources):
        raise ConfigurationError(
            f"The drive was computed for another press than this one of {press.button!r}: compute it again."
        )
    prepare(rig, drive.point)
    doing = f"Check the {drive.button} button"
    played = play(rig, drive, plays, progress=part_of(progress, doing, 0, plays))
    return compare(drive, played, rig)


@dataclass(frozen=True, eq=False)
class Played:
    """Measurements of several plays of one drive: `accelerations` is (plays, samples) m/s^2."""

    accelerations: FloatArray
    peak: float
    """Largest voltage at the patch (V)."""
    overload: str | None
    """Sentence about the signal that left its range, if any."""


def play(
    rig: Rig,
    drive: Drive,
    plays: int,
    tail: float = 0.0,
    progress: Progress = silent,
) -> Played:
    """Play a drive and measure the surface on the drive's clock and in its band, for `tail` s longer."""
    samples = len(drive.volts) + round(tail * drive.rate_hz)
    channels = (rig.monitor(drive.patch), rig.vibrometer.channel)
    accelerations, peaks, problems = [], [], []
    for number in range(plays):
        capture = rig.excite(drive.volts, (drive.patch,), channels, tail + _TAIL)
        accelerations.append(_acceleration(rig, capture, drive)[:samples])
        peaks.append(_peak(rig, capture))
        problems.append(overloaded(rig, capture))
        progress("Play", number + 1, plays, "plays")
    return Played(np.array(accelerations), max(peaks), next((p for p in problems if p), None))


def errors(accelerations: FloatArray, target: FloatArray) -> tuple[float, float]:
    """Rms error of the mean of the plays, and its standard error, both over the target's rms."""
    size = _rms(target)
    spread = np.mean(np.var(accelerations, axis=0, ddof=1)) / len(accelerations)
    return _rms(accelerations.mean(axis=0) - target) / size, float(np.sqrt(spread)) / size


def refuse_foreign(rig: Rig, drive: Drive) -> None:
    """Raises ConfigurationError for a drive that was not computed for this rig."""
    if drive.rig != rig.name:
        raise ConfigurationError(
            f"The drive was computed from a calibration of the rig {drive.rig!r}, and this is {rig.name!r}: "
            "calibrate this rig and compute it again."
        )
    if drive.rate_hz != rig.table.rate_hz:
        raise ConfigurationError(
            f"The drive has {drive.rate_hz:g} samples/s and the rig plays {rig.table.rate_hz:g}: "
            "calibrate on this rig and compute it again."
        )


def compare(drive: Drive, played: Played, rig: Rig) -> Check:
    """Compare measured plays with the target of their drive."""
    target, measured = drive.target, played.accelerations.mean(axis=0)
    nrmse, floor = errors(played.accelerations, target)
    centres, target_db = third_octaves(target, drive.rate_hz, *drive.band)
    _, measured_db = third_octaves(measured, drive.rate_hz, *drive.band)
    held = target_db > target_db.max(initial=-np.inf) - _HELD
    difference = (measured_db - target_db)[held]
    result = Check(
        drive=drive,
        plays=len(played.accelerations),
        measured=measured,
        nrmse=nrmse,
        correlation=_correlation(measured, target),
        envelope_correlation=_correlation(np.abs(hilbert(measured)), np.abs(hilbert(target))),
        floor=floor,
        octaves_hz=centres,
        target_db=target_db,
        measured_db=measured_db,
        third_octave_error_db=float(np.sqrt(np.mean(difference**2))) if len(difference) else 0.0,
        drive_measured_peak=played.peak,
        overload=played.overload is not None,
        tolerance=max(TOLERANCE, FLOORS * floor),
        reasons=(),
        simulated=rig.simulated or drive.simulated,
    )
    return replace(result, reasons=_reasons(result, played.overload, rig.limits.peak))


def _acceleration(rig: Rig, capture: Capture, drive: Drive) -> FloatArray:
    """(samples,) m/s^2 of one capture, on the drive's clock and in its band."""
    laser = capture.channels.index(rig.vibrometer.channel)
    velocity = rig.vibrometer.to_velocity(capture.volts[laser])
    velocity = velocity - velocity[: max(1, round(0.05 * drive.rate_hz))].mean()
    edge = round(_TAIL / 4 * capture.rate_hz)
    length = next_fast_len(len(velocity), real=True)
    f = rfftfreq(length, 1 / capture.rate_hz)
    late = np.exp(2j * np.pi * f * capture.delays[laser]) * rig.vibrometer.response(f)
    window = band_window(f, *drive.band, outside=True)
    spectrum = rfft(velocity * fade(len(velocity), 0, edge), length)
    return np.asarray(irfft(spectrum * window * 2j * np.pi * f / late, length)[: len(velocity)])


def _peak(rig: Rig, capture: Capture) -> float:
    assert rig.sensors.drive is not None
    monitor = capture.channels.index(rig.sensors.drive.channels[0])
    return float(np.abs(rig.sensors.drive.to_si(capture.volts[[monitor]])).max())


def _reasons(result: Check, overload: str | None, peak: float) -> tuple[str, ...]:
    drive, reasons = result.drive, []
    if overload:
        reasons.append(overload)
    if result.drive_measured_peak > _EXCESS * peak:
        reasons.append(
            f"The patch got {result.drive_measured_peak:.1f} V, and the rig's limit is {peak:.1f} V."
        )
    if result.drive_measured_peak < 0.8 * drive.peak:
        reasons.append(
            f"The patch got {result.drive_measured_peak:.2g} V where the drive has {drive.peak:.1f} V: "
            "check the amplifier, the relay and the drive monitor."
        )
    moved = _rms(result.measured) / _rms(drive.target)
    # Written so that NaN fails too.
    if not result.nrmse <= result.tolerance:
        reasons.append(
            f"The surface differs from the target by {result.nrmse:.1%} rms, "
            f"and {result.tolerance:.1%} is accepted."
        )
    if not result.correlation >= CORRELATION:
        reasons.append(
            f"The correlation with the target is {result.correlation:.3f}, and {CORRELATION} is needed."
        )
    if not drive.in_band >= LEAST_IN_BAND:
        reasons.append(
            f"Only {drive.in_band:.1%} of the press's energy lies in the {drive.band[0]:.0f} to "
            f"{drive.band[1]:.0f} Hz that were played, and {LEAST_IN_BAND:.0%} is needed."
        )
    if reasons and moved < LEAST_MOVED:
        reasons.append(f"The surface moved {moved:.1%} of the target motion: {UNSEEN}.")
    elif reasons and result.floor > TOLERANCE / FLOORS:
        reasons.append(
            f"The mean of {result.plays} plays is uncertain by {result.floor:.1%} of the target: the "
            "vibrometer's noise hides the motion of the surface."
        )
    elif reasons and drive.predicted_error > result.tolerance:
        reasons.append(
            f"The error predicted when the drive was computed is {drive.predicted_error:.1%}: within the "
            "limits, and with the noise in this calibration, the table cannot follow the press."
        )
    return tuple(reasons)


def _rms(signal: FloatArray) -> float:
    return float(np.sqrt(np.mean(signal**2)))


def _correlation(a: FloatArray, b: FloatArray) -> float:
    """Pearson's correlation; zero when a signal is constant."""
    a, b = a - a.mean(), b - b.mean()
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / size if size > 0 else 0.0
