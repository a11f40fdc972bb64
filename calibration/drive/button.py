"""The digital button: one file that holds drive, check, and everything that both were computed from.

With it is stored what a finger would feel of the drive, beside the press that was recorded.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from fractions import Fraction
from functools import lru_cache
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...acquisition import Representative
from ...base import hdf5
from ...base.arrays import FloatArray
from ...base.errors import ConfigurationError, DataError
from ...base.filters import resample_poly
from ...base.notebook import InNotebook
from ...base.progress import Progress, silent
from ...instruments import Rig
from ...instruments.operator import RestFinger
from ..model import Calibration
from ..perception import Feeling, Pressed, feeling_of
from .check import check
from .checked import Check, Verdict
from .drive import Drive, drive_for
from .learning import Learning, learn
from .planning import TRADE_OFF, TradeOff
from .playing import refuse_foreign
from .pressed import PressedDrives, check_under_finger, pressed_drives
from .targets import BEFORE, NOWHERE, Method, Wanted, sized
from .verdict import worst

if TYPE_CHECKING:
    from ...acquisition import Representative


@dataclass(frozen=True, eq=False)
class DigitalButton(InNotebook):
    """A press that a table reproduces, and the measured error of the reproduction.

    It contains its sources: `press` (with its recordings' names and content hashes), `calibrations`
    (with the rig file at that time), every drive that was tried (`learning`), and the `check` of the
    selected drive, from plays that had no part in the selection.

    For example:

        >>> button = haploop.DigitalButton.load("latch.h5")
        >>> button.press.button, button.check.verdict
        ('latch', 'pass')
    """

    press: Representative
    calibrations: tuple[Calibration, ...]
    """One of each patch at each point."""
    learning: Learning
    check: Check
    created: str
    """Time of creation, ISO 8601, UTC."""
    made_with: str
    """Version of haploop."""
    others: tuple[Representative, ...] = ()
    """The presses that other points play at the same time, in the drive's order."""
    pressed: PressedDrives | None = None
    """Drives for one person's finger, by the force with which it presses; None for a button of the bare
    table."""
    pressed_checks: tuple[Check, ...] = ()
    """Check of each of these, under that finger with its force."""

    def refuse_nonsense(self) -> None:
        """See `hdf5.restore`. Raises DataError for drives for a finger that were not each checked."""
        drives = self.pressed.drives if self.pressed else ()
        if [one.drive.volts.tobytes() for one in self.pressed_checks] != [
            one.volts.tobytes() for one in drives
        ]:
            raise DataError("the button's drives for a finger do not have a check each.")

    def __repr__(self) -> str:
        simulated = ", simulated" if self.simulated else ""
        error = f"error {self.check.whole.brief}"
        return f"<DigitalButton {self.press.button}: {self.verdict}, {error}{simulated}>"

    @property
    def drive(self) -> Drive:
        """The drive, with the target on the same clock."""
        return self.check.drive

    @property
    def elsewhere(self) -> Wanted:
        """What other points are to do: see `drive_for`."""
        presses = iter(self.others)
        return {
            one.point: (next(presses), one.scale / self.drive.scale) if one.button else None
            for one in self.drive.elsewhere
        }

    @property
    def verdict(self) -> Verdict:
        """The worst of its check's verdict and those of the drives for a finger."""
        return worst(one.verdict for one in (self.check, *self.pressed_checks))

    @property
    def passed(self) -> bool:
        """True when its check passed, and that of each drive for a finger."""
        return self.verdict == "pass"

    @property
    def simulated(self) -> bool:
        """True when a source or the rig of the check is simulated."""
        return any(one.simulated for one in (self.check, *self.pressed_checks))

    @property
    def digest(self) -> str:
        """Content hash of all its fields."""
        return hdf5.digest_of(self)

    def save(self, path: str | Path) -> None:
        """Write to a new HDF5 file, whole or not at all. Raises DataError if it exists."""
        hdf5.write(path, "button", hdf5.flatten(self))

    @classmethod
    def load(cls, path: str | Path) -> DigitalButton:
        """Read what `save` wrote. Raises DataError, one sentence, for anything else."""
        return hdf5.restore(cls, hdf5.read(path, "button"), path)


def build_button(
    rig: Rig,
    press: Representative,
    calibration: Calibration | Sequence[Calibration],
    *,
    method: Method = "modulated",
    trade: TradeOff = TRADE_OFF,
    elsewhere: Wanted = NOWHERE,
    iterations: int = 5,
    plays: int = 8,
    progress: Progress = silent,
) -> DigitalButton:
    """Compute the drive of a press, improve it by up to `iterations` corrections, and check it.

    `calibration` may be several, of several patches, `trade` how loud it is to be, and `elsewhere` what
    other points are to do: see `drive_for`.
    A button that fails its check is returned as well: see `DigitalButton.passed`.
    Raises what `drive_for`, `learn` and `check` raise.

    For example:

        >>> press, calibration = haploop.load("press.h5"), haploop.load("calibration.h5")
        >>> button = haploop.build_button(rig, press, calibration, iterations=1)
        >>> button.save("latch.h5")
        >>> button.check.verdict
        'pass'
    """
    calibrations = (calibration,) if isinstance(calibration, Calibration) else tuple(calibration)
    _refuse_other_world(rig, calibrations)
    drive = drive_for(press, calibrations, rig.limits, method=method, trade=trade, elsewhere=elsewhere)
    refuse_foreign(rig, drive)

    learning = learn(rig, drive, calibrations, iterations=iterations, plays=plays, progress=progress)
    result = check(rig, learning.drive, press, plays=plays, progress=progress)
    return DigitalButton(
        press=press,
        calibrations=calibrations,
        learning=learning,
        check=result,
        others=tuple(one for one, _ in sized(elsewhere) if one is not None),
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        made_with=f"haploop {metadata.version('haploop')}",
    )


def button_under_finger(
    rig: Rig,
    button: DigitalButton,
    fingers: Calibration | Sequence[Calibration],
    *,
    plays: int = 8,
    progress: Progress = silent,
) -> DigitalButton:
    """Return a digital button with drives for a person's finger, each checked under it with its force.

    `fingers` is the calibration for that finger, or one of each of the button's patches. The operator is
    asked to rest the finger with each of the forces in turn. A button whose checks do not pass is returned as
    well. Raises ConfigurationError for calibrations of other patches than the button's, or of another point,
    for a button of another rig, and what `pressed_drives` and `check_under_finger` raise.
    """
    drive = button.drive
    refuse_foreign(rig, drive)
    order = {patch: number for number, patch in enumerate(drive.patches)}
    given = (fingers,) if isinstance(fingers, Calibration) else tuple(fingers)
    calibrations = sorted(given, key=lambda one: order.get(one.response.patch, len(order)))
    if drive.elsewhere:
        others = ", ".join(one.point for one in drive.elsewhere)
        raise ConfigurationError(
            f"The button's drives are planned for other points too ({others}), and what a finger does there "
            "is not known: make it for its own point alone."
        )
    there = tuple(one.response.patch for one in calibrations)
    points = {one.response.point for one in calibrations}
    if there != drive.patches or points != {drive.point}:
        raise ConfigurationError(
            f"The button is played by patch {drive.patch} at the {drive.point} point, and the finger was "
            f"calibrated with patch {', '.join(there)} at {', '.join(sorted(points))}: calibrate it there."
        )
    _refuse_other_world(rig, calibrations, fingers=True)
    method: Method = "broadband" if drive.method == "broadband" else "modulated"
    trade = replace(drive.trade, scale=None)
    made = pressed_drives(button.press, calibrations, rig.limits, method=method, trade=trade)
    checks = [
        check_under_finger(rig, one, made.participant, force=force, plays=plays, progress=progress)
        for force, one in zip(made.forces, made.drives, strict=True)
    ]
    return replace(button, pressed=made, pressed_checks=tuple(checks))


def play_button(
    rig: Rig,
    button: DigitalButton,
    *,
    finger: RestFinger | None = None,
    plays: int = 8,
    progress: Progress = silent,
) -> Check:
    """Verify a digital button by playing it: does the rig still reproduce it?

    With a `finger`, it rests on the button's point meanwhile, and the drive is the one for its force. Raises
    ConfigurationError on a rig other than the one it was made on, and for a finger that the button has no
    drives for; and what `check` and `check_under_finger` raise.

    For example:

        >>> haploop.play_button(rig, haploop.load("latch.h5")).verdict
        'pass'
    """
    _refuse_other_world(rig, button.calibrations)
    if finger is None:
        return check(rig, button.drive, button.press, plays=plays, progress=progress)
    if button.pressed is None:
        raise ConfigurationError(
            f"The digital {button.press.button} was made for the bare table: make its drives for a finger "
            "(haploop button under)."
        )
    return check_under_finger(
        rig, button.pressed, finger.participant, force=finger.force, plays=plays, progress=progress
    )


def _refuse_other_world(rig: Rig, calibrations: Sequence[Calibration], *, fingers: bool = False) -> None:
    for calibration in calibrations:
        response = calibration.response
        if calibration.finger is not None and not fingers:
            raise ConfigurationError(
                f"The calibration holds under {calibration.finger.participant}'s finger, and a button is "
                "learned and checked on the bare table: give the bare table's, or check a drive under the "
                "finger."
            )
        if response.simulated != rig.simulated:
            kinds = {True: "simulated", False: "real"}
            raise ConfigurationError(
                f"The calibration is of a {kinds[response.simulated]} table and the rig "
                f"{rig.name!r} is {kinds[rig.simulated]}: calibrate that rig first."
            )


_RATES = 1000
"""Largest denominator of the ratio of two sample rates."""


def check_feeling(check: Check, press: Representative | None = None) -> Feeling:
    """Compare the motion of a check with the thresholds of detection, and with `press` at its own size.

    `press` is the one that the drive was computed for.

    For example:

        >>> feeling = haploop.calibration.check_feeling(haploop.load("check.h5"), haploop.load("press.h5"))
        >>> "of people" in feeling.sentence
        True
    """
    return _feeling(check, press)


@lru_cache(maxsize=8)  # a report asks for its table, its verdicts and its figure
def _feeling(check: Check, press: Representative | None) -> Feeling:
    return feeling_of(
        check.target,
        check.measured,
        check.rate_hz,
        Pressed(lab=check.lab) if press is None else _pressed(press, check),
        check.accelerations,
    )


def _pressed(press: Representative, check: Check) -> Pressed:
    force = None if press.force is None else float(press.force[press.activation_index])
    return Pressed(_on_clock(press, check.rate_hz, len(check.target)), force, check.lab)


def _on_clock(press: Representative, rate_hz: float, samples: int) -> FloatArray:
    """(samples,) m/s^2: a recorded press on the clock of its drive, which begins before it."""
    ratio = Fraction(rate_hz / press.rate_hz).limit_denominator(_RATES)
    acceleration = resample_poly(press.acceleration, ratio.numerator, ratio.denominator)
    start = round(BEFORE * rate_hz)
    out = np.zeros(samples)
    kept = acceleration[: samples - start]
    out[start : start + len(kept)] = kept
    return out
