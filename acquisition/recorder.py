"""Recording presses: ask for one, watch it happen, ask for the next, while every sample goes to disk."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

import numpy as np

from acquisition.layout import Header, file_name
from acquisition.presses import Detector, Segmentation
from acquisition.reading import GapError, Reader
from acquisition.recording import Recording
from acquisition.scan import finish
from acquisition.store import Writer, check_target
from instruments import (
    Block,
    Clock,
    ConfigurationError,
    DataError,
    ForceTorque,
    InstrumentError,
    Press,
    Rest,
    Rig,
    Sensor,
    Stream,
)
from instruments.arrays import FloatArray
from instruments.signals import uninterrupted

__all__ = ["Protocol", "record"]


@dataclass(frozen=True)
class Protocol:
    """How presses are asked for. Times in s of the stream, never of the wall."""

    block: float = 0.05
    rest: float = 0.5
    """Hands off, at the beginning: the sensors' rest is measured."""
    rest_spread: float = 0.15
    """N. More force than this, up and down within `rest`, is not hands off (noise: 0.03 N)."""
    patience: float = 15.0
    """How long to wait for hands off, for a press to begin, and for it to end."""
    quiet: float = 0.3
    """Without force, before a press counts as over and the next is asked for."""
    trail: float = 0.5
    """Recorded after the last press."""


def record(
    rig: Rig,
    button: str,
    participant: str,
    presses: int,
    out: str | Path,
    progress: Callable[[int, int], None] = lambda _done, _of: None,
) -> Recording:
    """Record `presses` presses of a button into `<out>/<participant>-<button>.h5`.

    The operator is asked to keep hands off, then for each press once the one before has ended.
    `progress(done, of)` is called at the start and after each press. Whatever ends it early (Ctrl-C
    and a lost sample too) leaves a readable recording of all that was read, not `complete` and without
    the room that was left over, then the error goes on.

    Raises ConfigurationError for a bad name, a missing sensor, an existing file, and a folder or disk
    that cannot take it; DataError when no press comes within 15 s; InstrumentError when a sample is
    lost or the disk refuses.
    """
    if not isinstance(presses, int | np.integer) or presses < 1:
        raise ConfigurationError(f"{presses} presses were asked for; a whole number, at least 1, is needed.")
    presses = int(presses)
    path = Path(out) / file_name(participant, button)
    force, channels = _wiring(rig)
    check_target(path)
    p = Protocol()
    rate_hz = rig.file.rate_hz
    samples = round(p.block * rate_hz)
    # The longest that it can last, so that room for all of it is taken before the first sample.
    longest = 2 * p.patience * (presses + 1) + p.trail
    laid_out = False
    try:
        with rig.daq.stream(channels, rate_hz, samples) as stream:
            header = _header(rig, stream, button, participant, presses, p)
            with (
                Writer(path, header, samples, int(longest / p.block) + 2) as writer,
                Reader(stream, rig.clock) as reader,
            ):
                laid_out = True
                try:
                    _conduct(rig, _written(reader, writer, rig.clock), writer, header, force, p, progress)
                except BaseException as error:
                    with uninterrupted():
                        _keep(reader, writer, rig.clock.now(), error)
                    raise
    except BaseException:
        if laid_out:
            # Where this fails, the file stays as it is, whole and recoverable: what ended it is told.
            with suppress(DataError, InstrumentError):
                finish(path, "interrupted")
        raise
    finish(path)
    return Recording.open(path)


def _wiring(rig: Rig) -> tuple[ForceTorque, list[str]]:
    """The force sensor and every channel to record. Raises ConfigurationError."""
    sensors: dict[str, Sensor | None] = {
        "force": rig.sensors.force,
        "acceleration": rig.sensors.acceleration,
        "activation": rig.sensors.activation,
    }
    missing = [name for name, sensor in sensors.items() if sensor is None]
    force = rig.sensors.force
    if missing or force is None:
        raise ConfigurationError(
            f"The rig {rig.name!r} has no [sensors.{missing[0]}]; recording a press needs force, "
            "acceleration and activation."
        )
    return force, [name for sensor in sensors.values() if sensor for name in sensor.channels]


