"""Plans of drives: the trade between loudness and likeness, the inversion problem, and its solution."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, Protocol

import numpy as np

from ...base.arrays import ComplexArray, FloatArray
from ...base.errors import ConfigurationError
from ...instruments import Limits
from ..intervals import not_negative
from ..model import Calibration, Drift
from ..spectra import third_octave, third_octaves
from .actuation import Actuation
from .inversion import Plan, State, max_output, min_peak, within

# The trade between loudness and likeness: what a drive is planned for.

STEADY = Drift(common=0.0, own=0.0, damping=0.0, gain=0.0, delay=0.0)
"""A table that does not drift."""
BUDGET = 0.005
"""Error accepted in exchange for a larger output. Small, because unmodelled error (hysteresis is known to
some percent) adds to it, and learning needs spare volts to correct that; 3 % would raise the output by a
tenth."""
_ALL = 0.99
"""Fraction of the target above which nothing is reported as left out."""
_MOST = 10.0
_DRIFTED = 0.06
"""The same of a table that has drifted by 1 %: of simulated tables with four patches, the least is 4 to 6 %,
at the loudness of one patch or twice that."""


@dataclass(frozen=True)
class TradeOff:
    """How much error is accepted for output, and the drift that is planned against."""

    error: float | None = None
    """Expected error accepted for the largest output, drift included; None: 0.5 %, or 6 % with a drift. If
    that is not within reach, the least error is taken."""
    scale: float | None = None
    """Scale at which the press is played, over its recorded size, with the least error."""
    drift: Drift | None = None
    """None: `Drift()` with more patches than points. Else none, because nothing is left to choose between:
    one patch buys little steadiness with much error."""

    def __post_init__(self) -> None:
        """Raises ConfigurationError for an error or a scale that no drive has."""
        for name, value in (("error", self.error), ("scale", self.scale)):
            if value is not None:
                object.__setattr__(self, name, float(value))  # a file knows no numpy numbers
            if value is not None and not 0 < value < _MOST:
                raise ConfigurationError(
                    f"A drive cannot be planned for {name} = {value:g}: it lies between 0 and {_MOST:g}."
                )
        if self.error is not None and self.scale is not None:
            raise ConfigurationError("A drive is planned for an error or for a scale: leave one out.")

    def drift_for(self, table: Actuation) -> Drift:
        """The drift that is planned against."""
        if self.drift is not None:
            return self.drift
        return Drift() if len(table.patches) > len(table.points) else STEADY

    def budget(self, drift: Drift) -> float:
        """The error accepted."""
        if self.error is not None:
            return self.error
        return BUDGET if drift == STEADY else _DRIFTED


TRADE_OFF = TradeOff()


Inversion = Literal["optimised", "regularised"]
_SPREAD = 0.6
"""Error of a drive over that which distortion would make if it were spread evenly over the band: part of it
stays near the drive's own lines, where the table moves little (measured on simulated tables)."""
_FALLS = 0.5
"""Distortion above the frequencies that a calibration plays, over that within them, at most, as is expected
where noise hides it: simulated, a quarter to two fifths, but all of it on a beam."""
_LARGEST = 2.0
"""The same, for a bound."""
_MORE = 2.3
"""What a drive at the largest level moves above the frequencies played, over what a multisine of as many
squared volts was measured to move, at most: 0.3 to 0.9 on six simulated tables, 1.1 on a beam, and on plates
of random modes up to 1.5, where a mode lies on a harmonic of the carrier 2.3."""
_HIDDEN = 1.5
"""The same, of motion above what the laser passes: enough for all but a mode on a harmonic of the carrier."""
_STEEPEST = 1.3
"""Power of the level over a quiet drive's volts by which distortion grows over its squared volts, at most:
mostly 1, by which it is expected to, at 1 down to a fifteenth of the level."""
_ELSEWHERE = 2.0
"""Motion above the frequencies played at another point over that at the calibrated one, at most, where it was
not measured: on five simulated tables 0.8 to 1.5 at nine points of ten, 2.2 at a corner. What a map shows
below these frequencies does not tell it."""
_ALIKE = 20
"""Neighbouring lines whose gains have one error: the local fits' windows overlap."""
_CLEAR = 3.0
"""Standard deviations of its noise from which the power of a gain counts."""
_SHOWN = 4.0
"""Standard deviations of its noise from which motion above what the laser passes counts as seen: at 10 kHz
that noise, twice differentiated, is as large as the target, and one band of a hundred exceeds three."""
_SETTLING = 3
"""Runs of the splitting for one limit, each from where the last one ended."""


