"""The closed loop: play a drive, measure the whole motion of the surface, and compare it with the target."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
import scipy

from ...acquisition import hdf5
from ...instruments import ConfigurationError, DataError, Rig
from ...instruments.arrays import ComplexArray, FloatArray
from ...instruments.notebook import InNotebook
from ...instruments.progress import Progress, part_of, silent
from ..perception import feeling_of
from ..response import prepare
from ..spectra import third_octaves
from .agreement import (
    SharedPower,
    dependence,
    error_spectra,
    lines_inside,
    odd_play,
    plays_needed,
    shared_power,
    trend,
)
from .drive import Drive
from .playing import Played, play, refuse_foreign, target_of

if TYPE_CHECKING:
    from ...acquisition import Representative

__all__ = ["LEAST_MOVED", "TOLERANCE", "UNSEEN", "Check", "Verdict", "check", "compare"]

Verdict = Literal["pass", "fail", "not shown"]
"""Outcome of a check. Not shown: the plays do not tell on which side of the tolerance the error lies, because
of their noise, or because that is not independent from play to play."""

TOLERANCE = 0.20
"""Largest error of the whole motion. About the just noticeable difference of vibration amplitude well above
threshold (docs/hardware.md, "Buttons and people")."""
LEAST_IN_BAND = 0.25
"""Smallest share of the modulated press's energy in the drive's band: matching less is no match."""
LEAST_MOVED = 0.3
"""Share of the target in the measured motion, below which the surface counts as not following the drive."""
UNSEEN = "the patch is not connected, or the laser does not see the surface"
_EXCESS = 1.02
"""Measured volts over the limit that are attributed to the monitor's noise and gain error."""
_NUMBERS = (
    "wideband_nrmse",
    "wideband_floor",
    "nrmse",
    "floor",
    "outside",
    "correlation",
    "envelope_correlation",
    "third_octave_error_db",
    "drift",
    "judged_hz",
    "background",
    "drive_measured_peak",
    "tolerance",
)
"""Fields of a `Check` that are single numbers."""
_TOLD = 0.05
"""Share of the target from which tones that were taken out are told."""
_HELD = 30.0
"""Range (dB) below the strongest third-octave band within which a band is compared."""
_LOWEST_OCTAVE = 20.0
"""Lowest third-octave band (Hz) that is shown; a play lasts about a second."""


