"""Learning: what a play missed is corrected in the next, as long as that is seen to help.

Plain iterative learning is dangerous: with a response that has gone stale it diverges, and with noise
it writes the noise into the drive. So here a step that did not help is taken back and halved, and in
the end the best drive is played again beside the first, by plays that chose nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calibration import files
from calibration.check import LEAST_MOVED, UNSEEN, Played, errors, play, refuse_foreign
from calibration.correction import Known
from calibration.drive import Drive
from calibration.record import Calibration
from calibration.response import prepare
from instruments import ConfigurationError, Rig
from instruments.arrays import FloatArray, IntArray

__all__ = ["Iteration", "Learning", "learn"]

FLOORS = 1.2
"""The error over the floor at which the floor is reached: a third of the error's power, at most, is
then anything but noise."""
_SURE = 1.0
"""Standard deviations by which a correction must have helped to be gone on from."""
_CONFIRMED = 1.5
"""The same, for the best beside the first, when they were played again. Chance that let a step pass is
found out here; more than this for a step too, and little is learnt in noise."""
_SEEN = 5.0
"""Standard deviations by which what the plays have in common must stand out to be called a motion."""
_LEAST_STEP = 0.25


@dataclass(frozen=True, eq=False)
class Iteration:
    """One drive that was played, and what came of it.

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
    why: str


@dataclass(frozen=True, eq=False)
class Learning:
    """Every drive that was tried: the first is the one that was given.

    `best` is the number of the iteration whose drive is `drive`. `first_again` and `best_again` are the
    errors (nrmse) of first and best when they were played once more, in turn, after the last iteration:
    plays that chose nothing. Without an improvement they are those of the first iteration.
    """

    iterations: tuple[Iteration, ...]
    best: int
    first_again: float
    best_again: float
    stopped: str
    """Why it ended."""
    drive: Drive

    def save(self, path: str | Path) -> None:
        """Write to a new HDF5 file, whole or not at all. Raises DataError if it exists."""
        files.write(path, "learning", files.flatten(self))

    @classmethod
    def load(cls, path: str | Path) -> Learning:
        """Read what `save` wrote. Raises DataError, one sentence, for anything else."""
        return files.restore(cls, files.read(path, "learning"), path)


def learn(
    rig: Rig,
    drive: Drive,
    calibration: Calibration,
    *,
    iterations: int = 5,
    plays: int = 8,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> Learning:
    """Improve a drive by playing it: `plays` plays, then up to `iterations` corrections of as many.

    It ends when the error is down to the plays' own noise, when no correction promises more than that
    noise could show, or when smaller and smaller steps did not help; at once, when a signal left its
    range or the surface did not follow. The target stays as it is. The result is the first drive, unless
    another was closer to the target by more than the noise of plays that had no part in choosing it.
    `progress` is told the plays done and how many there are at most.

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
    known = Known.of(drive, calibration)
    total, done = (iterations + 3) * plays, 0

    def played(volts: FloatArray, count: int = plays) -> Played:
        nonlocal done
        before, done = done, done + count
        given = replace(drive, volts=volts)
        return play(rig, given, count, known.tail, lambda now, _: progress(before + now, total))

    outcome = played(drive.volts)
    known = known.after(drive.volts, outcome)
    first = _iteration(drive, drive.volts, outcome.accelerations)
    tried = [replace(first, kept=True, why="the drive as it was computed")]
    best, step = 0, 1.0
    stopped = _unlearnable(outcome, drive.target)
    while not stopped and not (stopped := _ended(tried, best, step, iterations)):
        volts, promised = known.correction(tried[best].volts, outcome, step, rig.limits)
        if promised < _SURE * tried[best].deviation:
            stopped = "No correction promises more than the plays' noise could show."
            break
        result = played(volts)
        known = known.after(volts, result)
        new = _iteration(drive, volts, result.accelerations)
        if result.overload:
            new, step = replace(new, why=result.overload), step / 2
        elif _gained(tried[best], new) > _SURE:
            new = replace(new, kept=True, why="it is closer to the target by more than the noise")
            best, outcome = len(tried), result
        else:
            why = "it is no closer to the target, or not by more than the noise"
            new, step = replace(new, why=why), step / 2
        tried.append(new)

    first_again, best_again = _again(drive, tried, best, played, plays) if best else (tried[0], tried[0])
    if best and not _gained(first_again, best_again) > _CONFIRMED:
        stopped += " Played again, the best was not closer by more than the noise: the first is kept."
        tried[1:] = [replace(iteration, kept=False) for iteration in tried[1:]]
        best = 0
    progress(total, total)
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
    """How much closer to the target it came, in standard deviations of that."""
    deviation = float(np.hypot(before.deviation, after.deviation))
    return (before.squared_error - after.squared_error) / max(deviation, 1e-30)


def _in_common(plays: FloatArray) -> tuple[float, float]:
    """Mean square of what (plays, samples) have in common, and its standard deviation.

    The deviation is the jackknife's, which for products of pairs errs upwards, by up to a half: on the
    careful side (Efron and Stein, Annals of Statistics 9, 1981).
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
    """Why nothing can be learnt from the first plays; empty when something can."""
    if played.overload:
        return f"{played.overload} Nothing can be learnt from that."
    moved, deviation = _in_common(played.accelerations[:, : len(target)])
    # Written so that a number which is no number is refused too.
    if moved >= LEAST_MOVED**2 * np.mean(target**2) and moved > _SEEN * deviation:
        return ""
    return f"The surface did not follow the drive: {UNSEEN}. Nothing can be learnt from that."


def _ended(tried: list[Iteration], best: int, step: float, iterations: int) -> str:
    """Why learning ends before another correction is planned; empty when it does not."""
    if tried[best].nrmse <= FLOORS * tried[best].floor:
        return "The error is down to the plays' own noise."
    if step < _LEAST_STEP:
        return "Smaller steps did not help either."
    if len(tried) > iterations:
        return f"All {iterations} iterations were played."
    return ""


def _again(
    drive: Drive, tried: list[Iteration], best: int, played: Callable[[FloatArray, int], Played], plays: int
) -> tuple[Iteration, Iteration]:
    """First and best, played in turn so that a drift of the table befalls both."""
    both = tried[0].volts, tried[best].volts
    rounds = np.array([[played(volts, 1).accelerations[0] for volts in both] for _ in range(plays)])
    return _iteration(drive, both[0], rounds[:, 0]), _iteration(drive, both[1], rounds[:, 1])