class PlanGrid(Protocol):
    """The periodic grid of a plan."""

    @property
    def window(self) -> FloatArray:
        """See `Plan.window`."""

    @property
    def rate_hz(self) -> float:
        """Sample rate."""


def plan_for(
    table: Actuation,
    targets: FloatArray,
    grid: PlanGrid,
    band: tuple[float, float],
    limits: Limits,
    drift: Drift = STEADY,
) -> Plan:
    """The plan, in linear volts, for targets ((points, grid) m/s^2) within `band` (Hz).

    Motion that is not wanted counts wherever the response was measured, also outside the band.
    """
    f = np.asarray(np.fft.rfftfreq(targets.shape[1], 1 / grid.rate_hz), dtype=np.float64)
    low, high = table.known
    known = (f >= low) & (f <= high)
    gain = np.where(known, table.gain(np.clip(f, low, high)), 0.0)
    power = (np.abs(gain[0]) ** 2).mean(axis=0)
    reach = table.reach(limits)
    return Plan(
        target=np.fft.rfft(targets),
        gain=gain,
        known=known,
        covariance=table.covariance(f),
        window=grid.window,
        typical=float(np.median(power[(f >= band[0]) & (f <= band[1])])),
        reach=reach / reach.max(),
        drift=table.drifted(f, drift) if drift != STEADY else 0.0,
        slew=slew_of(limits, grid.rate_hz),
    )


