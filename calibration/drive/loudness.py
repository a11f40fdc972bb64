"""How loud a drive can be, and at what error: the curve between them, and the choice on it.

Within the limits of the rig a drive is louder only if more of the target is given up. Errors are those
expected of the motion before any correction by playing, as calibrated and after a drift; the level is
that of the drive's target above the threshold of a finger that presses.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

from ...base import hdf5
from ...base.errors import ConfigurationError
from ...base.notebook import InNotebook
from ...base.progress import Progress, silent
from ...instruments import Rig
from ..model import Calibration, Drift
from ..perception import LabThreshold, Sensation, lab_threshold, levels_of, pressing_act
from .check import TOLERANCE
from .drive import Drive, drive_for
from .planning import BUDGET, TradeOff
from .targets import NOWHERE, Method, Wanted

if TYPE_CHECKING:
    from ...acquisition import Representative

_DRIVES = 5
"""Drives of a curve, from the least error that is expected to what a check tolerates, in equal ratios."""
_STEPS = 5
"""Largest number of drives that are computed to find an error."""
_CLOSE, _NEXT = 0.93, 0.98
"""Share of the largest error to plan for from which a drive is loud enough, and that is tried next."""
_OVER = 0.25
"""Level (dB) beyond the one asked for that is aimed at."""


@dataclass(frozen=True)
class Loudness:
    """What is asked of a drive: at most `error`, or at least `level`, or both; without them it is as like as
    it can be.
    """

    error: float | None = None
    """Largest expected error (`Drive.expected_error`); as loud as the limits allow. None beside a `level`:
    what a check tolerates."""
    level: float | None = None
    """Least level above the threshold of a finger that presses (dB), at the least error."""
    drift: Drift | None = None
    """See `TradeOff`: a smaller one leaves more volts for loudness."""

    def __post_init__(self) -> None:
        """Raises ConfigurationError for an error that no check tolerates."""
        if self.error is not None and not 0 < self.error <= TOLERANCE:
            raise ConfigurationError(
                f"An error of {self.error:.0%} is no choice: above 0, and at most the {TOLERANCE:.0%} that a "
                "check tolerates."
            )


@dataclass(frozen=True)
class Offer:
    """One point of a curve: a drive that the limits allow."""

    error: float
    """Expected error of the motion as calibrated, before corrections: of several buttons, of the
    worst."""
    drifted: float
    """The same after a drift of the table, whether it is planned against or not."""
    level: float
    """dB above the threshold of a finger that presses: of several buttons, of the weakest."""
    scale: float
    """Size over that of the recorded press."""
    peak: float
    """Largest voltage (V)."""


@dataclass(frozen=True)
class Offers:
    """A curve: what one method offers at some patches, from the most like to the loudest."""

    method: str
    patch: str
    """Names of the patches."""
    in_band: float
    """Share of the press's energy that is played."""
    offers: tuple[Offer, ...]


@dataclass(frozen=True, eq=False)
class ButtonPlan(InNotebook):
    """What can be had of a button on a rig, before anything is played."""

    button: str
    rig: str
    curves: tuple[Offers, ...]
    simulated: bool
    sources: tuple[tuple[str, str], ...]
    """Recordings that the press stands for: file name, content hash."""
    lab: LabThreshold | None = None
    """The lab's threshold, when the rig's file had one."""
    elsewhere: tuple[tuple[str, str], ...] = ()
    """Other points that do something at the same time: each with its button's name, empty where silent."""

    def __repr__(self) -> str:
        counted = "1 curve" if len(self.curves) == 1 else f"{len(self.curves)} curves"
        return f"<ButtonPlan {self.button} on {self.rig}: {counted}>"

    def sensation(self, offer: Offer) -> Sensation:
        """What a person feels of an offer who presses."""
        return Sensation(pressing_act(self.lab), offer.level)

    def save(self, path: str | Path) -> None:
        """Write to a new HDF5 file, whole or not at all. Raises DataError if it exists."""
        hdf5.write(path, "plan", hdf5.flatten(self))

    @classmethod
    def load(cls, path: str | Path) -> ButtonPlan:
        """Read what `save` wrote. Raises DataError, one sentence, for anything else."""
        return hdf5.restore(cls, hdf5.read(path, "plan"), path)


