"""Recording presses: every sample goes from the stream, by a thread that only moves blocks, to disk."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from datetime import UTC, datetime
from importlib import metadata
from itertools import chain
from pathlib import Path
from typing import Self

import numpy as np

from ...base.clock import Clock
from ...base.errors import ConfigurationError, DataError, InstrumentError
from ...base.files import check_destination, private_files
from ...base.marks import marked
from ...base.progress import Progress, silent
from ...base.signals import uninterrupted
from ...base.threads import Flag, Inbox
from ...instruments import Block, Request, Rig, Stream
from ..presses import Protocol, segmentation_for
from ..recording import Header, PressVerdict, Recording, Writer, file_name, finish, set_aside
from .session_run import Listeners, Session, SessionRun, ignore, telling_sensor
from .side_recording import SideRecording

MOST_PRESSES = 1000
"""Largest number of presses in one recording, which is preallocated and read as a whole."""


def record(
    rig: Rig,
    button: str,
    participant: str,
    presses: int,
    out: str | Path,
    *,
    progress: Progress = silent,
    on_verdict: Callable[[PressVerdict], None] = ignore,
    protocol: Protocol | None = None,
    notes: str = "",
    on_request: Callable[[Request], None] = ignore,
    name: str = "",
) -> Recording:
    """Record `presses` good presses of a button into `<out>/<participant>-<button>.h5`, or `<out>/<name>.h5`.

    An interrupted recording of that name without a single press is set aside first (`set_aside`).
    The operator is asked to keep hands off, then for each press once the one before has ended. The
    quality of each press is checked at once; a bad press is kept, marked, and asked for again.
    `progress` is called with the number of accepted presses at the start and after each one,
    `on_verdict(press)` after each press, `on_request(request)` with all that the operator is told. A session
    that ends early (an error, Ctrl-C) leaves a readable
    recording of all samples read, not `complete` and without the unused space; then the error is raised.

    Raises ConfigurationError for a bad name, a missing sensor, an existing file, and a folder or disk
    that cannot take it; DataError when no press comes in time (`Protocol.patience`, `Protocol.wait`), or
    none is accepted in `Protocol.attempts` attempts; InstrumentError when a sample is lost or the disk
    refuses.

    For example:

        >>> recording = haploop.record(rig, "latch", "P01", 2, "data")
        >>> recording.path.name, len(recording.accepted)
        ('P01-latch.h5', 2)
    """
    if not isinstance(presses, int | np.integer) or presses < 1:
        raise ConfigurationError(f"{presses!r} is not a number of presses: use a whole number, at least 1.")
    if presses > MOST_PRESSES:
        raise ConfigurationError(
            f"{presses} presses are too many for one recording: record at most {MOST_PRESSES}, and the "
            "others into another folder."
        )
    presses = int(presses)
    path = Path(out) / file_name(participant, button, name)
    set_aside(path)
    pending = tuple((number, 1) for number in range(1, presses + 1))
    session = Session(path, button, participant, pending, presses, notes=notes)
    protocol = protocol or Protocol(segmentation=segmentation_for(button))
    return run_session(rig, session, protocol, Listeners(progress, on_verdict, on_request))


def run_session(rig: Rig, session: Session, p: Protocol, told: Listeners) -> Recording:
    """Record the presses still due in a session. `record` calls this with a one-button session."""
    telling_sensor(rig)
    with private_files():
        check_destination(session.path)
    with marked(session.path):
        return _recorded(rig, session, p, told)


def _recorded(rig: Rig, session: Session, p: Protocol, told: Listeners) -> Recording:
    path = session.path
    channels, rate_hz = list(rig.sensors.recorded), rig.file.rate_hz
    samples = round(p.block * rate_hz)
    # The longest possible session, so that space for all of it is allocated before the first sample.
    longest = 2 * p.patience * (len(session.pending) + p.attempts) + p.wait + p.pause + p.trail
    created = False
    try:
        with SideRecording(rig, path) as along, rig.daq.stream(channels, rate_hz, samples) as stream:
            header = _header(rig, stream, session, p)
            with (
                Writer(
                    path, header, samples, int(longest / p.block) + 2, along.reserve(longest, samples)
                ) as writer,
                StreamReader(stream, rig.clock) as reader,
            ):
                created = True
                try:
                    publish = rig.live_run("record", str(path), stream.channels, stream.rate_hz)
                    blocks = _written(reader, writer, along, publish)
                    SessionRun(rig, session, p, told, writer).conduct(blocks)
                    along.finish(writer)
                except BaseException as error:  # Ctrl-C and SIGTERM among them
                    with uninterrupted():
                        _keep(reader, writer, along, error)
                    raise
    except BaseException:
        if created:
            # If this fails, the file stays as it is, readable and recoverable: raise what ended the session.
            with suppress(DataError, InstrumentError):
                finish(path, "interrupted")
        raise
    finish(path)
    return Recording.open(path)


def _header(rig: Rig, stream: Stream, session: Session, p: Protocol) -> Header:
    return Header(
        button=session.button,
        participant=session.participant,
        presses=len(session.pending),
        rig_name=rig.name,
        simulated=rig.simulated,
        rate_hz=float(stream.rate_hz),
        channels=tuple(stream.channels),
        full_scale=np.asarray(stream.full_scale, dtype=np.float64),
        delays=np.asarray(stream.delays, dtype=np.float64),
        rest=p.rest,
        rig=rig.file.model_dump_json(),
        daq=str(rig.daq.identity),
        software=f"haploop {metadata.version('haploop')}",
        started=datetime.now(UTC).isoformat(timespec="seconds"),
        study=session.study,
        session=session.number,
        protocol=p.to_json(),
        notes=session.notes,
        about=json.dumps(dict(session.about), sort_keys=True),
    )


def _written(
    reader: StreamReader, writer: Writer, along: SideRecording, publish: Callable[[Block], None]
) -> Iterator[Block]:
    """Yield each block after it was written to the file, so that no consumer can lose it."""
    for block in reader:
        writer.write(block, reader.arrived)
        publish(block)
        along.follow(writer)
        yield block


def _keep(reader: StreamReader, writer: Writer, along: SideRecording, error: BaseException) -> None:
    """Write the samples read but not yet written, and the event that ended the recording."""
    reader.stop()
    try:
        for block in reader.left():
            writer.write(block, reader.arrived)
        kinds = {KeyboardInterrupt: "interrupted", GapError: "gap", OverrunError: "overrun"}
        writer.note(
            writer.written, kinds.get(type(error), "error"), str(error) or "The recording was interrupted."
        )
        along.finish(writer)
    except InstrumentError:
        if not isinstance(error, InstrumentError):
            raise
        # The disk failed; `error` already states it.


_BLOCK = 0.04
"""s: 25 blocks a second, so that a view moves as a person expects."""


def look(rig: Rig, wanted: Callable[[], bool] = lambda: True) -> None:
    """Acquire every channel that a sensor or the laser reads while `wanted`, for live views. Nothing is kept.

    `Rig.tap`, `haploop live` and the console show the blocks as those of a recording. Raises
    ConfigurationError for a rig without any such channel, and InstrumentError.
    """
    laser = (rig.vibrometer.channel,) if rig.has("vibrometer") else ()
    drive = rig.sensors.drive.channels if rig.sensors.drive is not None else ()
    channels = list(dict.fromkeys(chain(rig.sensors.recorded, drive, laser)))
    if not channels:
        raise ConfigurationError(f"The rig {rig.name!r} has no sensors: describe them in [sensors].")
    rate_hz = rig.file.rate_hz
    with (
        rig.daq.stream(channels, rate_hz, round(_BLOCK * rate_hz)) as stream,
        StreamReader(stream, rig.clock) as reader,
    ):
        publish = rig.live_run("look", "", stream.channels, stream.rate_hz)
        for block in reader:
            publish(block)
            if not wanted():
                return


# The stream reader: a thread that only moves blocks from a stream to a queue.
#
# It never waits for a disk, a plot or a person. The blocks are consumed in the thread that created the
# `StreamReader`, normally the main thread, which receives Ctrl-C.

_POLL = 0.1
"""Interval at which the reader looks whether it is to stop (s)."""
_STOP_DEADLINE = 10.0
"""Seconds allowed for the thread to return from the driver, whose own time-outs are shorter."""


class GapError(InstrumentError):
    """Samples were lost between two blocks."""


class OverrunError(InstrumentError):
    """The queue was full: blocks arrived faster than they were written."""


class StreamReader:
    """A context manager that reads a stream; iterating over it gives the blocks in order without a gap.

    `depth` is the length of the queue in blocks. Iteration raises the stream's own InstrumentError, a
    GapError when a block does not follow the preceding one, or an OverrunError when the queue was full:
    in each case only after every earlier block. After `stop`, `left` yields the blocks that may not have
    been consumed.
    """

    def __init__(self, stream: Stream, clock: Clock, depth: int = 400) -> None:
        self._stream = stream
        self._clock = clock
        self._depth = depth
        # The block being consumed stays at the head until its consumer asks for the next, so that an
        # interrupt between any two instructions loses no block.
        self._queue: Inbox[tuple[Block, float] | BaseException | None] = Inbox()
        self.arrived = 0.0
        """When the driver gave the block that is being consumed (s of the clock)."""
        self._stopping = Flag()
        self._handled = Flag()
        self._thread = threading.Thread(target=self._read, name="haploop-reader", daemon=True)
        self._next = 0

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def __iter__(self) -> Iterator[Block]:
        while True:
            while not self._queue.wait():
                pass
            item = self._queue.head()
            if item is None:
                return
            if isinstance(item, BaseException):
                raise item
            block, self.arrived = item
            if block.first != self._next:
                raise GapError(
                    f"Samples {self._next} to {block.first - 1} were lost: a block was expected at sample "
                    f"{self._next} and begins at {block.first}. Close other programs, or use a larger buffer."
                )
            self._next = block.end
            yield block
            self._queue.take()
            self._handled.set()

    @property
    def waiting(self) -> int:
        """Number of blocks read and not yet consumed."""
        return len(self._queue)

    def stop(self) -> None:
        """Stop the thread; the stream itself stays open. May be called again.

        Raises InstrumentError when the driver does not return.
        """
        self._stopping.set()
        if self._thread.ident is not None:
            self._thread.join(_STOP_DEADLINE)
        if self._thread.is_alive():
            raise InstrumentError(
                f"The DAQ's driver did not return from a read within {_STOP_DEADLINE:g} s: "
                "restart the program, and check the card."
            )

    def left(self) -> Iterator[Block]:
        """Yield, after `stop`, the block being consumed and all that follow it without a gap.

        The consumer may have processed the first of them already; its index tells.
        """
        for item in self._queue:
            if item is None or isinstance(item, BaseException):
                return
            block, self.arrived = item
            if self._next not in (block.first, block.end):
                return
            self._next = block.end
            yield block

    def _read(self) -> None:
        try:
            for block in self._stream:
                self._handled.clear()
                if len(self._queue) >= self._depth:
                    raise OverrunError(
                        f"The recorder fell behind: {self._depth} blocks wait to be written, and reading "
                        f"stopped at sample {block.first}. Use a faster or less busy disk."
                    )
                self._queue.put((block, self._clock.now()))
                self._clock.hold(self._consumed)
                if self._stopping.is_set():
                    return
            self._queue.put(None)
        except BaseException as error:  # raised again in the consumer's thread
            self._queue.put(error)

    def _consumed(self) -> None:
        """Wait until the consumer asks for the next block, or the reader is stopped."""
        while not self._handled.wait(_POLL) and not self._stopping.is_set():
            pass
