"""The abort monitor: tests volts, a coil's heat, the surface's motion and the force in every block of a play.

The first two are tested as measured. The force is taken relative to the play's first block, because a
sensor at rest shows its own offset and the weight on it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from ...base.arrays import FloatArray
from ...base.errors import InstrumentError, LimitError
from ...base.files import whole_file
from ...base.wording import capital
from ..config import AbortLimits
from ..daq import Block
from ..limits import Coil, Limits
from ..sensors import Divider, Sensors
from ..vibrometer import Vibrometer
from .audit import make_folder, now_utc, who
from .lockout import Lockouts

_EXCESS = 1.1
"""Measured volts over the limit at which a play is stopped: beyond the drive monitor's noise and error."""
_KEPT = 10
"""Blocks up to a trip that are kept."""


@dataclass(frozen=True, eq=False)
class _Quantity:
    """One monitored quantity: `violation` takes (channels, samples) V and returns a message, or ""."""

    name: str
    channels: tuple[str, ...]
    violation: Callable[[FloatArray], str]


class _Warming:
    """Current and heat of coils, from the volts that they really get, block by block."""

    def __init__(self, limits: Limits, coil: Coil, rate_hz: float, warm: float, monitors: int) -> None:
        self._limits, self._coil, self._rate_hz = limits, coil, rate_hz
        self._warm = [warm] * monitors

    def violation(self, volts: FloatArray) -> str:
        """The first violation in (drive monitors, samples) V, or ""."""
        for number, own in enumerate(volts):
            drawn = float(np.abs(self._coil.current(own, self._rate_hz)).max())
            if not drawn <= _EXCESS * self._limits.current_peak:
                return f"The coil drew {drawn:.3g} A, and the limit is {self._limits.current_peak:.3g} A."
            heat = self._coil.heat(own, self._rate_hz, self._warm[number])
            self._warm[number] = float(heat[-1])
            if not heat.max() <= _EXCESS**2 * self._limits.power:
                return f"The coil was heated to {heat.max():.3g} W, and it takes {self._limits.power:.3g} W."
        return ""


class AbortMonitor:
    """Tests every block of one play. `tripped` is the reason for stopping the play, or None.

    `warm` (W) is what earlier plays have left in a coil, and `rate_hz` the play's.
    """

    def __init__(
        self,
        abort: AbortLimits,
        sensors: Sensors,
        vibrometer: Vibrometer | None,
        limits: Limits,
        *,
        rate_hz: float = 0.0,
        warm: float = 0.0,
    ) -> None:
        self.tripped: str | None = None
        self._quantities: list[_Quantity] = []
        self._blocks: deque[Block] = deque(maxlen=_KEPT)
        drive, force = sensors.drive, sensors.force
        if drive is not None:
            self._quantities.append(
                _Quantity("the drive", drive.channels, lambda v: _volts(drive, v, abort.drive, limits))
            )
            if limits.coil is not None:
                warming = _Warming(limits, limits.coil, rate_hz, warm, len(drive.channels))
                self._quantities.append(
                    _Quantity("the drive", drive.channels, lambda v: warming.violation(drive.to_si(v)))
                )
        moving = None if vibrometer is None else getattr(abort, vibrometer.quantity)
        if vibrometer is not None and moving is not None:
            to_si, most, unit = vibrometer.to_si, float(moving), vibrometer.unit
            name = f"the {vibrometer.quantity}"
            self._quantities.append(
                _Quantity(name, (vibrometer.channel,), lambda v: _beyond(to_si(v[0]), most, unit))
            )
        newton = abort.force
        if force is not None and newton is not None:
            rest: list[float] = []

            def pressed(volts: FloatArray) -> str:
                normal = force.along(volts)
                if not rest:
                    rest.append(float(np.median(normal)))
                return _beyond(normal - rest[0], newton, "N")

            self._quantities.append(_Quantity("the force", force.channels, pressed))

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels that must be recorded for the test."""
        return tuple(dict.fromkeys(channel for quantity in self._quantities for channel in quantity.channels))

    def check(self, block: Block, recorded: tuple[str, ...]) -> None:
        """Test a block whose rows are `recorded`. Raises InstrumentError on a trip."""
        self._blocks.append(block)
        for quantity in self._quantities:
            rows = [recorded.index(channel) for channel in quantity.channels]
            found = quantity.violation(block.volts[rows])
            if not found and quantity.name != "the drive" and block.overload[rows].any():
                found = f"{quantity.name} stood at the end of its channel's range"
            if found:
                self.tripped = capital(found)
                raise InstrumentError(
                    f"{self.tripped.rstrip('.')}. The play was stopped. Check the amplifier's gain, a "
                    "player's volume and 'volts_per_full_scale', and [abort]; then `haploop reset` clears "
                    "the lockout."
                )

    def samples(self) -> tuple[int, FloatArray]:
        """Index of the first sample, and (channels, samples) V, of the blocks up to a trip."""
        return self._blocks[0].first, np.concatenate([block.volts for block in self._blocks], axis=1)


def trip(lockouts: Lockouts, monitor: AbortMonitor, recorded: Collection[str], rate_hz: float) -> None:
    """Lock the rig out, log it and save the samples: each even when the others fail."""
    path = lockouts.audit.folder / "trips" / f"{now_utc():%Y%m%dT%H%M%S.%f}-{who()['pid']}.npz"
    why = str(monitor.tripped)
    lockouts.lock_out(why, path)
    first, volts = monitor.samples()
    with suppress(OSError):
        make_folder(path.parent)
        channels = np.array(list(recorded))
        with whole_file(path) as part, part.open("wb") as file:
            np.savez(file, volts=volts, channels=channels, rate_hz=rate_hz, first=first, why=why)


def _volts(monitors: Divider, volts: FloatArray, most: float | None, limits: Limits) -> str:
    """The first violation in (drive monitors, samples) V of the DAQ, or ""."""
    several = len(monitors.channels) > 1
    for own, channel in zip(monitors.to_si(volts), monitors.channels, strict=True):
        patch = f"The patch on {channel}" if several else "The patch"
        if most is not None:
            found = _beyond(own, most, "V")
            if found:
                return f"{patch} got {found}"
            continue
        try:
            limits.check_measured(own, _EXCESS)
        except LimitError as error:
            return str(error).replace("The patch", patch, 1)
    return ""


def _beyond(measured: FloatArray, most: float, unit: str) -> str:
    size = np.abs(measured)
    # NaN counts as beyond the limit.
    beyond = np.flatnonzero(~(size <= most))
    if not len(beyond):
        return ""
    worst = float(size[beyond].max())
    quantity = {"V": "", "m/s": "the surface moved at ", "N": "the finger was pressed with "}.get(
        unit, "the surface moved by " if unit == "m" else "the surface accelerated with "
    )
    return f"{quantity}{worst:.4g} {unit}, and [abort] allows {most:g} {unit}"