@dataclass(frozen=True, eq=False)
class Check(InNotebook):
    """Measured motion of a drive against its target, with no gain, lag or filter fitted.

    `accelerations` is (plays, samples) m/s^2: the whole motion in each play, to the highest frequency that
    laser and card resolve (`judged_hz`); `target` (samples,) is on the same clock. All errors are rms over
    the target's rms, and without the plays' noise (see `agreement`); an interval is that of 95 % confidence,
    from the differences between the plays; both are NaN when the plays contradict that their noise is
    independent. `octaves_hz` are the centres of third-octave bands, `target_db`,
    `measured_db` (mean of the plays) and `floor_db` (noise in that mean) the levels in them (dB re 1 m/s^2);
    the third-octave error is the rms difference over the bands within 30 dB of the strongest. `reasons` are
    the reasons for not passing, `notes` are other findings.
    """

    drive: Drive
    rate_hz: float
    target: FloatArray
    accelerations: FloatArray
    judged_hz: float
    wideband_nrmse: float
    """Error of the whole motion: the one that is judged."""
    wideband_interval: tuple[float, float]
    wideband_floor: float
    """Standard error of the mean of the plays, whole motion."""
    nrmse: float
    """Error within the drive's band."""
    nrmse_interval: tuple[float, float]
    floor: float
    """Standard error of the mean of the plays, within the drive's band."""
    outside: float
    """Motion outside the drive's band."""
    outside_interval: tuple[float, float]
    correlation: float
    """Pearson's correlation of the whole motion, without the plays' noise, and the target."""
    envelope_correlation: float
    octaves_hz: FloatArray
    target_db: FloatArray
    measured_db: FloatArray
    floor_db: FloatArray
    third_octave_error_db: float
    drift: float
    """Change from the first to the last play; 0 when it is not significant."""
    tones_hz: FloatArray
    """Steady tones of the background (Hz), measured before each play and taken out of `accelerations`."""
    background: float
    """Rms of what was taken out, over the target's rms."""
    drive_measured_peak: float
    """Largest voltage measured at the patch (V)."""
    overload: bool
    tolerance: float
    verdict: Verdict
    reasons: tuple[str, ...]
    notes: tuple[str, ...]
    simulated: bool

    def refuse_nonsense(self) -> None:
        """See `hdf5.restore`. Raises DataError for motion that nobody can have measured."""
        signals = (self.target, self.accelerations)
        if not all(np.all(np.isfinite(one)) for one in signals) or not self.target.size:
            raise DataError("the check's target and plays have values that are not finite, or none.")
        if np.ndim(self.target) != 1 or self.accelerations.shape[1:] != self.target.shape:
            raise DataError("the check's plays are not as long as its target.")
        octaves = (self.octaves_hz, self.target_db, self.measured_db, self.floor_db)
        if any(np.ndim(one) != 1 or len(one) != len(self.octaves_hz) for one in octaves):
            raise DataError("the check does not have one level for each third-octave band.")
        if any(np.any(np.isnan(one)) for one in octaves):
            raise DataError("the check has a third-octave level that is no number.")
        if np.ndim(self.tones_hz) != 1 or not np.all(np.isfinite(self.tones_hz)):
            raise DataError("the check's tones of the background are not a row of finite frequencies.")
        if not 0 < self.rate_hz < 1e9:
            raise DataError(f"the check has {self.rate_hz:g} samples/s.")
        if self.verdict not in get_args(Verdict):
            raise DataError(f"the check has the verdict {self.verdict!r}: there is no such.")

    def __repr__(self) -> str:
        low, high = (100 * edge for edge in self.wideband_interval)
        simulated = ", simulated" if self.simulated else ""
        return (
            f"<Check {self.drive.button}: {self.verdict}, error {100 * self.wideband_nrmse:.1f} % "
            f"({low:.1f} to {high:.1f} %), {self.plays} plays{simulated}>"
        )

    @property
    def plays(self) -> int:
        """Number of plays."""
        return len(self.accelerations)

    @property
    def measured(self) -> FloatArray:
        """(samples,) m/s^2: mean of the plays, whole motion."""
        return np.asarray(self.accelerations.mean(axis=0))

    @property
    def noise(self) -> FloatArray:
        """(samples,) m/s^2 of the power of the noise left in `measured`: the first two plays' difference."""
        one, other = self.accelerations[:2]
        return np.asarray((one - other) / np.sqrt(2 * self.plays))

    @property
    def passed(self) -> bool:
        """True when the verdict is "pass"."""
        return self.verdict == "pass"

    def summary(self) -> dict[str, Any]:
        """Plain values for JSON, without the waveforms; NaN (nothing moved) becomes null."""
        intervals = ("wideband_interval", "nrmse_interval", "outside_interval")
        return {
            **{name: _finite(getattr(self, name)) for name in _NUMBERS},
            **{name: [_finite(edge) for edge in getattr(self, name)] for name in intervals},
            "plays": self.plays,
            "verdict": self.verdict,
            "passed": self.passed,
            "reasons": list(self.reasons),
            "notes": list(self.notes),
        }

    def save(self, path: str | Path) -> None:
        """Write to a new HDF5 file, whole or not at all. Raises DataError if it exists."""
        hdf5.write(path, "check", hdf5.flatten(self))

    @classmethod
    def load(cls, path: str | Path) -> Check:
        """Read what `save` wrote. Raises DataError, one sentence, for anything else."""
        return hdf5.restore(cls, hdf5.read(path, "check"), path)

    def __str__(self) -> str:
        low, high = self.wideband_interval
        verdict = " ".join([f"{self.verdict}.", *self.reasons]) if self.reasons else self.verdict
        return (
            f"error of the whole motion {self.wideband_nrmse:.3f} ({low:.3f} to {high:.3f}), in band "
            f"{self.nrmse:.3f}, outside {self.outside:.3f}: {verdict}"
        )


def check(
    rig: Rig,
    drive: Drive,
    press: Representative | None = None,
    *,
    plays: int = 8,
    progress: Progress = silent,
) -> Check:
    """Play a drive `plays` times and compare the whole motion of the surface with the drive's target.

    `press`, if given, must be the one that the drive was computed for: ConfigurationError
    otherwise. `progress` is called after each play. A signal that leaves its range, a dead
    patch or a blocked laser fails the check, with its reason. Raises ConfigurationError for fewer than
    three plays or a drive made for another rig or sample rate, and what `Rig.excite` raises.
    """
    if plays < 3:
        raise ConfigurationError("A check needs at least 3 plays: their differences are its uncertainty.")
    refuse_foreign(rig, drive)
    if press is not None and (press.button, tuple(press.sources)) != (drive.button, drive.sources):
        raise ConfigurationError(
            f"The drive was computed for another press than this one of {press.button!r}: compute it again."
        )
    prepare(rig, drive.point)
    doing = f"Check the {drive.button} button"
    played = play(rig, drive, plays, progress=part_of(progress, doing, 0, plays))
    return compare(drive, played, rig)


