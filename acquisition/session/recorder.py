"""Recording presses: every sample of a session goes to disk; a look at the sensors before makes no file."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import suppress
from datetime import UTC, datetime
from importlib import metadata
from itertools import chain
from pathlib import Path

import numpy as np

from ...base.errors import ConfigurationError, DataError, InstrumentError
from ...base.files import check_destination, private_files
from ...base.marks import marked
from ...base.progress import Progress, silent
from ...base.signals import uninterrupted
from ...instruments import Block, Request, Rig, Stream
from ..presses import Protocol, segmentation_for
from ..recording import Header, PressVerdict, Recording, Writer, file_name, finish, set_aside
from .along import Along
from .session_run import Session, SessionRun, Told, ignore, telling_sensor
from .stream_reader import GapError, OverrunError, StreamReader

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
    return run_session(rig, session, protocol, Told(progress, on_verdict, on_request))


def run_session(rig: Rig, session: Session, p: Protocol, told: Told) -> Recording:
    """Record the presses still due in a session. `record` calls this with a one-button session."""
    telling_sensor(rig)
    with private_files():
        check_destination(session.path)
    with marked(session.path):
        return _recorded(rig, session, p, told)


def _recorded(rig: Rig, session: Session, p: Protocol, told: Told) -> Recording:
    path = session.path
    channels, rate_hz = list(rig.sensors.recorded), rig.file.rate_hz
    samples = round(p.block * rate_hz)
    # The longest possible session, so that space for all of it is allocated before the first sample.
    longest = 2 * p.patience * (len(session.pending) + p.attempts) + p.wait + p.pause + p.trail
    created = False
    try:
        with (
            Along(rig, path) as along,
            rig.daq.stream(channels, rate_hz, samples) as stream,
        ):
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
    reader: StreamReader, writer: Writer, along: Along, publish: Callable[[Block], None]
) -> Iterator[Block]:
    """Yield each block after it was written to the file, so that no consumer can lose it."""
    for block in reader:
        writer.write(block, reader.arrived)
        publish(block)
        along.follow(writer)
        yield block


def _keep(reader: StreamReader, writer: Writer, along: Along, error: BaseException) -> None:
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