def _header(rig: Rig, stream: Stream, button: str, participant: str, presses: int, p: Protocol) -> Header:
    return Header(
        button=button,
        participant=participant,
        presses=presses,
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
    )


def _written(reader: Reader, writer: Writer, clock: Clock) -> Iterator[Block]:
    """Each block once it is in the file, so that whoever looks at it cannot lose it."""
    for block in reader:
        writer.write(block, clock.now())
        yield block


def _conduct(
    rig: Rig,
    blocks: Iterator[Block],
    writer: Writer,
    header: Header,
    force: ForceTorque,
    p: Protocol,
    progress: Callable[[int, int], None],
) -> None:
    """The sitting: rest, presses, trail."""
    rows = [header.channels.index(name) for name in force.channels]
    of = header.presses
    stream = _Watch(blocks, rows, header.rate_hz)
    rig.operator.tell(Rest(p.rest))
    rest = _rest(stream, force, p)
    writer.note(stream.index, "rest", "Hands were off until here.")
    detector = Detector(header.rate_hz, Segmentation(quiet=p.quiet))
    for number in range(1, of + 1):
        progress(number - 1, of)
        request = Press(header.button, header.participant, number, of)
        writer.note(stream.index, "prompt", str(request))
        rig.operator.tell(request)
        deadline = stream.index + p.patience * header.rate_hz
        before = len(detector.spans)
        begun = False
        while len(detector.spans) == before:
            detector.feed(force.to_si(stream.next() - rest)[2])
            if detector.pressing and not begun:
                begun = True
                deadline = stream.index + p.patience * header.rate_hz
            if stream.index > deadline and len(detector.spans) == before:
                raise DataError(
                    f"{'Press' if begun else 'No press'} {number} of {of} "
                    f"{'did not end' if begun else 'arrived'} within {p.patience:g} s of "
                    f"{'its beginning' if begun else 'the prompt'}; what was recorded stays in {writer.path}."
                )
        writer.note(stream.index, "pressed", f"Press {number} of {of} was seen.")
    end = stream.index + p.trail * header.rate_hz
    while stream.index < end:
        stream.next()
    progress(of, of)


class _Watch:
    """The stream as the sitting sees it: gauge volts, and where it is."""

    def __init__(self, blocks: Iterator[Block], rows: list[int], rate_hz: float) -> None:
        self._blocks = blocks
        self._rows = rows
        self.rate_hz = rate_hz
        self.index = 0

    def next(self) -> FloatArray:
        """(6, samples) V of the next block. Raises InstrumentError when the stream has ended."""
        block = next(self._blocks, None)
        if block is None:
            raise InstrumentError(f"The DAQ ended its stream at sample {self.index}, in the middle of it.")
        self.index = block.end
        return block.volts[self._rows]


def _rest(stream: _Watch, force: ForceTorque, p: Protocol) -> FloatArray:
    """(6, 1) V: mean of the gauges over the first `p.rest` seconds without a hand. Raises DataError."""
    recent: deque[FloatArray] = deque(maxlen=max(1, round(p.rest / p.block)))
    while stream.index < p.patience * stream.rate_hz:
        recent.append(stream.next())
        if len(recent) < (recent.maxlen or 0):
            continue
        # Means of blocks: noise is averaged away, a hand is not.
        means = np.stack([volts.mean(axis=1) for volts in recent], axis=1)
        if np.ptp(force.to_si(means)[2]) < p.rest_spread:
            return np.asarray(means.mean(axis=1, keepdims=True))
    raise DataError(
        f"The force did not come to rest within {p.patience:g} s: take hands off the button, and begin again."
    )


def _keep(reader: Reader, writer: Writer, now: float, error: BaseException) -> None:
    """Write what has been read but not yet written, and why the recording ended."""
    reader.stop()
    try:
        for block in reader.left():
            writer.write(block, now)
        kinds = {KeyboardInterrupt: "interrupted", GapError: "gap"}
        writer.note(
            writer.written, kinds.get(type(error), "error"), str(error) or "The recording was interrupted."
        )
    except InstrumentError:
        if not isinstance(error, InstrumentError):
            raise
        # The disk itself failed, and `error` says so already.
