"""Live views: publish the rig of a command, and show its levels in a terminal (`haploop live`)."""

from __future__ import annotations

import json
import os
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from ..acquisition import look
from ..base.clock import RealClock
from ..base.errors import ConfigurationError, HaploopError, InstrumentError
from ..base.flag import Flag
from ..instruments import LiveBlock, Rig, RigFile, Tap, levels, watch_live
from ..instruments.driver import Mode
from ..instruments.live import waiting_for
from ..terminal.progress import note
from .lsl import Outlets, send

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
            look(rig, wanted.is_set)
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
