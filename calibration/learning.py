"""Learning: what a play missed is corrected in the next, as long as that is seen to help.

Plain iterative learning is dangerous: with a response that has gone stale it diverges, and with noise
it writes the noise into the drive. So here the response is corrected by every play, a correction is
planned within the limits like the drive itself, what the plays' noise hides is left alone, a step that
did not help is taken back and halved, and in the end the best drive is played again beside the first.
After Bristow, Tharayil and Alleyne, "A survey of iterative learning control", IEEE Control Systems
Magazine 26, 2006 (norm-optimal learning; here with its weights from measured variances).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft
from scipy.ndimage import uniform_filter1d

from calibration import actuation, files
from calibration.check import Played, errors, play, refuse_foreign
from calibration.drive import FADE, Drive, plan_for
from calibration.inversion import Plan, within
from calibration.record import Calibration
from calibration.response import prepare
from calibration.spectra import fade, resample
from instruments import ConfigurationError, Rig
from instruments.arrays import ComplexArray, FloatArray, IntArray

__all__ = ["Iteration", "Learning", "learn"]

FLOORS = 1.2
"""The error over the floor at which the floor is reached: a third of the error's power, at most, is
then anything but noise."""
_SURE = 3.0
"""Standard deviations by which a correction must have helped to be kept. With one, chance passed where a
laser was blocked, also beside the plays that confirm."""
_LEAST_STEP = 0.25
_DISTORTION = 0.02
"""Share of the motion that a response does not describe even when it is right: a patch's hysteresis,
an amplifier's bend."""
_CAUTION = 1e-3
"""What a change of the drive costs, over the median power of the gain: every change, also where it moves
nothing, goes through the patch's hysteresis and brings a little of its error with it."""
_POOL_HZ = 6.0
"""Neighbouring lines whose power is averaged."""
_LISTEN = 0.5
"""Seconds that are recorded after a drive at most: a drive leaves the table nearly still."""
_PLAN_RATE = 5000.0
"""Samples/s that corrections are planned at."""
_TRIES = 8
"""Of a lower limit."""


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
    noise could show, or when smaller and smaller steps did not help. The target stays as it is. The
    result is never a drive that measured worse than the first, and one that measured better only by the
    chance of the plays that chose it is not taken. `progress` is told the plays done and how many
    there are at most.

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
    clock = _Clock.of(drive, calibration)
    total, done = (iterations + 3) * plays, 0

    def played(volts: FloatArray, count: int = plays) -> Played:
        nonlocal done
        before, done = done, done + count
        return play(
            rig,
            replace(drive, volts=volts),
            count,
            clock.tail,
            lambda now, _: progress(before + now, total),
        )

    first = played(drive.volts)
    tried = [_iteration(drive, drive.volts, first, True, "the drive as it was computed")]
    best, step, stopped = 0, 1.0, ""
    known = _Known.of(drive, calibration, clock)
    known = known.after(clock, drive.volts, first)
    outcome = first
    while not (stopped := _ended(tried, best, step, iterations, outcome)):
        volts, promised = _correction(rig, drive, calibration, clock, known, tried[best].volts, outcome, step)
        if tried[best].squared_error - promised < _SURE * tried[best].deviation:
            stopped = "No correction promises more than the plays' noise could show."
            break
        result = played(volts)
        new = _iteration(drive, volts, result, False, "")
        known = known.after(clock, volts, result)
        gained = tried[best].squared_error - new.squared_error
        sure = _SURE * np.hypot(tried[best].deviation, new.deviation)
        if result.overload:
            new, step = replace(new, why=result.overload), step / 2
        elif gained > sure:
            new = replace(new, kept=True, why="it is closer to the target by more than the noise")
            best, outcome = len(tried), result
        else:
            why = "it is no closer to the target, or not by more than the noise"
            new, step = replace(new, why=why), step / 2
        tried.append(new)

    again = _again(drive, tried, best, played, plays) if best else (tried[0].nrmse, tried[0].nrmse)
    if again[1] >= again[0] and best:
        stopped += " Played again, the best was no closer than the first, which is kept."
        tried[1:] = [replace(iteration, kept=False) for iteration in tried[1:]]
        best = 0
    progress(total, total)
    error = float(np.sqrt(max(tried[best].squared_error, 0.0) + tried[best].floor ** 2))
    chosen = replace(drive, volts=tried[best].volts, predicted_error=error) if best else drive
    return Learning(tuple(tried), best, *again, stopped, chosen)


def _iteration(drive: Drive, volts: FloatArray, played: Played, kept: bool, why: str) -> Iteration:
    accelerations = played.accelerations[:, : len(drive.target)]
    nrmse, floor = errors(accelerations, drive.target)
    squared, deviation = _without_noise(accelerations - drive.target)
    size = float(np.mean(drive.target**2))
    measured = np.asarray(accelerations.mean(axis=0))
    return Iteration(volts, measured, nrmse, floor, squared / size, deviation / size, kept, why)