def offered(drives: Sequence[Drive], lab: LabThreshold | None = None) -> Offers:
    """The curve of drives of one method at the same patches, from the most like to the loudest.

    Left out is what nobody would choose: a drive that another is louder than, at no more error. That happens
    where nearly all error is a distortion's, which no budget changes, or where several drives are the same.
    """
    first = drives[0]
    every = [
        Offer(d.worst_error(False), d.worst_error(True), _level(d, lab), d.scale, d.peak) for d in drives
    ]
    offers: list[Offer] = []
    for one in sorted(every, key=lambda one: (one.error, -one.level)):
        if not offers or one.level > offers[-1].level:
            offers.append(one)
    return Offers(first.method, first.patch, first.in_band, tuple(offers))


def plan_button(
    press: Representative,
    calibration: Calibration | Sequence[Calibration],
    rig: Rig,
    methods: Sequence[Method] = ("modulated", "broadband"),
    progress: Progress = silent,
    elsewhere: Wanted = NOWHERE,
) -> ButtonPlan:
    """Compute the curve of each method, of the first patch alone and of all at once, within a rig's limits.

    Where other points are to do something at the same time (see `drive_for`), of all patches only, because
    one alone cannot. Where one channel of the amplifier drives all patches, they cannot be played at once,
    and the first alone is planned. Raises ConfigurationError for other points with such
    an amplifier, and what `drive_for` raises.

    For example:

        >>> press, calibration = haploop.load("press.h5"), haploop.load("calibration.h5")
        >>> plan = haploop.calibration.plan_button(press, calibration, rig, methods=["modulated"])
        >>> plan
        <ButtonPlan latch on simulated: 1 curve>
    """
    lab = lab_threshold(rig)
    every = (calibration,) if isinstance(calibration, Calibration) else tuple(calibration)
    patches = {c.response.patch for c in every}
    several = len(patches) > 1
    shared = several and rig.amplifier.sharing(patches) == len(patches)
    if shared and elsewhere:
        raise ConfigurationError(
            f"One channel of the amplifier drives patches {', '.join(sorted(patches))}, so that all play one "
            f"waveform, and no other point ({', '.join(elsewhere)}) can be moved or kept silent beside the "
            "button: plan without it."
        )
    together = [every] if elsewhere else [every[:1], every] if several and not shared else [every[:1]]
    curves: list[Offers] = []
    doing, count = f"Plan the {press.button} button", len(together) * len(methods) * _DRIVES
    for method, some in product(methods, together):

        def at(error: float, method: Method = method, some: Sequence[Calibration] = some) -> Drive:
            return drive_for(
                press, some, rig.limits, method=method, trade=TradeOff(error), elsewhere=elsewhere
            )

        drives: list[Drive] = []
        progress(doing, len(curves) * _DRIVES, count, "")
        for number, (_, drive) in enumerate(_curve(at), 1):
            progress(doing, len(curves) * _DRIVES + number, count, "")
            if not drives or drive.expected_error <= TOLERANCE:
                drives.append(drive)
        curves.append(offered(drives, lab))
    progress(doing, count, count, "")
    first = drives[0]
    return ButtonPlan(
        button=press.button,
        rig=first.rig,
        curves=tuple(curves),
        simulated=first.simulated,
        sources=first.sources,
        lab=lab,
        elsewhere=tuple((one.point, one.button) for one in first.elsewhere),
    )