def compare(drive: Drive, played: Played, rig: Rig) -> Check:
    """Compare measured plays with the target of their drive."""
    rate_hz = played.rate_hz
    target = target_of(drive, rate_hz)
    accelerations = played.accelerations[:, : len(target)]
    inside = lines_inside(drive.band, len(target), rate_hz)
    missed = error_spectra(accelerations, target)
    still = error_spectra(np.zeros((1, len(target))), target)
    moved = missed - still
    whole, within = shared_power(missed), shared_power(missed[:, inside])
    outside, motion = shared_power(moved[:, ~inside]), shared_power(moved)
    mean = accelerations.mean(axis=0)
    band_only = scipy.fft.irfft(np.where(inside, scipy.fft.rfft(mean), 0.0), len(mean))
    octaves_hz, target_db = third_octaves(target, rate_hz, _LOWEST_OCTAVE, played.judged_hz)
    _, measured_db = third_octaves(mean, rate_hz, _LOWEST_OCTAVE, played.judged_hz)
    difference = (measured_db - target_db)[target_db > target_db.max(initial=-np.inf) - _HELD]
    result = Check(
        drive=drive,
        rate_hz=rate_hz,
        target=target,
        accelerations=accelerations,
        judged_hz=played.judged_hz,
        wideband_nrmse=whole.root,
        wideband_interval=whole.interval,
        wideband_floor=whole.floor,
        nrmse=within.root,
        nrmse_interval=within.interval,
        floor=within.floor,
        outside=outside.root,
        outside_interval=outside.interval,
        correlation=_correlation(moved.mean(axis=0), -still[0], motion),
        envelope_correlation=_pearson(
            np.abs(scipy.signal.hilbert(band_only)), np.abs(scipy.signal.hilbert(target))
        ),
        octaves_hz=octaves_hz,
        target_db=target_db,
        measured_db=measured_db,
        floor_db=_floor_db(accelerations, rate_hz, played.judged_hz),
        third_octave_error_db=float(np.sqrt(np.mean(difference**2))) if len(difference) else 0.0,
        drift=trend(moved[:, inside]),
        tones_hz=played.tones_hz,
        background=played.tones_rms / float(np.sqrt(np.mean(target**2))),
        drive_measured_peak=played.peak,
        overload=played.overload is not None,
        tolerance=TOLERANCE,
        verdict="pass",
        reasons=(),
        notes=(),
        simulated=rig.simulated or drive.simulated,
    )
    followed = abs(float(np.vdot(still[0], moved.mean(axis=0)).real))
    odd = odd_play(moved[:, inside])
    evidence = dependence(missed, inside)
    if evidence:
        result = _without_errors(result)
    return _judged(result, whole, followed, odd, evidence, played.overload, rig.limits.peak)


def _without_errors(result: Check) -> Check:
    """The check without the numbers that are wrong when noise is not independent from play to play."""
    nothing = float("nan")
    return replace(
        result,
        wideband_nrmse=nothing,
        wideband_interval=(nothing, nothing),
        nrmse=nothing,
        nrmse_interval=(nothing, nothing),
        outside=nothing,
        outside_interval=(nothing, nothing),
        correlation=nothing,
    )


