"""Recording presses: ask for one, watch it happen, judge it, ask for the next; every sample goes to disk."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

import numpy as np

from acquisition.judging import Judge
from acquisition.layout import Header, Judged, file_name
from acquisition.presses import Detector, segmentation_for
from acquisition.protocol import Protocol
from acquisition.reading import GapError, OverrunError, Reader
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

__all__ = ["Session", "ignore", "record", "sit"]

_HISTORY = 1.0
"""s of samples kept from before a press, to judge it by."""


def ignore(*_told: object) -> None:
    """Who does not want to be told."""


@dataclass(frozen=True)
class Session:
    """One sitting: whose presses of which button go into which file."""

    path: Path
    button: str
    participant: str
    wanted: tuple[tuple[int, int], ...]
    """Which presses are still to come: their numbers, and which attempt is next."""
    of: int
    """How many there will be in all, with those of earlier sittings."""
    study: str = ""
    number: str = ""
    """Which sitting it is, within a study."""
    consent: str = ""
    """What was confirmed of the participant's consent."""
    notes: str = ""
    """What the operator notes before it."""
    words: str = ""
    """What the operator is told instead of `Press`'s own words; may hold the names of its fields."""


def record(
    rig: Rig,
    button: str,
    participant: str,
    presses: int,
    out: str | Path,
    progress: Callable[[int, int], None] = ignore,
    judged: Callable[[Judged], None] = ignore,
    protocol: Protocol | None = None,
    notes: str = "",
) -> Recording:
    """Record `presses` good presses of a button into `<out>/<participant>-<button>.h5`.

    The operator is asked to keep hands off, then for each press once the one before has ended. Each
    press is judged at once; a bad one is kept, marked, and asked for again. `progress(done, of)` is
    called at the start and after each good press, `judged(press)` after each press. Whatever ends it
    early (Ctrl-C and a lost sample too) leaves a readable recording of all that was read, not `complete`
    and without the room that was left over, then the error goes on.

    Raises ConfigurationError for a bad name, a missing sensor, an existing file, and a folder or disk
    that cannot take it; DataError when no press comes within 15 s, or no good one in 5 attempts;
    InstrumentError when a sample is lost or the disk refuses.
    """
    if not isinstance(presses, int | np.integer) or presses < 1:
        raise ConfigurationError(f"{presses} presses were asked for; a whole number, at least 1, is needed.")
    presses = int(presses)
    path = Path(out) / file_name(participant, button)
    wanted = tuple((number, 1) for number in range(1, presses + 1))
    session = Session(path, button, participant, wanted, presses, notes=notes)
    protocol = protocol or Protocol(segmentation=segmentation_for(button))
    return sit(rig, session, protocol, progress, judged)


def sit(
    rig: Rig,
    session: Session,
    p: Protocol,
    progress: Callable[[int, int], None] = ignore,
    judged: Callable[[Judged], None] = ignore,
) -> Recording:
    """Record the presses that a session still wants. As `record`, which it is the whole of."""
    path = session.path
    force, channels = _wiring(rig)
    check_target(path)
    rate_hz = rig.file.rate_hz
    samples = round(p.block * rate_hz)
    # The longest that it can last, so that room for all of it is taken before the first sample.
    longest = 2 * p.patience * (len(session.wanted) + p.attempts) + p.trail
    laid_out = False
    try:
        with rig.daq.stream(channels, rate_hz, samples) as stream:
            header = _header(rig, stream, session, p)
            with (
                Writer(path, header, samples, int(longest / p.block) + 2) as writer,
                Reader(stream, rig.clock) as reader,
            ):
                laid_out = True
                try:
                    blocks = _written(reader, writer, rig.clock)
                    _Sitting(rig, blocks, writer, header, force, session, p, progress, judged).conduct()
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


def _header(rig: Rig, stream: Stream, session: Session, p: Protocol) -> Header:
    return Header(
        button=session.button,
        participant=session.participant,
        presses=len(session.wanted),
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
    )


def _written(reader: Reader, writer: Writer, clock: Clock) -> Iterator[Block]:
    """Each block once it is in the file, so that whoever looks at it cannot lose it."""
    for block in reader:
        writer.write(block, clock.now())
        yield block


