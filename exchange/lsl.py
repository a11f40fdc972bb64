"""A rig's live blocks as Lab Streaming Layer streams: `haploop live --lsl` (extra `lsl`).

LabRecorder and programs for EEG then record along. The sender is a viewer like any other: it takes blocks
from a tap, in a process of its own, and the recording does not wait for it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..base.arrays import FloatArray
from ..base.extras import optional
from ..instruments import LiveBlock, RigFile, Tap
from ..instruments.live import Run, signals

_DENSEST = 0.5
"""Smallest step of stamps, of the sample period."""
Labels = tuple[tuple[str, str], ...]
"""Name and unit of each channel."""
_LARGEST_DRIFT = 1e-4
"""Largest difference of two clocks' rates; crystals differ by 5 to 50 ppm (docs/hardware.md,
"Two cards on one clock")."""


class Stamps:
    """Time stamps of samples, from their index and the time at which blocks arrive.

    A block arrives after its last sample, and now and then later. The offset between both clocks is therefore
    the least lateness so far, and may grow as fast as two crystals drift apart: stamps are even, and do not
    shift when a block is held up. They always rise: when the offset turns out smaller, samples are up to
    twice as dense until that is made up for, as on a simulated rig that is faster than real time.
    """

    def __init__(self) -> None:
        self._last = -np.inf
        self.begin()

    def begin(self) -> None:
        """Begin anew with the next block: another program's, which numbers its runs from 1 again."""
        self._run = -1
        self._end = 0
        self._offset = np.inf

    def of(self, block: LiveBlock, arrival: float) -> FloatArray:
        """(samples,) s on the clock of `arrival`."""
        count, rate = block.end - block.first, block.run.rate_hz
        if block.run.number != self._run:
            self.begin()
            self._run = block.run.number
        at = (block.end - 1) / rate
        drifted = _LARGEST_DRIFT * (block.end - self._end) / rate
        self._offset = min(self._offset + drifted, arrival - at)
        even = np.asarray(at + self._offset - np.arange(count)[::-1] / rate)
        if block.first == self._end and even[0] < self._last + 0.99 / rate:
            end = max(even[-1], self._last + _DENSEST * count / rate)
            even = np.linspace(self._last, end, count + 1)[1:]
        self._end, self._last = block.end, float(even[-1])
        return even


class Outlets:
    """An outlet for each set of channels and rate. That of recordings is there from the beginning."""

    def __init__(self, file: RigFile, simulated: bool) -> None:
        self._lsl: Any = optional("pylsl", "lsl", "`haploop live --lsl`")
        self._outlets: dict[tuple[Labels, float], Any] = {}
        self._stamps = Stamps()
        if file.sensors.recorded:
            self._outlet(
                Run(
                    rig=file.name,
                    simulated=simulated,
                    doing="record",
                    about="",
                    channels=file.sensors.recorded,
                    rate_hz=file.rate_hz,
                    sensors=file.sensors,
                    laser=None,
                )
            )

    @property
    def clock(self) -> Callable[[], float]:
        """LSL's clock (s)."""
        return self._lsl.local_clock  # type: ignore[no-any-return]

    def begin(self) -> None:
        """Another program's blocks follow."""
        self._stamps.begin()

    def push(self, block: LiveBlock, arrival: float) -> None:
        """Send a block that arrived at `arrival` on LSL's clock."""
        values = np.concatenate([rows for *_, rows in signals(block.run, block.volts)])
        if values.shape[1]:
            rows = np.ascontiguousarray(values.T)  # (samples, channels), as LSL has them in memory
            self._outlet(block.run).push_chunk(rows, timestamp=self._stamps.of(block, arrival).tolist())

    def _outlet(self, run: Run) -> Any:
        empty = signals(run, np.zeros((len(run.channels), 0)))
        labels = tuple(label for names, units, _, _ in empty for label in zip(names, units, strict=True))
        key = (labels, run.rate_hz)
        if key not in self._outlets:
            self._outlets[key] = self._lsl.StreamOutlet(self._info(run, labels))
        return self._outlets[key]

    def _info(self, run: Run, labels: Labels) -> Any:
        info = self._lsl.StreamInfo(
            name=f"haploop {run.rig} {run.doing}",
            type="Haptics",
            channel_count=len(labels),
            nominal_srate=run.rate_hz,
            channel_format="double64",
            # By its identity an inlet finds the stream again, should this program be started anew.
            source_id=f"haploop-{run.rig}-{run.doing}-{run.rate_hz:g}-{'-'.join(run.channels)}",
        )
        about = info.desc()
        about.append_child_value("rig", run.rig)
        about.append_child_value("simulated", "true" if run.simulated else "false")
        channels = about.append_child("channels")
        for name, unit in labels:
            channel = channels.append_child("channel")
            channel.append_child_value("label", name)
            channel.append_child_value("unit", unit or "none")
            channel.append_child_value("type", "Haptics")
        return info


def send(tap: Tap, outlets: Outlets) -> None:
    """Send the blocks of a tap until the publishing program closes the rig."""
    outlets.begin()
    for block in tap:
        outlets.push(block, outlets.clock())