def _by_distortion(
    table: Actuation, plan: Plan, V: ComplexArray, step: float, quieter: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Squared motion by what the law misses of spectra (patches, lines) of linear volts.

    That is spread over the band, and beyond: the table moves as it does there, also where the drive itself
    has no power. `step` (Hz) is the distance of the lines, which go on where the plan's grid ends. Above the
    frequencies that a calibration plays it measured what a multisine moves. `quieter` (patches,) is the level
    of the calibration over the drive's.

    Returns (3, points, bands): what is expected; the most that it may be, less noise, and the variance that
    noise gives that; and (bands,) Hz, the lowest frequency of each.
    """
    target, volts = np.abs(plan.target[0]) ** 2, (np.abs(V) ** 2).sum(axis=1)
    own = np.array([c.distortion for c in table.own])[:, None] ** 2
    on_line = own / (target > 1e-6 * target.max()).sum()
    played = min(one.model.band[1] for one in table.own)
    within, spread, hz = _by_bands(table, np.arange(table.known[0], played, step))
    each = [
        _beyond(Actuation(table.patches, (point,), (row,)), on_line, played, step)
        for point, row in zip(table.points, table.rows, strict=True)
    ]
    above_hz = np.unique(np.concatenate([own_hz for _, own_hz in each]))
    above = np.zeros((3, *within.shape[:2], len(above_hz)))
    for row, (squares, own_hz) in enumerate(each):
        above[:, row][..., np.searchsorted(above_hz, own_hz)] = squares
    most = _LARGEST**2 * on_line
    inside = np.array([_SPREAD**2 * on_line * within, most * within, (most * spread) ** 2])
    likely, upper, variance = np.concatenate([inside, above], axis=3)
    usual, steepest = volts * quieter, volts * quieter**_STEEPEST
    squares = np.array([usual @ likely, steepest @ upper, steepest**2 @ variance])
    return squares, np.concatenate([hz, above_hz])


def _beyond(
    point: Actuation, on_line: FloatArray, played: float, step: float
) -> tuple[FloatArray, FloatArray]:
    """Squared motion of one point above the frequencies `played` (Hz), over squared volts, by distortion.

    (3, patches, bands) as in `_by_distortion`, and the lowest frequency of each band.
    Where the response was not measured so high, as at a point that only a map knows, that is what the patches
    move at the calibrated point; it may be a multiple of it.
    """
    if any(c.above is None for c in point.own):
        hz = np.unique(np.concatenate([c.beyond[0] for c in point.own]))
        value, deviation = np.moveaxis(np.array([_measured(c, hz) for c in point.own]), 2, 0)
        value, deviation = (np.where(np.isinf(one), 0.0, one) for one in (value, deviation))
        most = (_ELSEWHERE * _MORE) ** 2
        return np.array([np.maximum(value, 0.0), most * value, (most * deviation) ** 2]), hz
    f = np.arange(played, point.known[1], step)[1:]
    (above,), (spread,), hz = _by_bands(point, f)
    value, deviation = np.moveaxis(np.array([_measured(c, hz) for c in point.own]), 2, 0)
    falls = np.minimum(np.maximum(value, 0.0) + deviation, (_SPREAD * _FALLS) ** 2 * on_line * above)
    measured = np.array([_MORE**2 * value, _MORE**2 * deviation])
    by_gain = np.array([_LARGEST**2 * on_line * above, _LARGEST**2 * on_line * spread])
    less = np.maximum(measured[0], 0.0) + 2 * measured[1] < by_gain[0] + 2 * by_gain[1]
    most, noise = np.where(less, measured, by_gain)
    return np.array([falls, most, noise**2]), hz


def hidden(
    table: Actuation, plan: Plan, linear_volts: FloatArray, peaks: FloatArray
) -> tuple[float, float, float]:
    """What a drive may move above all that the laser passes, over the target, as the patches were calibrated.

    First what stood out of the noise. Then what the noise may hide in the first third octave, where most is
    to be expected. Last where (Hz) the most of both is.
    """
    usual = (np.abs(np.fft.rfft(linear_volts)) ** 2).sum(axis=1) * _quieter(table, peaks) / plan.wanted
    shown, noise = [(0.0, 0.0)], [(0.0, 0.0)]
    for c, volts in zip(table.own, usual, strict=True):
        hz, power, deviation = c.hidden
        clear = power > _SHOWN * deviation
        shown += zip((_HIDDEN**2 * volts * power[clear]).tolist(), hz[clear].tolist(), strict=True)
        near = ~clear & (hz < 2 ** (1 / 3) * hz[:1])
        if np.any(near):
            most = not_negative(power[near].sum(), 2 * float(np.linalg.norm(deviation[near])))[1]
            noise.append((float(most * volts), float(hz[near][-1])))
    roots = [float(np.sqrt(sum(power for power, _ in own))) for own in (shown, noise)]
    return roots[0], roots[1], max(shown + noise)[1]


def _quieter(table: Actuation, peaks: FloatArray) -> FloatArray:
    """(patches,): the calibrations' levels over what a drive reaches, (patches,) V, and at least one."""
    levels = np.array([c.hysteresis.level for c in table.own])
    return np.maximum(levels / np.maximum(peaks, 1e-9), 1.0)


def unmeasured_above(row: Sequence[Calibration]) -> str:
    """A clause on a point at which motion above the frequencies played was not measured; else empty."""
    if all(c.above is not None for c in row):
        return ""
    said = f"motion above {min(c.model.band[1] for c in row):.0f} Hz was not measured there, and is"
    if all(c.beyond.size for c in row):
        return f"{said} expected as at the calibrated point"
    return f"{said} not expected: it is not known"


def _measured(calibration: Calibration, hz: FloatArray) -> FloatArray:
    """(bands, 2): `Calibration.beyond` of the third octaves that begin at `hz`; infinite where unknown."""
    bands, values = calibration.beyond[0], calibration.beyond[1:].T
    at = dict(zip(third_octave(bands).tolist(), values.tolist(), strict=True))
    found = [at.get(number, (np.inf, np.inf)) for number in third_octave(hz).tolist()]
    return np.array(found, dtype=np.float64).reshape(-1, 2)


def _by_bands(table: Actuation, f: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(points, patches, bands): power of the gain in third octaves of lines (Hz), less noise; its deviation.

    Both are zero where the gain does not stand out of its noise: a resonance does, what is even does not.
    Also (bands,): the lowest frequency of each.
    """
    power = np.abs(table.gain(f)) ** 2
    noise = np.einsum("qppl->qpl", table.covariance(f)).real
    if not len(f):
        return power, noise, f
    starts = np.unique(third_octave(f), return_index=True)[1]
    spread = np.sqrt(_ALIKE * np.add.reduceat(noise**2, starts, axis=2))
    power, noise = (np.add.reduceat(one, starts, axis=2) for one in (power, noise))
    clear = power - noise > _CLEAR * spread
    return np.where(clear, power - noise, 0.0), np.where(clear, spread, 0.0), f[starts]


def slew_of(limits: Limits, rate_hz: float) -> float:
    """`Plan.slew`: what the slew rate and the current into the load allow from one sample to the next."""
    slew = min(limits.slew, limits.current_peak / limits.capacitance if limits.capacitance else np.inf)
    return slew / rate_hz / limits.peak


def planned_by(plan: Plan, trade: TradeOff, budget: float, reach: float, inversion: Inversion) -> FloatArray:
    """(patches, grid) linear volts for the unscaled target. `reach` is the largest of any patch."""
    if trade.scale is None:
        return (max_output if inversion == "optimised" else min_peak)(plan, budget)[0]
    state: State | None = None
    for _ in range(_SETTLING):
        drive, state = within(plan, reach / trade.scale, state, budget)
    return drive


def expected(
    table: Actuation, plan: Plan, linear_volts: FloatArray, rate_hz: float, peaks: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """What a drive is expected to err, over the targets, where it reaches `peaks` (patches,) V.

    First (points, 2), rms: of each point, as calibrated and after the plan's drift; at a point that is to be
    silent it is the motion within the band, over the first point's target. Then (2, edges): frequencies (Hz),
    and the most that the first point may err above each, by the drive's own spectrum and the measured
    response, and by the most that distortion may move (`_by_distortion`). A third octave in which the
    response does not stand out of its noise counts as still.
    """
    V = np.fft.rfft(linear_volts)
    f = np.asarray(np.fft.rfftfreq(linear_volts.shape[1], 1 / rate_hz), dtype=np.float64)
    (moved, most, variance), edges = _by_distortion(table, plan, V, f[1], _quieter(table, peaks))
    steady = replace(plan, drift=0.0)
    # Of a silent point motion within the band counts.
    heard = np.where(np.any(plan.target, axis=1)[:, None] | (edges < table.own[0].model.band[1]), moved, 0.0)
    each = np.array([steady.left_at(V), plan.left_at(V)]).T + (plan.weights * heard.sum(axis=1))[:, None]
    left = np.abs(plan.missed(V)[0]) ** 2 + np.einsum("pl,ppl->l", np.abs(V) ** 2, plan.covariance[0]).real
    left[~plan.known] = 0.0
    above = [
        left[f >= edge].sum() + not_negative(most[0, own].sum(), 2 * np.sqrt(variance[0, own].sum()))[1]
        for edge, own in zip(edges, edges >= edges[:, None], strict=True)
    ]
    return np.sqrt(each / plan.wanted), np.array([edges, np.sqrt(np.array(above) / plan.wanted)])


# Shortfalls against the target, in sentences.


def left_out(scale: float, by: str, in_band: float, band: tuple[float, float]) -> list[str]:
    """What a `scale` limited `by` something, and the share of the energy `in_band` (Hz), leave out."""
    sentences = []
    if scale < _ALL:
        sentences.append(
            f"The surface reproduces the shape at {scale:.1%} of the recorded acceleration, limited by {by}."
        )
    if in_band < _ALL:
        sentences.append(
            f"{1 - in_band:.0%} of the energy lies outside {band[0]:.0f} to {band[1]:.0f} Hz and is left out."
        )
    return sentences


def given_up(plan: Plan, played: FloatArray, rate_hz: float, band: tuple[float, float]) -> str:
    """What the plan misses on purpose when (patches, grid) V are played; empty for next to nothing."""
    length = played.shape[1]
    missed = np.fft.irfft(plan.missed(np.fft.rfft(played))[0] * plan.known, length)
    error = float(np.linalg.norm(missed) / np.linalg.norm(np.fft.irfft(plan.target[0], length)))
    if error <= BUDGET:
        return ""
    centres, levels = third_octaves(missed, rate_hz, *band)
    return (
        f"{error:.1%} of the target is given up, most near {centres[int(np.argmax(levels))]:.0f} Hz, for a "
        "larger output or because the response is not known better."
    )
