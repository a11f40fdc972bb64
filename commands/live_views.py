"""Live views: publish a command's rig, show its levels in a terminal, or stream them (`haploop live`)."""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import numpy as np
from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from .. import acquisition
from ..base.arrays import FloatArray
from ..base.clock import RealClock
from ..base.entry_points import optional
from ..base.errors import ConfigurationError, HaploopError, InstrumentError
from ..base.threads import Flag
from ..instruments import LiveBlock, Rig, RigFile, Tap, levels, watch_live
from ..instruments.driver import Mode
from ..instruments.live import Run, signals, waiting_for
from ..terminal.progress import note

_REFRESH = 0.5
"""Seconds of one wait for a block; the loop then checks whether the rig was closed."""
_SENT = 4096
"""Most blocks that wait to be sent: LSL's receivers want all of them."""
_RETRY = 0.02
"""Seconds between two searches for a program that publishes."""


@contextmanager
def published(rig: Rig) -> Iterator[None]:
    """Publish a rig for `haploop live`, unless HAPLOOP_LIVE=off. A failure prints a note only."""
    with ExitStack() as stack:
        if os.environ.get("HAPLOOP_LIVE", "").lower() != "off":
            try:
                stack.enter_context(rig.publish_live()).greet()
            except InstrumentError as error:
                note(str(error))
        yield


def find(file: RigFile, simulate: Mode | None, wait: float, capacity: int = 16) -> Tap:
    """Call `watch_live`, and retry for up to `wait` seconds while no program publishes the rig."""
    clock = RealClock()
    until, waiting = clock.now() + wait, False
    with ExitStack() as stack:
        while True:
            try:
                return watch_live(file, simulate, capacity)
            except ConfigurationError:
                if clock.now() >= until:
                    raise
                if not waiting:
                    waiting = True
                    stack.enter_context(waiting_for(file, simulate))
                    note(f"Waiting for a command that uses the rig {file.name}.")
                clock.sleep(_RETRY)


@contextmanager
def looking(rig: Rig) -> Iterator[Tap]:
    """Look at a rig's sensors in a thread while this lasts: a tap on what they show.

    A failure while looking ends the tap, and is raised by whoever takes from it.
    """
    wanted = Flag()
    wanted.set()
    tap = rig.tap()

    def work() -> None:
        try:
            acquisition.look(rig, wanted.is_set)
        except HaploopError as error:
            tap.close(error)
        else:
            tap.close()

    thread = threading.Thread(target=work, name="haploop-look")
    thread.start()
    try:
        yield tap
    finally:
        wanted.clear()
        thread.join()


def stream(file: RigFile, simulate: Mode | None, wait: float) -> None:
    """Send the blocks of a rig by LSL, until its program ends and no other comes within `wait` seconds."""
    outlets = Outlets(file, bool(simulate or file.simulate))
    note("Sending by LSL: every computer that reaches this one over its network can receive it.")
    found = False
    while True:
        try:
            with find(file, simulate, wait, _SENT) as tap:
                found = True
                send(tap, outlets)
        except ConfigurationError:
            if not found:
                raise
            return
        if not wait:
            return


def show_json(tap: Tap) -> None:
    """Print one JSON object a line for each block, until the publishing program closes the rig."""
    for block in tap:
        run = block.run
        line = {
            "rig": run.rig,
            "simulated": run.simulated,
            "run": run.number,
            "doing": run.doing,
            "about": run.about,
            "first": block.first,
            "samples": block.end - block.first,
            "rate_hz": run.rate_hz,
            "dropped": tap.dropped,
            "levels": [vars(level) for level in levels(block)],
        }
        print(json.dumps(line), flush=True)


def show_meter(tap: Tap, console: Console | None = None) -> None:
    """Show the levels of the newest block, until the publishing program closes the rig."""
    console = console or Console()
    with Live(Text("Waiting for a recording or a play ..."), console=console, refresh_per_second=10) as view:
        while not tap.closed:
            block = tap.latest() or tap.take(_REFRESH)
            if block is not None:
                view.update(_meter(block, tap.dropped))


def _meter(block: LiveBlock, dropped: int) -> Table:
    run = block.run
    simulated = " (simulated)" if run.simulated else ""
    span = (block.end - block.first) / run.rate_hz
    title = (
        f"{run.rig}{simulated}: {run.doing} {run.about}\n"
        f"{block.end / run.rate_hz:.1f} s, last {1e3 * span:.0f} ms, {dropped} blocks not shown"
    )
    # Text, because a rig's name or a path may look like rich markup.
    table = Table(title=Text(title), title_justify="left")
    table.add_column("quantity")
    for name in ("mean", "rms", "peak"):
        table.add_column(name, justify="right")
    table.add_column("unit")
    for level in levels(block):
        table.add_row(
            Text(level.name),
            *(f"{value:.3g}" for value in (level.mean, level.rms, level.peak)),
            Text(f"{level.unit} overload" if level.overload else level.unit),
            style="red" if level.overload else None,
        )
    return table


# A rig's live blocks as Lab Streaming Layer streams: `haploop live --lsl` (extra `lsl`).
#
# LabRecorder and programs for EEG then record along. The sender is a viewer like any other: it takes blocks
# from a tap, in a process of its own, and the recording does not wait for it.

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