def trade_for(
    press: Representative,
    calibration: Calibration | Sequence[Calibration],
    rig: Rig,
    loudness: Loudness,
    method: Method = "modulated",
    elsewhere: Wanted = NOWHERE,
) -> TradeOff:
    """The trade with which a drive is what was asked for.

    Raises ConfigurationError where the rig's limits do not allow it, with what they do; otherwise what
    `drive_for` raises.
    """

    def traded(error: float) -> TradeOff:
        return TradeOff(error, drift=loudness.drift)

    def at(error: float) -> Drive:
        return drive_for(
            press, calibration, rig.limits, method=method, trade=traded(error), elsewhere=elsewhere
        )

    def level(drive: Drive) -> float:
        return _level(drive, lab)

    if loudness.error is None and loudness.level is None:
        return TradeOff(drift=loudness.drift)
    lab = lab_threshold(rig)
    most = TOLERANCE if loudness.error is None else loudness.error
    least, closest = BUDGET, at(BUDGET)
    if closest.expected_error > most:
        # The drive that is planned the closest need not be: distortion may add less to a louder one.
        least, closest = min(_curve(at), key=lambda one: one[1].expected_error)
    if closest.expected_error > most:
        raise ConfigurationError(
            f"At most {most:.1%} of error cannot be had of the {press.button} button: the least to be "
            f"expected is {closest.expected_error:.1%}, before corrections by playing."
        )
    wanted = loudness.level
    if wanted is not None and level(closest) >= wanted:
        return traded(least)
    error, loudest = _loudest(
        at, most, (least, closest), lambda drive: wanted is not None and level(drive) >= wanted
    )
    if wanted is None:
        return traded(error)
    if level(loudest) < wanted:
        raise ConfigurationError(
            f"The {press.button} button cannot be {wanted:.1f} dB above the threshold of a pressing finger: "
            f"within the limits, with at most {most:.0%} of error, {level(loudest):.1f} dB is the most."
        )
    return traded(
        _least(lambda error: level(at(error)), wanted, (least, level(closest)), (error, level(loudest)))
    )


def _curve(at: Callable[[float], Drive]) -> Iterator[tuple[float, Drive]]:
    """The errors to plan for, and drives, from the closest on to what a check tolerates, in equal ratios."""
    error = BUDGET
    drive = at(error)
    least = drive.expected_error
    yield error, drive
    for number in range(1, _DRIVES):
        wanted = least * (TOLERANCE / least) ** (number / (_DRIVES - 1))
        error = max(wanted**2 - _beside(drive, error), BUDGET**2) ** 0.5
        drive = at(error)
        yield error, drive


def _loudest(
    at: Callable[[float], Drive], most: float, best: tuple[float, Drive], enough: Callable[[Drive], bool]
) -> tuple[float, Drive]:
    """The error to plan for so that `most` is expected, or one whose drive is loud enough; and its drive."""
    error = most
    for _ in range(_STEPS):
        drive = at(error)
        room = most**2 - _beside(drive, error)
        if drive.expected_error <= most and drive.scale > best[1].scale:
            best = error, drive
            if error**2 > _CLOSE**2 * room or enough(drive):
                break
        error = max(_NEXT**2 * room, BUDGET**2) ** 0.5
    return best


def _beside(drive: Drive, error: float) -> float:
    """Square of what is expected beside the `error` planned for, by distortion: it hardly depends on that."""
    return drive.expected_error**2 - error**2


def _least(
    level_at: Callable[[float], float], wanted: float, low: tuple[float, float], high: tuple[float, float]
) -> float:
    """The least error of (error, level) points `low` to `high` whose level is at least `wanted` (dB)."""
    for step in range(2 * _STEPS):
        # A chord alone would keep one end for ever, because the curve bends.
        share = 0.5 if step % 2 else (wanted + _OVER - low[1]) / (high[1] - low[1])
        error = low[0] * (high[0] / low[0]) ** min(share, 1.0)
        level = level_at(error)
        if level < wanted:
            low = error, level
        else:
            high = error, level
            if level < wanted + 2 * _OVER:
                break
    return high[0]


def _level(drive: Drive, lab: LabThreshold | None) -> float:
    """Level (dB) above the threshold of a finger that presses: of the weakest button."""
    targets = [drive.target, *(one.target for one in drive.elsewhere if one.button)]
    return min(levels_of(one, drive.rate_hz).pressing for one in targets) - pressing_act(lab).shift
