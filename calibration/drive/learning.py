"""Iterative learning: each play corrects the error of the one before, as long as the error measurably falls.

Plain iterative learning diverges with a stale response, and writes the measurement noise into the drive. So
a step without improvement is undone and halved, and in the end the best drive is replayed beside the first,
in plays that had no part in the selection. The corrections know the patch's even order as it is now: it is
identified anew before the first one, because no response describes it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...acquisition import hdf5
from ...instruments import ConfigurationError, Rig
from ...instruments.arrays import FloatArray
from ...instruments.progress import Progress, part_of, silent
from ..model import Calibration, even_order
from ..response import measure_both_signs, prepare
from .actuation import Actuation
from .agreement import SharedPower, dependence, error_spectra, followed, lines_inside, shared_power
from .correction import ResponseEstimate
from .drive import Drive
from .playing import Played, play_by_turns, refuse_foreign, target_of
from .verdict import LEAST_MOVED, UNSEEN, one_factor

__all__ = ["Iteration", "Learning", "learn"]

_STEP_SIGNIFICANCE = 1.0
"""Improvement, in standard deviations, required to accept a step."""
_STEP_HARM = 1.0
"""Rise of the whole motion's error, in standard deviations, at which a step is rejected."""
_FINAL_SIGNIFICANCE = 1.5
"""Improvement, in standard deviations, of the best drive over the first in the final replay, required to
keep the best. It rejects steps accepted by chance; as a requirement for each step it would stop learning
in noise."""
_MOTION_SIGNIFICANCE = 5.0
"""Standard deviations above zero of the plays' common motion, required to call it a motion."""
_LEAST_STEP = 0.25
_FACTOR = 0.1
"""Distance of a factor over the whole motion from one, from which nothing is learnt: `gain` of
`[recalibration]`, which adopts none either."""
_DISTURBED = "Something periodic disturbs the laser in step with the plays"


@dataclass(frozen=True, eq=False)
class Iteration:
    """One drive that was played, and its result.

    `volts` is (patches, samples) V as commanded, `accelerations` (plays, samples) m/s^2, the whole motion in
    each play, at `rate_hz`. `whole` is the squared error of the whole motion over the target's mean square,
    `within` the part of it within the drive's band.
    """

    volts: FloatArray
    accelerations: FloatArray
    rate_hz: float
    whole: SharedPower
    within: SharedPower
    kept: bool
    reason: str
    """Reason for keeping or rejecting it."""
    disturbed: bool = False
    """True when there is evidence that noise is not independent from play to play: its errors are wrong."""

    @property
    def measured(self) -> FloatArray:
        """(samples,) m/s^2: mean of the plays."""
        return np.asarray(self.accelerations.mean(axis=0))


@dataclass(frozen=True, eq=False)
class Learning:
    """Every drive that was tried; the first is the initial one.

    `best` is the number of the iteration whose drive is `drive`. `first_again` and `best_again` are the
    errors within the band of first and best in the final replay, alternately, after the last
    iteration: plays that had no part in the selection. Without an improvement they are those of the first
    iteration.
    """

    iterations: tuple[Iteration, ...]
    best: int
    first_again: float
    best_again: float
    stopped: str
    """Reason why learning ended."""
    drive: Drive

    def save(self, path: str | Path) -> None:
        """Write to a new HDF5 file, whole or not at all. Raises DataError if it exists."""
        hdf5.write(path, "learning", hdf5.flatten(self))

    @classmethod
    def load(cls, path: str | Path) -> Learning:
        """Read what `save` wrote. Raises DataError, one sentence, for anything else."""
        return hdf5.restore(cls, hdf5.read(path, "learning"), path)