class _Sitting:
    """What happens between the first block and the last: rest, presses, trail."""

    def __init__(
        self,
        rig: Rig,
        blocks: Iterator[Block],
        writer: Writer,
        header: Header,
        force: ForceTorque,
        session: Session,
        p: Protocol,
        progress: Callable[[int, int], None],
        judged: Callable[[Judged], None],
    ) -> None:
        self._operator, self._blocks, self._writer, self._force = rig.operator, blocks, writer, force
        self._session, self._p, self._rate_hz = session, p, header.rate_hz
        self._progress, self._judged = progress, judged
        self._gauges = [header.channels.index(name) for name in force.channels]
        self._detector = Detector(header.rate_hz, replace(p.segmentation, quiet=p.quiet))
        self._judge = Judge(writer.path, header, rig.sensors, p)
        self._index = self._began = 0
        self._rest: FloatArray = np.zeros((len(force.channels), 1))
        self._recent: deque[Block] = deque()
        self._wanted = deque(session.wanted)
        self._done = session.of - len(session.wanted)
        self._attempts: dict[int, int] = {}
        self._last: Judged | None = None
        """The press before, while it is accepted."""

    def conduct(self) -> None:
        """All of it. Raises DataError and InstrumentError."""
        if self._session.consent:
            self._writer.note(0, "consent", self._session.consent)
        self._operator.tell(Rest(self._p.rest))
        self._rest = self._settled()
        self._writer.note(self._index, "rest", "Hands were off until here.")
        self._began = self._index
        self._count(0)
        because = ""
        while self._wanted:
            number, attempt = self._wanted.popleft()
            because = self._ask(number, attempt, because)
            if not self._wanted:
                self._wait(self._p.trail)

    def _ask(self, number: int, attempt: int, because: str) -> str:
        """Have a press made, and judge it. Why it is asked for again; "" when it is a good one."""
        s = self._session
        words = s.words.format(button=s.button, participant=s.participant, number=number, of=s.of)
        request = Press(s.button, s.participant, number, s.of, attempt, because, words)
        self._writer.note(self._index, "prompt", str(request))
        self._operator.tell(request)
        self._await(number)
        self._writer.note(self._index, "pressed", f"Press {number} of {s.of} was seen.")
        judged = self._judge_last(number, attempt)
        self._writer.judge(judged)
        self._last = judged if judged.accepted else None
        self._judged(judged)
        if judged.accepted:
            self._count(+1)
        else:
            self._again(judged)
        return judged.reason

    def _await(self, number: int) -> None:
        """Return once a press has been made, and hands are off again. Raises DataError."""
        p, before = self._p, len(self._detector.spans)
        deadline = self._index + p.patience * self._rate_hz
        begun = False
        while len(self._detector.spans) == before:
            self._next()
            if self._detector.pressing and not begun:
                begun = True
                deadline = self._index + p.patience * self._rate_hz
            if self._index > deadline and len(self._detector.spans) == before:
                raise DataError(
                    f"{'Press' if begun else 'No press'} {number} of {self._session.of} "
                    f"{'did not end' if begun else 'arrived'} within {p.patience:g} s of "
                    f"{'its beginning' if begun else 'the prompt'}; {self._kept}."
                )

    def _judge_last(self, number: int, attempt: int) -> Judged:
        """The verdict on the press that was just seen."""
        volts = np.concatenate([block.volts for block in self._recent], axis=1)
        span = self._detector.spans[-1]
        # The detector counts from where hands were off.
        span = span._replace(first=span.first + self._began, end=span.end + self._began)
        judged = self._judge(volts, self._recent[0].first, span, number, attempt)
        # Nothing of this press is seen when the next one is judged.
        self._recent.clear()
        return judged

    def _again(self, judged: Judged) -> None:
        """Ask for a press again, next. Raises DataError when that has been done too often."""
        tried = self._attempts[judged.number] = self._attempts.get(judged.number, 0) + 1
        if tried >= self._p.attempts:
            raise DataError(
                f"Press {judged.number} of {self._session.of} went wrong {tried} times, at last so: "
                f"{judged.reason} Look at the button and the sensors, and begin again; {self._kept}."
            )
        self._wanted.appendleft((judged.number, judged.attempt + 1))

    def _next(self) -> None:
        """One block more. Raises InstrumentError when the stream has ended."""
        block = self._block()
        self._recent.append(block)
        history = block.end - _HISTORY * self._rate_hz
        while not self._detector.pressing and self._recent[0].end < history:
            self._recent.popleft()
        self._detector.feed(self._force.to_si(block.volts[self._gauges] - self._rest)[2])
        if self._operator.rejects() and self._last is not None:
            self._reject(self._last)

    def _reject(self, last: Judged) -> None:
        """The operator takes back that the press before was a good one."""
        self._last = None
        rejected = last._replace(
            accepted=False, flags=(*last.flags, "rejected"), reason="The operator rejected it."
        )
        self._writer.judge(rejected)
        self._judged(rejected)
        self._count(-1)
        self._again(rejected)

    def _count(self, more: int) -> None:
        self._done += more
        self._progress(self._done, self._session.of)

    def _wait(self, duration: float) -> None:
        end = self._index + duration * self._rate_hz
        while self._index < end:
            self._next()

    def _settled(self) -> FloatArray:
        """(6, 1) V: mean of the gauges over the first `p.rest` seconds without a hand. Raises DataError."""
        p = self._p
        recent: deque[FloatArray] = deque(maxlen=max(1, round(p.rest / p.block)))
        while self._index < p.patience * self._rate_hz:
            recent.append(self._block().volts[self._gauges])
            if len(recent) < (recent.maxlen or 0):
                continue
            # Means of blocks: noise is averaged away, a hand is not.
            means = np.stack([volts.mean(axis=1) for volts in recent], axis=1)
            if np.ptp(self._force.to_si(means)[2]) < p.rest_spread:
                return np.asarray(means.mean(axis=1, keepdims=True))
        raise DataError(
            f"The force did not come to rest within {p.patience:g} s: take hands off the button, and begin "
            "again."
        )

    def _block(self) -> Block:
        block = next(self._blocks, None)
        if block is None:
            raise InstrumentError(f"The DAQ ended its stream at sample {self._index}, in the middle of it.")
        self._index = block.end
        return block

    @property
    def _kept(self) -> str:
        return f"what was recorded stays in {self._writer.path}"


def _keep(reader: Reader, writer: Writer, now: float, error: BaseException) -> None:
    """Write what has been read but not yet written, and why the recording ended."""
    reader.stop()
    try:
        for block in reader.left():
            writer.write(block, now)
        kinds = {KeyboardInterrupt: "interrupted", GapError: "gap", OverrunError: "overrun"}
        writer.note(
            writer.written, kinds.get(type(error), "error"), str(error) or "The recording was interrupted."
        )
    except InstrumentError:
        if not isinstance(error, InstrumentError):
            raise
        # The disk itself failed, and `error` says so already.
