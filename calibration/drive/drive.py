"""From a press to the drive: the volts of each patch that make the table reproduce it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...base import hdf5
from ...base.arrays import FloatArray
from ...base.errors import DataError
from ...base.notebook import InNotebook
from ...instruments import Limits
from ...instruments.vibrometer import DERIVATIVE, shown
from ..band import BAND
from ..model import Calibration, Drift
from ..response import Response
from ..spectra import resample
from .actuation import Actuation
from .inversion import Plan
from .planning import (
    STEADY,
    TRADE_OFF,
    Inversion,
    TradeOff,
    expected,
    given_up,
    hidden,
    left_out,
    plan_for,
    planned_by,
    unmeasured_above,
)
from .targets import NOWHERE, Method, OtherPoint, TargetGrid, Wanted, sized, target_grid

if TYPE_CHECKING:
    from ...acquisition import Representative

_TRIES = 16
_RANGE_USED = 0.8
"""Share of the vibrometer's range that a drive may use."""
_REACH = 1000.0
"""V: no amplifier of a patch reaches this. A rig's own limits are lower, and are checked before a play."""
_OWN = ("point", "button", "target", "scale", "carrier_hz", "in_band", "sources", "unreached")
"""What belongs to a drive's own point."""


@dataclass(frozen=True, eq=False)
class Drive(InNotebook):
    """Volts for one or several patches, and the target motion of the surface.

    `volts` is (patches, samples) V at each patch as commanded, `target` is (samples,) m/s^2, on the same
    clock: the press's acceleration, modulated if that is the `method`, cut to `band` (Hz) and
    multiplied by `scale`. `in_band` is the share of that acceleration's energy which lies within the
    band. `predicted_error` is the error expected of the motion: rms of the error over rms of the
    target. Unmodelled hysteresis of the patch adds some percent; after learning it is the measured error.
    """

    button: str
    patches: tuple[str, ...]
    point: str
    rate_hz: float
    volts: FloatArray
    target: FloatArray
    scale: float
    method: str
    """Method of computation: "modulated", "broadband", or in words."""
    carrier_hz: float
    """Carrier frequency of the modulation (Hz); 0 without modulation."""
    band: tuple[float, float]
    in_band: float
    known: tuple[float, float]
    """Frequencies (Hz) between which the response was measured: beyond them the drive has no power."""
    predicted_error: float
    unreached: str
    """Shortfalls against the target caused by the limits, as sentences; empty when there are none."""
    rig: str
    """Name of the rig that the calibration was measured on: the drive fits no other."""
    simulated: bool
    sources: tuple[tuple[str, str], ...]
    """Recordings that the press stands for: file name, content hash."""
    calibration: str
    """Content hash of the calibrations used."""
    trade: TradeOff = TRADE_OFF
    """What it was planned for."""
    elsewhere: tuple[OtherPoint, ...] = ()
    """What other points are to do at the same time."""
    drift: Drift = STEADY
    """Drift of the table that was planned against."""
    drifted_error: float = 0.0
    """Error expected of the motion when the table has drifted so, `predicted_error` included; by
    `Drift()` where no drift of modes was planned against."""
    above: FloatArray = field(default_factory=lambda: np.zeros((2, 0)))
    """(2, edges): frequencies (Hz), and a bound of the error above each, over the target: see `planning`.
    Empty where none is known."""
    hidden: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Most that it may move above what the laser passes, over the target: as the calibration showed it, and
    as its noise may hide just above; and the frequency (Hz) of the most: see `planning`."""

    def __post_init__(self) -> None:
        """Raises DataError for signals that no calibration makes, so that nobody plots or plays them."""
        finite = all(np.all(np.isfinite(signal)) for signal in (self.volts, self.target))
        shape = len(self.patches), len(self.target) if np.ndim(self.target) == 1 else 0
        if not finite or not all(shape) or np.shape(self.volts) != shape:
            raise DataError(
                "the drive and its target are not a signal for each patch and one for the target, of one "
                "length with finite values."
            )
        if any(np.shape(one.target) != np.shape(self.target) for one in self.elsewhere):
            raise DataError("the drive has a target at another point that is not as long as its own.")
        if len(set(self.patches)) < len(self.patches):
            raise DataError(f"the drive has two signals for one patch ({self.patch}).")
        if not 0 < self.rate_hz < np.inf:
            raise DataError(f"the drive has {self.rate_hz:g} samples/s.")
        if self.peak > _REACH:
            raise DataError(f"the drive reaches {self.peak:g} V, and no amplifier of a patch {_REACH:g} V.")

    def __repr__(self) -> str:
        simulated = ", simulated" if self.simulated else ""
        seconds = len(self.target) / self.rate_hz
        return (
            f"<Drive {self.button} at patch {self.patch}: {self.peak:.1f} V peak, {seconds:.2f} s{simulated}>"
        )

    @property
    def patch(self) -> str:
        """Names of the patches, for people."""
        return ", ".join(self.patches)

    @property
    def by_patch(self) -> dict[str, FloatArray]:
        """(samples,) V of each patch, as `Rig.excite_each` takes them."""
        return dict(zip(self.patches, self.volts, strict=True))

    @property
    def expected_error(self) -> float:
        """Error expected before any correction: where a drift is planned against, of a table that drifted.

        Of several buttons that of the worst.
        """
        return self.worst_error(self.drift.modes)

    def worst_error(self, drifted: bool) -> float:
        """Error expected of the worst of its buttons, as calibrated or after the drift."""
        own = self.predicted_error, self.drifted_error
        each = [own, *(one.expected for one in self.elsewhere if one.button)]
        return max(error[drifted] for error in each)

    @property
    def points(self) -> tuple[str, ...]:
        """Its own point, and the others that it plans for."""
        return (self.point, *(one.point for one in self.elsewhere))

    def seen_from(self, point: str) -> Drive:
        """The same drive with the button of another point as its own, and its own as one elsewhere."""
        (other,) = (one for one in self.elsewhere if one.point == point)
        own = {name: getattr(self, name) for name in _OWN}
        errors = self.predicted_error, self.drifted_error
        mine = OtherPoint(**own, expected=errors, known_to=0.0, known_from="")
        return replace(
            self,
            **{name: getattr(other, name) for name in _OWN},
            predicted_error=other.expected[0],
            drifted_error=other.expected[1],
            above=np.zeros((2, 0)),
            hidden=(0.0, 0.0, 0.0),
            elsewhere=tuple(mine if one is other else one for one in self.elsewhere),
        )

    def is_of(self, press: Representative) -> bool:
        """Whether it was computed for a press: of the same button, from the same recordings."""
        return (press.button, tuple(press.sources)) == (self.button, self.sources)

    @property
    def peak(self) -> float:
        """Largest voltage of any patch (V)."""
        return float(np.abs(self.volts).max())

    def save(self, path: str | Path) -> None:
        """Write to a new HDF5 file, whole or not at all. Raises DataError if it exists."""
        hdf5.write(path, "drive", hdf5.flatten(self))

    @classmethod
    def load(cls, path: str | Path) -> Drive:
        """Read what `save` wrote. Raises DataError, one sentence, for anything else."""
        return hdf5.restore(cls, hdf5.read(path, "drive"), path)


def drive_for(
    press: Representative,
    calibration: Calibration | Response | Sequence[Calibration],
    limits: Limits,
    *,
    method: Method = "modulated",
    band: tuple[float, float] = BAND,
    inversion: Inversion = "optimised",
    trade: TradeOff = TRADE_OFF,
    elsewhere: Wanted = NOWHERE,
) -> Drive:
    """The drive that makes the calibrated point reproduce a press.

    `calibration` may be several, of several patches at that point, which an amplifier with a channel for each
    then drives at once. The press is modulated with the point's resonance (equation 1 of the paper), or taken
    as it is for "broadband"; cut to the well-measured part of `band` (Hz), inverted non-causally, with each
    patch's hysteresis compensated; then scaled to the largest output within `limits` and the vibrometer's
    range. `trade` says how much error is accepted for output, and which drift of the table is planned against
    (see `inversion.max_output`; `inversion.min_peak` for "regularised", which is scaled to the limits instead
    of planned within them). Wherever the response was measured, motion outside the band counts as error;
    elsewhere the drive has no power. The drive has zero ends and zero mean. A response given without a
    calibration is fitted first.

    `elsewhere` says what other points are to do at the same time: play a press of their own, each with the
    carrier of its point, begun together and at one scale, or at that times a size of its own where one is
    given with the press; or keep silent (None). Each patch must be calibrated there too, or taken from a map
    (`with_map`), and there are no more points than patches.

    Raises DataError for a press that cannot be driven or a response that is too noisy, LimitError
    when the limits leave no headroom.

    For example:

        >>> press, calibration = haploop.load("press.h5"), haploop.load("calibration.h5")
        >>> drive = haploop.drive_for(press, calibration, rig.limits)
        >>> drive.save("drive.h5")
        >>> drive
        <Drive latch at patch A: 47.8 V peak, 1.00 s, simulated>
    """
    if isinstance(calibration, Response):
        calibration = Calibration.of(calibration)
    aim = _aim(press, Actuation.of(calibration, elsewhere), limits, method, band, trade, elsewhere)
    scaled = _scaled(aim, limits, trade, inversion)
    table, response = aim.table, aim.table.own[0].response
    peaks = np.abs(scaled.volts).max(axis=1)
    errors, above = expected(table, aim.drifting, scaled.played, aim.grid.rate_hz, peaks)
    each = tuple(_at_point(aim, scaled, row, errors[row]) for row in range(len(table.points)))
    # Where nothing is to move, motion is an error of the button that makes it.
    silent = [row for row, one in enumerate(aim.presses) if one is None]
    predicted, drifted = (float(np.linalg.norm(errors[[0, *silent], when])) for when in (0, 1))
    own = each[0]
    return Drive(
        button=own.button,
        patches=table.patches,
        point=own.point,
        rate_hz=table.rate_hz,
        volts=scaled.volts,
        target=own.target,
        scale=own.scale,
        method=method,
        carrier_hz=own.carrier_hz,
        band=aim.band,
        in_band=own.in_band,
        known=table.known,
        predicted_error=predicted,
        unreached=own.unreached,
        rig=response.rig,
        simulated=bool(response.simulated or any(one.simulated for one in aim.presses if one)),
        sources=own.sources,
        calibration=table.digest,
        trade=trade,
        elsewhere=each[1:],
        drift=aim.drift,
        drifted_error=drifted,
        above=above,
        hidden=hidden(table, aim.drifting, scaled.played, peaks),
    )


@dataclass(frozen=True, eq=False)
class _Aim:
    """What the points of a table are to do, and the plan for it.

    `presses`, `sizes`, `in_band` and `targets`, (points, grid) m/s^2, have one entry a point, the drive's own
    first. `drifting` is the plan by which the error after a drift is expected.
    """

    table: Actuation
    presses: list[Representative | None]
    sizes: FloatArray
    grid: TargetGrid
    band: tuple[float, float]
    targets: FloatArray
    in_band: FloatArray
    drift: Drift
    plan: Plan
    drifting: Plan


def _aim(
    press: Representative,
    table: Actuation,
    limits: Limits,
    method: Method,
    band: tuple[float, float],
    trade: TradeOff,
    elsewhere: Wanted,
) -> _Aim:
    others = sized(elsewhere)
    presses = [press, *(one for one, _ in others)]
    grid = target_grid(presses, table, method)
    band = table.measured_well(band, [point for point in table.points if elsewhere.get(point, press)])
    targets, in_band = grid.within(band)
    sizes = np.array([1.0, *(size for _, size in others)])
    targets = targets * sizes[:, None]
    drift = trade.drift_for(table)
    plan = drifting = plan_for(table, targets, grid, band, limits, drift)
    if not drift.modes:
        drifting = replace(plan, drift=table.drifted(grid.frequencies, Drift()))
    return _Aim(table, presses, sizes, grid, band, targets, in_band, drift, plan, drifting)


@dataclass(frozen=True, eq=False)
class _Scaled:
    """A plan within all limits: `volts` (patches, samples) to command, at `scale` of the target."""

    volts: FloatArray
    scale: float
    by: str
    """What limits the scale."""
    played: FloatArray
    """(patches, grid): linear volts on the plan's grid."""