def learn(
    rig: Rig,
    drive: Drive,
    calibration: Calibration | Sequence[Calibration],
    *,
    iterations: int = 5,
    plays: int = 8,
    progress: Progress = silent,
) -> Learning:
    """Improve a drive by playing it: `plays` plays, then up to `iterations` corrections of as many.

    It ends when the error reaches the plays' noise, when the expected improvement of a correction is below
    that noise, or when smaller steps bring no improvement; at once, when a signal left its range, the surface
    did not follow, or most of the error is one factor, as a laser that is askew makes it. The target stays
    unchanged. The result is the first drive, unless another was closer to the target by more than the noise
    of plays that had no part in its selection.
    `progress` is called with the plays done and their largest possible number.

    Raises ConfigurationError for fewer than three plays, or a drive of another calibration or rig, and
    what `Rig.excite` raises.
    """
    if plays < 3:
        raise ConfigurationError("Learning needs at least 3 plays: it has to tell error from noise.")
    table = Actuation.of(calibration, drive.points[1:])
    if drive.calibration != table.digest:
        raise ConfigurationError(
            "The drive was computed from another calibration than the one given: compute it again."
        )
    refuse_foreign(rig, drive)
    prepare(rig, drive.point)
    estimate = ResponseEstimate.of(drive, table)
    doing, total, done = f"Learn the {drive.button} button", (iterations + 3) * plays, 0

    def played(*waveforms: FloatArray) -> list[Played]:
        nonlocal done
        before, done = done, done + plays * len(waveforms)
        given = [replace(drive, volts=volts) for volts in waveforms]
        return play_by_turns(rig, given, plays, estimate.tail, part_of(progress, doing, before, total))

    [outcome] = played(drive.volts)
    first = _iteration(drive, drive.volts, outcome.accelerations, outcome.rate_hz)
    tried = [replace(first, kept=True, reason="the drive as computed")]
    best, step = 0, 1.0
    stopped = (
        _unlearnable(outcome, target_of(drive, outcome.rate_hz))
        or (f"{first.reason}. Nothing can be learnt from these plays." if first.disturbed else "")
        or _of_the_laser(first, target_of(drive, outcome.rate_hz))
        or _ended(tried, best, step, iterations)
    )
    if not stopped:
        estimate = _informed(rig, drive, table).after(drive.volts, outcome)
    while not stopped and not (stopped := _ended(tried, best, step, iterations)):
        volts, expected = estimate.correction(tried[best].volts, outcome, step, rig.limits)
        if expected < _STEP_SIGNIFICANCE * tried[best].within.deviation:
            stopped = "The expected improvement of a correction is below the plays' noise."
            break
        [result] = played(volts)
        estimate = estimate.after(volts, result)
        new = _iteration(drive, volts, result.accelerations, result.rate_hz)
        if result.overload or new.disturbed:
            new, step = replace(new, reason=result.overload or new.reason), step / 2
        elif _better(tried[best], new, _STEP_SIGNIFICANCE):
            new = replace(new, kept=True, reason="closer to the target by more than the noise")
            best, outcome = len(tried), result
        else:
            reason = "no closer to the target, or not by more than the noise"
            new, step = replace(new, reason=reason), step / 2
        tried.append(new)

    first_again, best_again = _again(drive, tried, best, played) if best else (tried[0], tried[0])
    disturbed = first_again.disturbed or best_again.disturbed
    if best and (disturbed or not _better(first_again, best_again, _FINAL_SIGNIFICANCE)):
        noise = "the best drive was not closer by more than the noise"
        stopped += f" Played again, {'the plays were disturbed' if disturbed else noise}: the first is kept."
        tried[1:] = [replace(iteration, kept=False) for iteration in tried[1:]]
        best = 0
    progress(doing, total, total, "plays")
    chosen = drive
    if best:
        # The whole motion errs by no less than the band: noise outside may say so.
        error = max(best_again.whole.root, best_again.within.root)
        chosen = replace(drive, volts=tried[best].volts, predicted_error=error)
    return Learning(tuple(tried), best, first_again.within.root, best_again.within.root, stopped, chosen)


