"""Iterative learning: each play corrects the error of the one before, as long as the error measurably falls.

Plain iterative learning diverges with a stale response, and writes the measurement noise into the drive. So
a step without improvement is undone and halved, and in the end the best drive is replayed beside the first,
in plays that had no part in the selection.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from haploop.acquisition import hdf5
from haploop.calibration.drive.check import LEAST_MOVED, UNSEEN, Played, errors, play, refuse_foreign
from haploop.calibration.drive.correction import ResponseEstimate
from haploop.calibration.drive.drive import Drive
from haploop.calibration.model import Calibration
from haploop.calibration.response import prepare
from haploop.instruments import ConfigurationError, Rig
from haploop.instruments.arrays import FloatArray, IntArray
from haploop.instruments.progress import Progress, part_of, silent

__all__ = ["Iteration", "Learning", "learn"]

FLOORS = 1.2
"""Error over the floor at which the floor counts as reached: at most a third of the error's power is then
not noise."""
_STEP_SIGNIFICANCE = 1.0
"""Improvement, in standard deviations, required to accept a step."""
_FINAL_SIGNIFICANCE = 1.5
"""Improvement, in standard deviations, of the best drive over the first in the final replay, required to
keep the best. It rejects steps accepted by chance; as a requirement for each step it would stop learning
in noise."""
_MOTION_SIGNIFICANCE = 5.0
"""Standard deviations above zero of the plays' common motion, required to call it a motion."""
_LEAST_STEP = 0.25


@dataclass(frozen=True, eq=False)
class Iteration:
    """One drive that was played, and its result.

    `volts` is (samples,) V as commanded, `measured` (samples,) m/s^2, the mean of the plays. `nrmse` and
    `floor` are as in a `Check`; `squared_error` is the mean square of the error without the plays' noise,
    estimated from the products of different plays, and `deviation` that estimate's standard deviation (both
    over the target's mean square).
    """

    volts: FloatArray
    measured: FloatArray
    nrmse: float
    floor: float
    squared_error: float
    deviation: float
    kept: bool
    reason: str
    """Reason for keeping or rejecting it."""