def _scaled(aim: _Aim, limits: Limits, trade: TradeOff, inversion: Inversion) -> _Scaled:
    table, plan, grid = aim.table, aim.plan, aim.grid
    planned = planned_by(plan, trade, trade.budget(aim.drift), float(table.reach(limits).max()), inversion)
    smooth = grid.smooth
    linear_volts = grid.on_drive(planned) * np.minimum(1.0, smooth / 0.05)
    # Back on the plan's grid, to predict the motion of the exact signal that will be played.
    length = len(grid.window)
    finer = length * grid.oversampling
    played = resample(np.pad(linear_volts, ((0, 0), (0, finer - linear_volts.shape[1]))), length)
    response = table.own[0].response
    omega = 2j * np.pi * np.maximum(grid.frequencies, 1.0)
    shown_by = plan.moved(np.fft.rfft(played)) * omega ** (DERIVATIVE[response.pickup] - 1)
    range_scale = _RANGE_USED * response.pickup_range / float(np.abs(np.fft.irfft(shown_by, length)).max())
    wanted = np.inf if trade.scale is None else trade.scale
    reached = float((table.reach(limits) / np.abs(linear_volts).max(axis=1)).min())
    volts, scale = _within(limits, table, linear_volts, smooth, min(reached, range_scale, wanted))
    if scale == wanted:
        by = "the scale asked for"
    elif scale < range_scale:
        _, by = table.headroom(volts, limits)
    else:
        by = f"{_RANGE_USED:.0%} of the vibrometer's {shown(response.pickup, response.pickup_range)}"
    return _Scaled(volts, scale, by, played)