def _without_noise(missed: FloatArray) -> tuple[float, float]:
    """Mean square of what (plays, samples) have in common, and its standard deviation.

    The deviation is the jackknife's, which for products of pairs errs upwards, by up to a half: on the
    careful side (Efron and Stein, Annals of Statistics 9, 1981).
    """
    plays, samples = missed.shape
    products = missed @ missed.T / samples

    def common(kept: IntArray) -> float:
        among = products[np.ix_(kept, kept)]
        return float((among.sum() - np.trace(among)) / (len(kept) * (len(kept) - 1)))

    left_out = [common(np.delete(np.arange(plays), k)) for k in range(plays)]
    spread = np.sqrt((plays - 1) * np.var(left_out))
    return common(np.arange(plays)), float(spread)


def _ended(tried: list[Iteration], best: int, step: float, iterations: int, outcome: Played) -> str:
    """Why learning ends before another correction is planned; empty when it does not."""
    if outcome.overload:
        return f"{outcome.overload} Nothing can be learnt from that."
    if tried[best].nrmse <= FLOORS * tried[best].floor:
        return "The error is down to the plays' own noise."
    if step < _LEAST_STEP:
        return "Smaller steps did not help either."
    if len(tried) > iterations:
        return f"All {iterations} iterations were played."
    return ""


def _again(
    drive: Drive, tried: list[Iteration], best: int, played: Callable[[FloatArray, int], Played], plays: int
) -> tuple[float, float]:
    """Errors of first and best, played in turn so that a drift of the table befalls both."""
    outcomes: tuple[list[FloatArray], list[FloatArray]] = ([], [])
    for _ in range(plays):
        for outcome, number in zip(outcomes, (0, best), strict=True):
            outcome.append(played(tried[number].volts, 1).accelerations[0, : len(drive.target)])
    first, last = (errors(np.array(outcome), drive.target)[0] for outcome in outcomes)
    return first, last