def _judged(
    result: Check,
    whole: SharedPower,
    followed: float,
    odd: tuple[int, float],
    evidence: str,
    overload: str | None,
    peak: float,
) -> Check:
    """The check with its verdict, reasons and notes.

    `followed` is the share of the target in the motion, `evidence` that noise is not independent.
    """
    drive, failures = result.drive, []
    low, high = result.wideband_interval
    said = f"{result.wideband_nrmse:.1%} rms (95 % confidence: {low:.1%} to {high:.1%})"
    if overload:
        failures.append(overload)
    if result.drive_measured_peak > _EXCESS * peak:
        failures.append(
            f"The patch got {result.drive_measured_peak:.1f} V, and the rig's limit is {peak:.1f} V."
        )
    if result.drive_measured_peak < 0.8 * drive.peak:
        failures.append(
            f"The patch got {result.drive_measured_peak:.2g} V where the drive has {drive.peak:.1f} V: "
            "check the amplifier, the relay and the drive monitor."
        )
    # Written so that NaN fails too.
    if not evidence and not low <= result.tolerance:
        failures.append(
            f"The whole motion of the surface differs from the target by {said}, and {result.tolerance:.0%} "
            f"is accepted: {result.nrmse:.1%} within {drive.band[0]:.0f} to {drive.band[1]:.0f} Hz, and "
            f"{result.outside:.1%} outside."
        )
    if not drive.in_band >= LEAST_IN_BAND:
        failures.append(
            f"Only {drive.in_band:.1%} of the press's energy lies in the {drive.band[0]:.0f} to "
            f"{drive.band[1]:.0f} Hz that were played, and {LEAST_IN_BAND:.0%} is needed."
        )
    if failures and followed < LEAST_MOVED:
        failures.append(f"The surface followed {followed:.1%} of the target motion: {UNSEEN}.")
    elif failures and drive.predicted_error > result.tolerance:
        failures.append(
            f"The error predicted when the drive was computed is {drive.predicted_error:.1%}: within the "
            "limits, and with this calibration, the table cannot follow the press."
        )
    notes = _notes(result, odd)
    number, by = odd
    if failures:
        return replace(result, verdict="fail", reasons=tuple(failures), notes=notes)
    if by > result.tolerance:
        reason = f"Not shown: play {number} is not of the same motion as the others; check again."
        return replace(result, verdict="not shown", reasons=(reason,), notes=notes)
    if evidence:
        reason = (
            f"Not shown: {evidence}, which independent noise does not do. Something periodic disturbs the "
            "laser in step with the plays (mains, a fan, a motor): stop it, and check again."
        )
        return replace(result, verdict="not shown", reasons=(reason,), notes=notes)
    if high <= result.tolerance:
        return replace(result, verdict="pass", notes=notes)
    needed = plays_needed(whole, result.tolerance)
    remedy = (
        f"{needed} plays would probably show it."
        if needed
        else "More plays would not: use a range or filter of the vibrometer with less noise, or more output."
    )
    reason = (
        f"Not shown: the whole motion differs from the target by {said}, which does not tell on "
        f"which side of the accepted {result.tolerance:.0%} it lies. {remedy}"
    )
    return replace(result, verdict="not shown", reasons=(reason,), notes=notes)


def _notes(result: Check, odd: tuple[int, float]) -> tuple[str, ...]:
    notes = []
    number, by = odd
    if result.background > _TOLD:
        tones = ", ".join(f"{hz:.1f}" for hz in result.tones_hz)
        notes.append(
            f"The background has steady tones at {tones} Hz, {result.background:.0%} of the target, which "
            "were measured before each play and taken out: look for mains hum (ground the laser's cable), a "
            "fan or a motor."
        )
    if number:
        notes.append(
            f"Play {number} of {result.plays} differs from all others by {by:.1%} of the target: something "
            "shook or touched the table, or the patch had not settled."
        )
    if result.drift > 0:
        notes.append(
            f"The motion changed by {result.drift:.1%} of the target from the first play to the last: the "
            "table or the patch had not settled, or its temperature changes."
        )
    drowned = (result.floor_db > result.target_db.max() + 20 * np.log10(result.tolerance)) & (
        result.octaves_hz > result.drive.band[1]
    )
    if np.any(drowned):
        notes.append(
            f"Above {result.octaves_hz[drowned][0] / 10**0.05:.0f} Hz, the noise left in the mean of "
            f"{result.plays} plays exceeds {result.tolerance:.0%} of the target's strongest third octave: "
            "single tones there would not be seen; more plays, or a narrower filter of the vibrometer, "
            "resolve more."
        )
    warning = feeling_of(result.target, result.measured, result.rate_hz).warning
    return tuple([*notes, warning] if warning else notes)


def _floor_db(accelerations: FloatArray, rate_hz: float, judged_hz: float) -> FloatArray:
    """Third-octave levels (dB re 1 m/s^2) of the noise left in the mean of (plays, samples)."""
    plays = len(accelerations)
    each = [
        10 ** (third_octaves(deviation, rate_hz, _LOWEST_OCTAVE, judged_hz)[1] / 10)
        for deviation in accelerations - accelerations.mean(axis=0)
    ]
    return np.asarray(10 * np.log10(np.maximum(np.sum(each, axis=0) / (plays * (plays - 1)), 1e-30)))


def _correlation(moved: ComplexArray, wanted: ComplexArray, motion: SharedPower) -> float:
    """Correlation of the mean motion with the target (power one), without noise; zero when nothing moved."""
    if not motion.value > 0:
        return 0.0
    return float(np.clip(np.vdot(wanted, moved).real / motion.root, -1.0, 1.0))


def _pearson(a: FloatArray, b: FloatArray) -> float:
    """Pearson's correlation; zero when a signal is constant."""
    a, b = a - a.mean(), b - b.mean()
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / size if size > 0 else 0.0


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