@dataclass(frozen=True, eq=False)
class Learning:
    """Every drive that was tried; the first is the initial one.

    `best` is the number of the iteration whose drive is `drive`. `first_again` and `best_again` are the
    errors (nrmse) of first and best in the final replay, alternately, after the last iteration: plays that
    had no part in the selection. Without an improvement they are those of the first iteration.
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
    calibration: Calibration,
    *,
    iterations: int = 5,
    plays: int = 8,
    progress: Progress = silent,
) -> Learning:
    """Improve a drive by playing it: `plays` plays, then up to `iterations` corrections of as many.

    It ends when the error reaches the plays' noise, when the expected improvement of a correction is
    below that noise, or when smaller steps bring no improvement; at once, when a signal left its range or
    the surface did not follow. The target stays unchanged. The result is the first drive, unless another
    was closer to the target by more than the noise of plays that had no part in its selection.
    `progress` is called with the plays done and their largest possible number.

    Raises ConfigurationError for fewer than three plays, or a drive of another calibration or rig, and
    what `Rig.excite` raises.
    """
    if plays < 3:
        raise ConfigurationError("Learning needs at least 3 plays: it has to tell error from noise.")
    if drive.calibration != calibration.digest:
        raise ConfigurationError(
            "The drive was computed from another calibration than the one given: compute it again."
        )
    refuse_foreign(rig, drive)
    prepare(rig, drive.point)
    estimate = ResponseEstimate.of(drive, calibration)
    doing, total, done = f"Learn the {drive.button} button", (iterations + 3) * plays, 0

    def played(volts: FloatArray, count: int = plays) -> Played:
        nonlocal done
        before, done = done, done + count
        given = replace(drive, volts=volts)
        return play(rig, given, count, estimate.tail, part_of(progress, doing, before, total))

    outcome = played(drive.volts)
    estimate = estimate.after(drive.volts, outcome)
    first = _iteration(drive, drive.volts, outcome.accelerations)
    tried = [replace(first, kept=True, reason="the drive as computed")]
    best, step = 0, 1.0
    stopped = _unlearnable(outcome, drive.target)
    while not stopped and not (stopped := _ended(tried, best, step, iterations)):
        volts, expected = estimate.correction(tried[best].volts, outcome, step, rig.limits)
        if expected < _STEP_SIGNIFICANCE * tried[best].deviation:
            stopped = "The expected improvement of a correction is below the plays' noise."
            break
        result = played(volts)
        estimate = estimate.after(volts, result)
        new = _iteration(drive, volts, result.accelerations)
        if result.overload:
            new, step = replace(new, reason=result.overload), step / 2
        elif _gained(tried[best], new) > _STEP_SIGNIFICANCE:
            new = replace(new, kept=True, reason="closer to the target by more than the noise")
            best, outcome = len(tried), result
        else:
            reason = "no closer to the target, or not by more than the noise"
            new, step = replace(new, reason=reason), step / 2
        tried.append(new)

    first_again, best_again = _again(drive, tried, best, played, plays) if best else (tried[0], tried[0])
    if best and not _gained(first_again, best_again) > _FINAL_SIGNIFICANCE:
        stopped += " Played again, the best drive was not closer by more than the noise: the first is kept."
        tried[1:] = [replace(iteration, kept=False) for iteration in tried[1:]]
        best = 0
    progress(doing, total, total, "plays")
    chosen = drive
    if best:
        chosen = replace(drive, volts=tried[best].volts, predicted_error=best_again.nrmse)
    return Learning(tuple(tried), best, first_again.nrmse, best_again.nrmse, stopped, chosen)


def _iteration(drive: Drive, volts: FloatArray, accelerations: FloatArray) -> Iteration:
    accelerations = accelerations[:, : len(drive.target)]
    nrmse, floor = errors(accelerations, drive.target)
    squared, deviation = _in_common(accelerations - drive.target)
    size = float(np.mean(drive.target**2))
    measured = np.asarray(accelerations.mean(axis=0))
    return Iteration(volts, measured, nrmse, floor, squared / size, deviation / size, False, "")


def _gained(before: Iteration, after: Iteration) -> float:
    """Decrease of the squared error, in its standard deviations."""
    deviation = float(np.hypot(before.deviation, after.deviation))
    return (before.squared_error - after.squared_error) / max(deviation, 1e-30)


def _in_common(plays: FloatArray) -> tuple[float, float]:
    """Mean square of the common part of (plays, samples), and its standard deviation.

    The deviation is the jackknife's, which for products of pairs is biased upwards, by up to a half: the
    conservative side (Efron and Stein, Annals of Statistics 9, 1981).
    """
    number, samples = plays.shape
    products = plays @ plays.T / samples

    def common(kept: IntArray) -> float:
        among = products[np.ix_(kept, kept)]
        return float((among.sum() - np.trace(among)) / (len(kept) * (len(kept) - 1)))

    left_out = [common(np.delete(np.arange(number), k)) for k in range(number)]
    spread = np.sqrt((number - 1) * np.var(left_out))
    return common(np.arange(number)), float(spread)


def _unlearnable(played: Played, target: FloatArray) -> str:
    """Reason why nothing can be learnt from the first plays; empty when something can."""
    if played.overload:
        return f"{played.overload} Nothing can be learnt from these plays."
    moved, deviation = _in_common(played.accelerations[:, : len(target)])
    # Written so that NaN is refused too.
    if moved >= LEAST_MOVED**2 * np.mean(target**2) and moved > _MOTION_SIGNIFICANCE * deviation:
        return ""
    return f"The surface did not follow the drive: {UNSEEN}. Nothing can be learnt from these plays."


def _ended(tried: list[Iteration], best: int, step: float, iterations: int) -> str:
    """Reason to end learning before another correction is planned; empty to continue."""
    if tried[best].nrmse <= FLOORS * tried[best].floor:
        return "The error has reached the plays' noise."
    if step < _LEAST_STEP:
        return "Smaller steps brought no improvement."
    if len(tried) > iterations:
        return f"All {iterations} iterations were played."
    return ""


def _again(
    drive: Drive, tried: list[Iteration], best: int, played: Callable[[FloatArray, int], Played], plays: int
) -> tuple[Iteration, Iteration]:
    """First and best, played alternately so that a drift of the table affects both."""
    both = tried[0].volts, tried[best].volts
    rounds = np.array([[played(volts, 1).accelerations[0] for volts in both] for _ in range(plays)])
    return _iteration(drive, both[0], rounds[:, 0]), _iteration(drive, both[1], rounds[:, 1])