def _informed(rig: Rig, drive: Drive, table: Actuation) -> ResponseEstimate:
    """The prior, with each patch's even order as it is now.

    It changes as a patch ages, and taken for an error of the response it would mislead every correction.
    """
    now = []
    for calibration in table.own:
        both = measure_both_signs(rig, calibration.response.patch, drive.point)
        law = replace(calibration.hysteresis, even=even_order(calibration, both))
        now.append(replace(calibration, hysteresis=law))
    return ResponseEstimate.of(drive, replace(table, rows=(tuple(now), *table.rows[1:])))


def _iteration(drive: Drive, volts: FloatArray, accelerations: FloatArray, rate_hz: float) -> Iteration:
    target = target_of(drive, rate_hz)
    accelerations = accelerations[:, : len(target)]
    missed = error_spectra(accelerations, target)
    inside = lines_inside(drive.band, len(target), rate_hz)
    whole, within = shared_power(missed), shared_power(missed[:, inside])
    evidence = dependence(missed, inside)
    said = f"{_DISTURBED}: {evidence}" if evidence else ""
    return Iteration(volts, accelerations, rate_hz, whole, within, False, said, bool(evidence))


def _better(before: Iteration, after: Iteration, significance: float) -> bool:
    """True when the error within the band fell significantly, and that of the whole motion did not rise so.

    The plays' noise within the band is a tenth of that of the whole motion: small improvements show there
    only.
    """
    fallen = _fallen(before.within, after.within) > significance
    return fallen and _fallen(before.whole, after.whole) > -_STEP_HARM


def _fallen(before: SharedPower, after: SharedPower) -> float:
    """Decrease of the squared error, in its standard deviations."""
    deviation = float(np.hypot(before.deviation, after.deviation))
    return (before.value - after.value) / max(deviation, 1e-30)


def _unlearnable(played: Played, target: FloatArray) -> str:
    """Reason why nothing can be learnt from the first plays; empty when something can."""
    if played.overload:
        return f"{played.overload} Nothing can be learnt from these plays."
    moved = shared_power(played.accelerations[:, : len(target)].astype(np.complex128))
    least, reach = LEAST_MOVED**2 * float(target @ target), _MOTION_SIGNIFICANCE * moved.deviation
    # Written so that NaN is refused too.
    if moved.value >= least and moved.value > reach:
        return ""
    if moved.value + reach >= least:
        return (
            "The plays' noise hides whether the surface follows the drive: the laser does not see the "
            "surface, or something disturbs it. Nothing can be learnt from these plays."
        )
    return f"The surface did not follow the drive: {UNSEEN}. Nothing can be learnt from these plays."


def _of_the_laser(first: Iteration, target: FloatArray) -> str:
    """Reason not to learn an error that a laser's scale makes as well; empty when there is none."""
    missed = error_spectra(first.accelerations[:, : len(target)], target)
    said = one_factor(first.whole, followed(missed, target), _FACTOR)
    return said and (
        f"{said} Nothing is learnt, because a wrong scale would make the drive wrong by it: aim the laser "
        "square to the surface; if the factor stays, calibrate the patch anew."
    )


def _ended(tried: list[Iteration], best: int, step: float, iterations: int) -> str:
    """Reason to end learning before another correction is planned; empty to continue."""
    if tried[best].within.root <= tried[best].within.floor:
        return "The error within the band is below the plays' noise."
    if step < _LEAST_STEP:
        return "Smaller steps brought no improvement."
    if len(tried) > iterations:
        return f"All {iterations} iterations were played."
    return ""


def _again(
    drive: Drive, tried: list[Iteration], best: int, played: Callable[..., list[Played]]
) -> tuple[Iteration, Iteration]:
    """First and best, played alternately so that a drift of the table affects both."""
    both = tried[0].volts, tried[best].volts
    first, last = (
        _iteration(drive, volts, result.accelerations, result.rate_hz)
        for volts, result in zip(both, played(*both), strict=True)
    )
    return first, last
