"""A check: the measured motion of a drive against its target, in parts."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from ...base import hdf5
from ...base.arrays import FloatArray
from ...base.errors import DataError
from ...base.notebook import InNotebook
from ..perception import LabThreshold
from .agreement import SharedPower, finite
from .drive import Drive

Verdict = Literal["pass", "fail", "not shown"]
"""Outcome of a check. Not shown: the plays do not tell on which side of the tolerance the error lies, because
of their noise, because that is not independent from play to play, or because something contradicts them."""

_NUMBERS = ("correlation", "envelope_correlation", "drift", "judged_hz", "drive_measured_peak", "tolerance")
"""Fields of a `Check` that are single numbers."""
_HELD = 30.0
"""Range (dB) below the strongest third-octave band within which a band is compared."""


def hertz(frequency: float) -> str:
    """A frequency (Hz) for people: "600 Hz", "2.5 kHz"."""
    return f"{frequency / 1e3:.3g} kHz" if frequency >= 1e3 else f"{frequency:.0f} Hz"


@dataclass(frozen=True, eq=False)
class ThirdOctaves:
    """Levels (bands,) in third octaves with the centres `hz`, in dB re 1 m/s^2."""

    hz: FloatArray
    target_db: FloatArray
    measured_db: FloatArray
    """Of the mean of the plays."""
    floor_db: FloatArray
    """Of the noise in that mean."""

    @property
    def error_db(self) -> float:
        """Rms difference (dB) over the bands within 30 dB of the target's strongest."""
        held = self.target_db > self.target_db.max(initial=-np.inf) - _HELD
        difference = (self.measured_db - self.target_db)[held]
        return float(np.sqrt(np.mean(difference**2))) if len(difference) else 0.0


@dataclass(frozen=True, eq=False)
class Tones:
    """Steady tones of the background, measured before each play and taken out of the measured motion."""

    hz: FloatArray
    share: float
    """Their rms, over the target's."""


@dataclass(frozen=True)
class Above:
    """What may move above the highest frequency that is judged.

    `octave` is the part of the error in the highest octave that is judged: as much may lie in the next one.
    `motion` is what the laser shows in the third octave `hz` above `judged_hz` where most evidence is, at the
    gain of the filter that it declares, folded down from above the card's Nyquist frequency or not; over the
    target's mean square, as the other errors. `bound` is the most that the error above may be, over the
    target, by the drive's spectrum and the measured response: where the laser's noise ends the band that is
    judged below the corner of its filter; None elsewhere. `near` is motion in the first third octave above
    what the laser passes, as the plays show it; None where they show nothing there.
    """

    octave: SharedPower
    hz: float = 0.0
    motion: SharedPower | None = None
    bound: float | None = None
    near: SharedPower | None = None

    def summary(self) -> dict[str, Any]:
        """Plain values for JSON."""
        motion = self.motion.summary() if self.motion else None
        near = self.near.summary() if self.near else None
        return {
            "octave": self.octave.summary(),
            "hz": self.hz,
            "motion": motion,
            "bound": self.bound,
            "near": near,
        }


@dataclass(frozen=True)
class Silence:
    """A point that is to be silent, and its motion within the drive's band, over the target's mean square."""

    point: str
    motion: SharedPower
    unseen: str = ""
    """Sentence that says why nothing was seen of it; empty for a point that the laser saw."""

    @property
    def contrast_db(self) -> float:
        """Level of the target over the motion here (dB): at least that, where noise hides the motion.

        NaN where nothing is known of it.
        """
        if self.unseen or not self.motion.possible:
            return float("nan")
        return float(-20 * np.log10(max(self.motion.root, self.motion.floor, 1e-6)))


