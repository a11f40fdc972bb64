"""What is looked at in every block of a play: the volts at the patch, the surface's velocity, the force.

The first two are seen as they are. The force on the finger is what has come on the sensor since the
play began, because a sensor at rest shows its own offset and the weight on it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from instruments.arrays import FloatArray
from instruments.audit import Audit, now_utc, who
from instruments.daq import Block
from instruments.errors import InstrumentError, LimitError
from instruments.latch import Latch, hang
from instruments.limits import Limits
from instruments.rig_file import AbortLimits
from instruments.sensors import Sensors
from instruments.vibrometer import Vibrometer

__all__ = ["Watch", "trip"]

_EXCESS = 1.1
"""Measured volts over the limit at which a play is stopped: more than the monitor's noise and gain."""
_KEPT = 10
"""Blocks up to a trip that are kept."""
_FZ = 2
"""Row of the normal force among a force sensor's quantities."""


@dataclass(frozen=True, eq=False)
class _Look:
    """One quantity that is watched: `complaint` takes (channels, samples) V and says what is wrong."""

    name: str
    channels: tuple[str, ...]
    complaint: Callable[[FloatArray], str]


class Watch:
    """Tests every block of one play. `tripped` says why it was stopped; None when it was not."""

    def __init__(
        self, abort: AbortLimits, sensors: Sensors, vibrometer: Vibrometer | None, limits: Limits
    ) -> None:
        self.tripped: str | None = None
        self._looks: list[_Look] = []
        self._blocks: deque[Block] = deque(maxlen=_KEPT)
        drive, force = sensors.drive, sensors.force
        if drive is not None:
            self._looks.append(
                _Look("the drive", drive.channels, lambda v: _volts(drive.to_si(v), abort.drive, limits))
            )
        most = abort.velocity
        if vibrometer is not None and most is not None:
            scale = vibrometer.sensitivity
            self._looks.append(
                _Look("the velocity", (vibrometer.channel,), lambda v: _beyond(scale * v[0], most, "m/s"))
            )
        newton = abort.force
        if force is not None and newton is not None:
            rest: list[float] = []

            def pressed(volts: FloatArray) -> str:
                normal = force.to_si(volts)[_FZ]
                if not rest:
                    rest.append(float(np.median(normal)))
                return _beyond(normal - rest[0], newton, "N")

            self._looks.append(_Look("the force", force.channels, pressed))

    @property
    def channels(self) -> tuple[str, ...]:
        """What must be recorded for it."""
        return tuple(dict.fromkeys(channel for look in self._looks for channel in look.channels))

    def look(self, block: Block, recorded: tuple[str, ...]) -> None:
        """Test a block whose rows are `recorded`. Raises InstrumentError for what has tripped."""
        self._blocks.append(block)
        for look in self._looks:
            rows = [recorded.index(channel) for channel in look.channels]
            found = look.complaint(block.volts[rows])
            if not found and look.name != "the drive" and block.overload[rows].any():
                found = f"{look.name} stood at the end of its channel's range"
            if found:
                self.tripped = f"{found[0].upper()}{found[1:]}"
                raise InstrumentError(
                    f"{self.tripped.rstrip('.')}. The play was stopped. Check the amplifier's gain, a "
                    "player's volume and 'volts_per_full_scale', and [abort]; then `haploop reset` lets this "
                    "rig play again."
                )

    def samples(self) -> tuple[int, FloatArray]:
        """Index of the first sample, and (channels, samples) V, of the blocks up to a trip."""
        return self._blocks[0].first, np.concatenate([block.volts for block in self._blocks], axis=1)


def trip(
    audit: Audit, hardware: Collection[str], watch: Watch, recorded: Collection[str], rate_hz: float
) -> Latch | None:
    """Latch the rig, keep the samples, say so in the log: each whatever becomes of the others.

    Gives the latch when it could not be hung, and so must be kept in mind.
    """
    now, person = now_utc(), who()
    first, volts = watch.samples()
    path = audit.folder / "trips" / f"{now:%Y%m%dT%H%M%S.%f}-{person['pid']}.npz"
    by = f"{person['user']} on {person['host']}, process {person['pid']} ({person['command']})"
    latch = Latch(now.isoformat(timespec="seconds"), str(watch.tripped), by, str(path))
    kept: Latch | None = latch
    with suppress(OSError):
        hang(audit.folder, hardware, latch)
        kept = None
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        channels = np.array(list(recorded))
        np.savez(path, volts=volts, channels=channels, rate_hz=rate_hz, first=first, why=latch.why)
    audit.note_at_last("tripped", why=latch.why, samples=latch.samples)
    return kept


def _volts(measured: FloatArray, most: float | None, limits: Limits) -> str:
    """Of (monitors, samples) V, what is wrong with the first that is."""
    for own in measured:
        if most is not None:
            found = _beyond(own, most, "V")
            if found:
                return f"The patch got {found}"
            continue
        try:
            limits.check_measured(own, _EXCESS)
        except LimitError as error:
            return str(error)
    return ""


def _beyond(measured: FloatArray, most: float, unit: str) -> str:
    size = np.abs(measured)
    # What is no number is beyond everything.
    beyond = np.flatnonzero(~(size <= most))
    if not len(beyond):
        return ""
    worst = float(size[beyond].max())
    quantity = {"V": "", "m/s": "the surface moved at ", "N": "the finger was pressed with "}[unit]
    return f"{quantity}{worst:.4g} {unit}, and [abort] allows {most:g} {unit}"
