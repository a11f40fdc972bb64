"""Iterative learning: each play corrects the error of the one before, as long as the error measurably falls.

Plain iterative learning diverges with a stale response, and writes the measurement noise into the drive. So
a step without improvement is undone and halved, and in the end the best drive is replayed beside the first,
in plays that had no part in the selection. The corrections know the patch's even order as it is now: it is
identified anew before the first one, because no response describes it.

Where a drive plans for several points, the laser visits each of them, and one correction is for all: errors
are squared, over the target of each point, and summed. A silent point's error is its motion within the band.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...base import hdf5
from ...base.arrays import FloatArray
from ...base.errors import ConfigurationError
from ...base.progress import Progress, part_of, silent
from ...instruments import Rig
from ..model import Calibration, even_order
from ..response import measure_both_signs, prepare
from .actuation import Actuation
from .agreement import SharedPower, dependence, error_spectra, followed, lines_inside, shared_power, summed
from .correction import ResponseEstimate
from .drive import Drive
from .playing import Played, play_by_turns, refuse_foreign, targets_of
from .verdict import LEAST_MOVED, UNSEEN, one_factor

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

    `volts` is (patches, samples) V as commanded, `accelerations` (points, plays, samples) m/s^2, the whole
    motion in each play, at `rate_hz`. `each_whole` is, of each point, the squared error of the motion
    over the target's mean square, `each_within` the part of it within the drive's band. Of a silent point
    both are the motion within the band, over the target of the drive's own point: noise of the laser beyond
    the band hides what is silent.
    """

    volts: FloatArray
    accelerations: FloatArray
    rate_hz: float
    each_whole: tuple[SharedPower, ...]
    each_within: tuple[SharedPower, ...]
    kept: bool
    reason: str
    """Reason for keeping or rejecting it."""
    disturbed: bool = False
    """True when there is evidence that noise is not independent from play to play: its errors are wrong."""

    @property
    def whole(self) -> SharedPower:
        """`each_whole`, summed over the points."""
        return summed(self.each_whole)

    @property
    def within(self) -> SharedPower:
        """`each_within`, summed over the points."""
        return summed(self.each_within)

    @property
    def measured(self) -> FloatArray:
        """(points, samples) m/s^2: mean of the plays."""
        return np.asarray(self.accelerations.mean(axis=1))


@dataclass(frozen=True, eq=False)
class Learning:
    """Every drive that was tried; the first is the initial one.

    `best` is the number of the iteration whose drive is `drive`. `first_again` and `best_again` are the
    errors within the band, over all points, of first and best in the final replay, alternately, after the
    last iteration: plays that had no part in the selection. Without an improvement they are those of the
    first iteration.
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

    The laser visits each of the drive's points for every correction. It ends when the error reaches the
    plays' noise, when the expected improvement of a correction is below that noise, or when smaller steps
    bring no improvement; at once, when a signal left its range, the surface did not follow, or most of the
    error is one factor, as a laser that is askew makes it. The target stays unchanged. The result is the
    first drive, unless another was closer to the target by more than the noise of plays that had no part in
    its selection.
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
    estimate = ResponseEstimate.of(drive, table)
    total = (iterations + 3) * plays * len(drive.points)
    rounds = _Rounds(rig, drive, plays, estimate.tail, progress, total)
    [outcome] = rounds.played(drive.volts)
    first = _iteration(drive, drive.volts, outcome)
    tried = [replace(first, kept=True, reason="the drive as computed")]
    best, step = 0, 1.0
    stopped = (
        _unlearnable(drive, outcome)
        or (f"{first.reason}. Nothing can be learnt from these plays." if first.disturbed else "")
        or _of_the_laser(drive, outcome)
        or _ended(tried, best, step, iterations)
    )
    if not stopped:
        rounds.aim(drive.point)
        estimate = _informed(rig, drive, table).after(drive.volts, outcome)
    while not stopped and not (stopped := _ended(tried, best, step, iterations)):
        volts, expected = estimate.correction(tried[best].volts, outcome, step, rig.limits)
        if expected < _STEP_SIGNIFICANCE * tried[best].within.deviation:
            stopped = "The expected improvement of a correction is below the plays' noise."
            break
        [result] = rounds.played(volts)
        estimate = estimate.after(volts, result)
        new, overload = _iteration(drive, volts, result), _overload(result)
        if overload or new.disturbed:
            new, step = replace(new, reason=overload or new.reason), step / 2
        elif _better(tried[best], new, _STEP_SIGNIFICANCE):
            new = replace(new, kept=True, reason="closer to the target by more than the noise")
            best, outcome = len(tried), result
        else:
            reason = "no closer to the target, or not by more than the noise"
            new, step = replace(new, reason=reason), step / 2
        tried.append(new)

    first_again, best_again = _again(drive, tried, best, rounds) if best else (tried[0], tried[0])
    disturbed = first_again.disturbed or best_again.disturbed
    if best and (disturbed or not _better(first_again, best_again, _FINAL_SIGNIFICANCE)):
        noise = "the best drive was not closer by more than the noise"
        stopped += f" Played again, {'the plays were disturbed' if disturbed else noise}: the first is kept."
        tried[1:] = [replace(iteration, kept=False) for iteration in tried[1:]]
        best = 0
    progress(rounds.doing, total, total, "plays")
    chosen = drive
    if best:
        chosen = _measured(replace(drive, volts=tried[best].volts), best_again)
    return Learning(tuple(tried), best, first_again.within.root, best_again.within.root, stopped, chosen)


@dataclass
class _Rounds:
    """Plays of a drive's waveforms, in which the laser visits each of its points."""

    rig: Rig
    drive: Drive
    plays: int
    tail: float
    progress: Progress
    total: int
    done: int = 0
    aimed: str = ""

    @property
    def doing(self) -> str:
        """What the progress is of."""
        return f"Learn the {self.drive.button} button"

    def aim(self, point: str) -> None:
        """Aim the laser at a point, unless it is there."""
        if point != self.aimed:
            prepare(self.rig, point)
            self.aimed = point

    def played(self, *waveforms: FloatArray) -> list[tuple[Played, ...]]:
        """Of each waveform, its plays as the laser sees them at each point."""
        given, seen = [replace(self.drive, volts=volts) for volts in waveforms], {}
        # The point at which the laser is comes first: to move it may take a person.
        for point in sorted(self.drive.points, key=lambda point: point != self.aimed):
            self.aim(point)
            told = part_of(self.progress, self.doing, self.done, self.total)
            seen[point] = play_by_turns(self.rig, given, self.plays, self.tail, told)
            self.done += self.plays * len(waveforms)
        return list(zip(*(seen[point] for point in self.drive.points), strict=True))


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