@dataclass(frozen=True, eq=False)
class Check(InNotebook):
    """Measured motion of a drive against its target, with no gain, lag or filter fitted.

    `accelerations` is (plays, samples) m/s^2: the whole motion in each play, up to the corner of the laser's
    filter, or to a quarter of the sample rate; `target` (samples,) is on the same clock. `judged_hz` is that
    frequency, or a lower one, above which noise would leave nothing to be told (see `Above.bound`).
    `whole`, `within` and `outside` are squared errors over the target's mean square, without the plays' noise
    (see `agreement`): of all that motion, which is judged, and of its parts within the drive's band and
    outside of it. Each
    has a root, a 95 % confidence interval and a floor, the standard error of the mean of the plays; root and
    interval are NaN when the plays contradict that their noise is independent. `reasons` are the reasons for
    not passing, `notes` are other findings.
    """

    drive: Drive
    rate_hz: float
    target: FloatArray
    accelerations: FloatArray
    judged_hz: float
    whole: SharedPower
    within: SharedPower
    outside: SharedPower
    above: Above
    correlation: float
    """Pearson's correlation of the whole motion, without the plays' noise, and the target."""
    envelope_correlation: float
    octaves: ThirdOctaves
    drift: float
    """Change from the first to the last play; 0 when it is not significant."""
    tones: Tones
    drive_measured_peak: float
    """Largest voltage measured at the patch (V)."""
    overload: bool
    tolerance: float
    verdict: Verdict
    reasons: tuple[str, ...]
    notes: tuple[str, ...]
    simulated: bool
    silent: tuple[Silence, ...] = ()
    """Points that are to be silent, as the laser saw them."""
    others: tuple[Check, ...] = ()
    """The same drive as the laser saw it at each point with a button of its own."""
    lab: LabThreshold | None = None
    """Detection threshold of the lab's people, when the rig's file had one."""

    def refuse_nonsense(self) -> None:
        """See `hdf5.restore`. Raises DataError for motion that nobody can have measured."""
        signals = (self.target, self.accelerations)
        if not all(np.all(np.isfinite(one)) for one in signals) or not self.target.size:
            raise DataError("the check's target and plays have values that are not finite, or none.")
        if np.ndim(self.target) != 1 or self.accelerations.shape[1:] != self.target.shape:
            raise DataError("the check's plays are not as long as its target.")
        if any(part.plays != self.plays for part in (self.whole, self.within, self.outside)):
            raise DataError("the check has errors of another number of plays than its own.")
        octaves = self.octaves
        levels = (octaves.hz, octaves.target_db, octaves.measured_db, octaves.floor_db)
        if any(np.ndim(one) != 1 or len(one) != len(octaves.hz) for one in levels):
            raise DataError("the check does not have one level for each third-octave band.")
        if any(np.any(np.isnan(one)) for one in levels):
            raise DataError("the check has a third-octave level that is NaN.")
        if np.ndim(self.tones.hz) != 1 or not np.all(np.isfinite(self.tones.hz)):
            raise DataError("the check's tones of the background are not a row of finite frequencies.")
        if not 0 < self.rate_hz < 1e9:
            raise DataError(f"the check has {self.rate_hz:g} samples/s.")
        if self.verdict not in get_args(Verdict):
            raise DataError(f"the check has the verdict {self.verdict!r}: there is no such.")

    def __repr__(self) -> str:
        simulated = ", simulated" if self.simulated else ""
        return (
            f"<Check {self.drive.button}: {self.verdict}, error {self.whole.said}, "
            f"{self.plays} plays{simulated}>"
        )

    @property
    def error(self) -> float:
        """Rms error of the motion up to `judged_hz`, over the target's rms: the one that is judged."""
        return self.whole.root

    @property
    def allowed(self) -> float:
        """Upper end of the error's interval that the tolerance leaves beside what may lie above.

        What noise may hide there is independent of what it hides below, so that both reaches add as such.
        """
        shown, noise = self._above_the_laser
        reach = self.interval[1] ** 2 - max(self.whole.value, 0.0)
        beyond = (self.above.bound or 0.0) ** 2 + shown**2 + np.hypot(reach, noise**2) - reach
        return float(np.sqrt(max(self.tolerance**2 - beyond, 0.0)))

    @property
    def hidden(self) -> float:
        """Most that may move above what the laser passes, over the target.

        As the calibration showed it, and as the noise may hide it just above: of the calibration's noise and
        the plays', which is less.
        """
        return float(np.hypot(*self._above_the_laser))

    @property
    def _above_the_laser(self) -> tuple[float, float]:
        shown, noise, _ = self.drive.hidden
        if self.above.bound is not None:
            return shown, 0.0  # noise that ends the band below says nothing of what is above
        if self.above.near is not None and self.above.near.possible:
            noise = min(noise, self.above.near.interval[1])
        return shown, noise

    @property
    def interval(self) -> tuple[float, float]:
        """95 % confidence interval of `error`, from the differences between the plays."""
        return self.whole.interval

    @property
    def plays(self) -> int:
        """Number of plays."""
        return len(self.accelerations)

    @property
    def crosstalk_db(self) -> tuple[tuple[str, float], ...]:
        """Of each other button's point: level at most of its button here, over its motion there (dB).

        All motion within the band that is not wanted here is counted, whatever it is from.
        """
        here = max(self.within.root, self.within.floor, 1e-6) * float(np.linalg.norm(self.drive.target))
        return tuple(
            (one.point, float(20 * np.log10(here / np.linalg.norm(one.target))))
            for one in self.drive.elsewhere
            if one.button
        )

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
        return {
            **{name: getattr(self, name).summary() for name in ("whole", "within", "outside", "above")},
            **{name: finite(getattr(self, name)) for name in _NUMBERS},
            "third_octave_error_db": self.octaves.error_db,
            "tones_hz": self.tones.hz.tolist(),
            "tones": self.tones.share,
            "plays": self.plays,
            "silent": {one.point: finite(one.contrast_db) for one in self.silent},
            "crosstalk_db": {point: finite(level) for point, level in self.crosstalk_db},
            "others": {one.drive.point: one.summary() for one in self.others},
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
        verdict = " ".join([f"{self.verdict}.", *self.reasons]) if self.reasons else self.verdict
        return (
            f"error up to {hertz(self.judged_hz)} {self.whole.said}, in band {self.within.brief}, "
            f"outside {self.outside.brief}: {verdict}"
        )