def _at_point(aim: _Aim, scaled: _Scaled, row: int, errors: FloatArray) -> OtherPoint:
    """What a drive does at the point of a `row`; `errors` (2,) are expected there, now and after a drift."""
    press, first = aim.presses[row], aim.table.rows[row]
    scale, in_band = float(scaled.scale * aim.sizes[row]), float(aim.in_band[row])
    unreached = []
    if press:
        steady = replace(aim.plan, drift=0.0).at(row)
        short = given_up(steady, scaled.played, aim.grid.rate_hz, aim.band)
        unreached = [*left_out(scale, scaled.by, in_band, aim.band), short]
    return OtherPoint(
        point=aim.table.points[row],
        button=press.button if press else "",
        target=scaled.scale * aim.grid.on_drive(aim.targets[row]),
        scale=scale,
        carrier_hz=aim.grid.carriers[row],
        in_band=in_band,
        sources=tuple((str(name), str(content)) for name, content in press.sources) if press else (),
        unreached=" ".join(filter(None, unreached)),
        expected=(float(errors[0]), float(errors[1])),
        known_to=aim.table.known_to(row, aim.band),
        known_from="; ".join(filter(None, (first[0].response.source, unmeasured_above(first)))),
    )


def _within(
    limits: Limits, table: Actuation, linear_volts: FloatArray, smooth: FloatArray, scale: float
) -> tuple[FloatArray, float]:
    """Volts to command for `linear_volts` times the largest factor up to `scale` within the limits.

    Limits hold for the volts commanded and for those that reach each patch. Returns the volts and
    the factor. Raises LimitError when no factor is found.
    """
    for number in range(_TRIES):
        volts = table.commanded(scale * linear_volts, smooth)
        headroom, _ = table.headroom(volts, limits)
        if headroom >= 1:
            break
        # Hysteresis makes the volts nonlinear in the factor, so that it is found by iteration; with an ever
        # larger margin, because that may go round in circles.
        scale *= headroom * (1 - 1e-6 * 2**number)
    for own in volts:
        limits.check(own, table.rate_hz)
    return volts, scale