def _iteration(drive: Drive, volts: FloatArray, seen: Sequence[Played]) -> Iteration:
    """One drive, as seen at each of its points."""
    rate_hz = seen[0].rate_hz
    targets = targets_of(drive, rate_hz)
    samples = targets.shape[1]
    inside = lines_inside(drive.band, samples, rate_hz)
    accelerations = np.array([one.accelerations[:, :samples] for one in seen])
    evidence, whole, within = "", [], []
    for own, target in zip(accelerations, targets, strict=True):
        missed = error_spectra(own, target, target if target.any() else targets[0])
        evidence = evidence or dependence(missed, inside)
        within.append(shared_power(missed[:, inside]))
        whole.append(shared_power(missed) if target.any() else within[-1])
    said = f"{_DISTURBED}: {evidence}" if evidence else ""
    return Iteration(volts, accelerations, rate_hz, tuple(whole), tuple(within), False, said, bool(evidence))


def _measured(drive: Drive, again: Iteration) -> Drive:
    """A drive with the errors that were measured of it in place of those that were expected."""
    # The motion errs by no less than the band. Outside of it there may be little but noise, and an error is
    # expected only as far as it was seen.
    errors = [
        max(whole.interval[0], within.root)
        for whole, within in zip(again.each_whole, again.each_within, strict=True)
    ]
    others = tuple(
        replace(one, expected=(error, one.expected[1]))
        for one, error in zip(drive.elsewhere, errors[1:], strict=True)
    )
    silent = [one.expected[0] for one in others if not one.button]
    return replace(drive, predicted_error=float(np.linalg.norm([errors[0], *silent])), elsewhere=others)


def _overload(seen: Sequence[Played]) -> str | None:
    """Sentence about a signal that left its range at one of the points, if any did."""
    return next((one.overload for one in seen if one.overload), None)


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


def _unlearnable(drive: Drive, seen: Sequence[Played]) -> str:
    """Reason why nothing can be learnt from the first plays; empty when something can."""
    if overload := _overload(seen):
        return f"{overload} Nothing can be learnt from these plays."
    each = zip(seen, targets_of(drive, seen[0].rate_hz), strict=True)
    return next(filter(None, (_unmoved(one, target) for one, target in each if target.any())), "")


def _unmoved(played: Played, target: FloatArray) -> str:
    """Reason why a point that has a target teaches nothing; empty when it does."""
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


def _of_the_laser(drive: Drive, seen: Sequence[Played]) -> str:
    """Reason not to learn an error that a laser's scale makes as well; empty when there is none."""
    for one, target in zip(seen, targets_of(drive, seen[0].rate_hz), strict=True):
        if not target.any():
            continue
        missed = error_spectra(one.accelerations[:, : len(target)], target)
        if said := one_factor(shared_power(missed), followed(missed, target), _FACTOR):
            return (
                f"{said} Nothing is learnt, because a wrong scale would make the drive wrong by it: aim the "
                "laser square to the surface; if the factor stays, calibrate the patch anew."
            )
    return ""


def _ended(tried: list[Iteration], best: int, step: float, iterations: int) -> str:
    """Reason to end learning before another correction is planned; empty to continue."""
    if tried[best].within.root <= tried[best].within.floor:
        return "The error within the band is below the plays' noise."
    if step < _LEAST_STEP:
        return "Smaller steps brought no improvement."
    if len(tried) > iterations:
        return f"All {iterations} iterations were played."
    return ""


def _again(drive: Drive, tried: list[Iteration], best: int, rounds: _Rounds) -> tuple[Iteration, Iteration]:
    """First and best, played alternately so that a drift of the table affects both."""
    both = tried[0].volts, tried[best].volts
    first, last = (
        _iteration(drive, volts, result) for volts, result in zip(both, rounds.played(*both), strict=True)
    )
    return first, last