@dataclass(frozen=True, eq=False)
class _Clock:
    """The drive's samples, and the fewer that corrections are planned on: one periodic grid, two rates."""

    samples: int
    """Of the drive."""
    factor: int
    """Samples of the drive for each of the grid."""
    grid: int
    rate_hz: float
    """Of the grid."""
    smooth: FloatArray
    """(samples,): the drive's faded ends."""

    @classmethod
    def of(cls, drive: Drive, calibration: Calibration) -> _Clock:
        samples = len(drive.volts)
        factor = max(1, int(drive.rate_hz // _PLAN_RATE))
        room = actuation.ringing(calibration.model) * drive.rate_hz
        edge = round(FADE * drive.rate_hz)
        grid = next_fast_len(int(np.ceil((samples + room) / factor)), real=True)
        return cls(samples, factor, grid, drive.rate_hz / factor, fade(samples, edge, edge))

    @property
    def tail(self) -> float:
        """Seconds that are recorded after the drive."""
        return min(_LISTEN, self.grid / self.rate_hz - self.samples / (self.rate_hz * self.factor))

    @property
    def frequencies(self) -> FloatArray:
        """Of the grid's lines (Hz)."""
        return np.asarray(np.arange(self.grid // 2 + 1) * self.rate_hz / self.grid)

    @property
    def window(self) -> FloatArray:
        """(grid,): `smooth`, and zero while it rings."""
        return np.clip(self.down(self.smooth), 0.0, 1.0)

    def down(self, signal: FloatArray) -> FloatArray:
        """(..., samples or more) at the drive's rate to (grid,), band-limited."""
        return resample(np.pad(signal, (0, self.grid * self.factor - len(signal))), self.grid)

    def up(self, signal: FloatArray) -> FloatArray:
        """(grid,) to the drive's (samples,)."""
        return resample(signal, self.grid * self.factor)[: self.samples]

    def pooled(self, power: FloatArray) -> FloatArray:
        """Power (..., lines) averaged over neighbouring lines."""
        lines = max(1, round(_POOL_HZ * self.grid / self.rate_hz))
        return np.asarray(uniform_filter1d(power, lines, mode="nearest"))


@dataclass(frozen=True, eq=False)
class _Known:
    """What is believed of the response from strain to acceleration: (lines,) gain and its variance."""

    calibration: Calibration
    gain: ComplexArray
    variance: FloatArray
    last: tuple[ComplexArray, ComplexArray, FloatArray] | None = None
    """Of the latest play: strain, acceleration, and its noise power."""

    @classmethod
    def of(cls, drive: Drive, calibration: Calibration, clock: _Clock) -> _Known:
        f = clock.frequencies
        return cls(calibration, actuation.gain(calibration, f), actuation.doubt(calibration, f) ** 2)

    def after(self, clock: _Clock, volts: FloatArray, played: Played) -> _Known:
        """Corrected by what was measured: by the play as it is, then by how it differs from the last.

        Each is believed by its noise, and by the distortion that no response describes.
        """
        strain, motion, noise = _spectra(self.calibration, clock, volts, played)
        known = self
        if self.last is None:
            known = known._corrected(clock, strain, motion, noise)
        else:
            before, moved, old = self.last
            known = known._corrected(clock, strain - before, motion - moved, noise + old)
        return replace(known, last=(strain, motion, noise))

    def _corrected(
        self, clock: _Clock, strain: ComplexArray, motion: ComplexArray, noise: FloatArray
    ) -> _Known:
        drive_power = np.abs(strain) ** 2
        distortion = _DISTORTION**2 * clock.pooled(np.abs(motion) ** 2)
        error = noise + distortion
        # Where a table has changed, the response is further off than its variance says.
        surprise = clock.pooled(np.abs(motion - self.gain * strain) ** 2 - error)
        seen = surprise / np.maximum(clock.pooled(drive_power), 1e-30)
        # By no more than all of it, which a line that was hardly driven would seem to say.
        seen = np.minimum(seen, np.abs(self.gain).max() ** 2)
        variance = np.maximum(self.variance, np.where(surprise > error, seen, 0.0))
        trust = variance * drive_power / np.maximum(variance * drive_power + error, 1e-30)
        measured = motion * np.conj(strain) / np.maximum(drive_power, 1e-30)
        return replace(self, gain=self.gain + trust * (measured - self.gain), variance=variance * (1 - trust))


def _spectra(
    calibration: Calibration, clock: _Clock, volts: FloatArray, played: Played
) -> tuple[ComplexArray, ComplexArray, FloatArray]:
    """(lines,) strain and mean acceleration, and the noise power that is left in the mean."""
    strain = calibration.hysteresis.strain(volts * actuation.path_gain(calibration))
    # What hysteresis leaves at the end comes and goes slowly, far below the band, and is no step.
    strain -= strain[-1] * fade(len(strain), len(strain), 0)
    motions = np.array([rfft(clock.down(a)) for a in played.accelerations])
    noise = clock.pooled(np.var(motions, axis=0, ddof=1) / len(motions))
    return rfft(clock.down(strain)), motions.mean(axis=0), noise


def _correction(
    rig: Rig,
    drive: Drive,
    calibration: Calibration,
    clock: _Clock,
    known: _Known,
    volts: FloatArray,
    outcome: Played,
    step: float,
) -> tuple[FloatArray, float]:
    """Volts that should be closer to the target than `volts`, and the squared error that they promise.

    What is left of the error is planned away within the limits, as far as it stands out of the
    noise of the plays that showed it, and as the response is known.
    """
    limits = rig.limits
    strain, motion, noise = _spectra(calibration, clock, volts, outcome)
    target = rfft(clock.down(drive.target))
    missed = target - motion
    power = clock.pooled(np.abs(missed) ** 2)
    missed *= np.maximum(0.0, 1 - noise / np.maximum(power, 1e-30))

    limit = calibration.hysteresis.reach(limits.peak * min(1.0, actuation.path_gain(calibration)))
    plan = plan_for(
        calibration, irfft(target, clock.grid), clock.window, clock.rate_hz, drive.band, limits, limit
    )
    plan = replace(
        plan,
        wanted=missed + known.gain * strain,
        gain=known.gain,
        doubt=np.sqrt(known.variance),
        noise=0.0,
        around=strain,
        ridge=_CAUTION,
    )
    now = calibration.hysteresis.strain(volts * actuation.path_gain(calibration))
    edges = np.minimum(1.0, clock.smooth / 0.05)
    _, state = within(plan, limit)
    for _ in range(_TRIES):
        planned, state = within(plan, limit, state)
        bent = now + step * edges * clock.up(planned - irfft(strain, clock.grid))
        new = actuation.commanded(calibration, bent, clock.smooth)
        room = actuation.room(calibration, new, limits)
        if room >= 1:
            break
        # Between the plan's samples, and by the hysteresis, it goes beyond what was planned.
        limit *= room * 0.998
    # A lower limit does not always help: then the whole drive gives way, by some thousandths.
    while room < 1:
        bent *= room * (1 - 1e-6)
        new = actuation.commanded(calibration, bent, clock.smooth)
        room = actuation.room(calibration, new, limits)
    after, _, _ = _spectra(calibration, clock, new, outcome)
    return new, _promised(plan, after, target)


def _promised(plan: Plan, strain: ComplexArray, target: ComplexArray) -> float:
    """Squared error that is expected of a strain's spectrum, over the target's."""
    return float(
        (
            plan.weight
            * (
                np.abs(plan.wanted - plan.gain * strain) ** 2
                + plan.doubt**2 * np.abs(strain - plan.around) ** 2
            )
        ).sum()
        / (np.abs(target) ** 2).sum()
    )
