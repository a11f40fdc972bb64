"""A running session, from the first block to the last: rest, presses, trail.

Prompt for a press, detect it, check its quality, prompt for the next.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ...base.arrays import FloatArray
from ...base.errors import ConfigurationError, DataError, InstrumentError
from ...base.progress import Progress, silent
from ...instruments import Block, LinearSensor, Press, Request, Rest, Rig
from ..presses import (
    NAMES,
    Detector,
    LivePressing,
    Protocol,
    QualityCheck,
    press_quantity,
    require_rate,
    restlessness,
)
from ..recording import PressVerdict, Writer

_HISTORY = 1.0
"""s: samples before a press kept for its quality check."""


def ignore(*_told: object) -> None:
    """Do nothing: the default callback."""


@dataclass(frozen=True)
class Session:
    """One session: a participant's presses of a button, recorded into one file."""

    path: Path
    button: str
    participant: str
    pending: tuple[tuple[int, int], ...]
    """Presses still due: (number, next attempt) of each."""
    of: int
    """Total number of presses, earlier sessions included."""
    study: str = ""
    number: str = ""
    """Number of this session within a study."""
    consent: str = ""
    """Text of the consent event; "" for none."""
    notes: str = ""
    """Notes by the operator, kept in the recording."""
    words: str = ""
    """Prompt that replaces the default text of `Press`; may contain the names of its fields."""
    about: Mapping[str, str | float | bool] = field(default_factory=dict)
    """What is stored of the participant: columns and values."""


@dataclass(frozen=True)
class Listeners:
    """Who is told how a session goes on."""

    progress: Progress = silent
    """Number of accepted presses, at the start and after each one."""
    on_verdict: Callable[[PressVerdict], None] = ignore
    on_request: Callable[[Request], None] = ignore
    """What the operator is told."""


class SessionRun:
    """A running session, from the first block to the last: rest, presses, trail."""

    def __init__(self, rig: Rig, session: Session, p: Protocol, told: Listeners, writer: Writer) -> None:
        sensor, header = telling_sensor(rig), writer.header
        self._operator, self._writer, self._told = rig.operator, writer, told
        self._session, self._p, self._rate_hz = session, p, header.rate_hz
        self._rows = [header.channels.index(name) for name in sensor.channels]
        self._pressing = LivePressing(sensor, header.rate_hz, p.segmentation, p.rest_spread)
        self._detector = self._new_detector()
        self._check_quality = QualityCheck(writer.path, header, rig.sensors, p)
        self._index = self._began = 0
        self._channels, self._tared = header.channels, _tared(rig)
        self._recent: deque[Block] = deque()
        self._pending = deque(session.pending)
        self._done = session.of - len(session.pending)
        self._attempts: dict[int, int] = {}
        self._wait_left = p.wait
        """s: remaining extra wait for a participant who is away."""
        self._pause_left = p.pause
        """s: remaining time for which the operator may pause."""
        self._remind_at = p.patience
        self._last: PressVerdict | None = None
        """Verdict on the preceding press, while it is accepted."""

    def conduct(self, blocks: Iterator[Block]) -> None:
        """Run the session to its end. Raises DataError and InstrumentError."""
        self._blocks = blocks
        if self._session.consent:
            self._writer.note(0, "consent", self._session.consent)
        self._tell(Rest(self._p.rest))
        self._settle()
        self._detector = self._new_detector()
        self._writer.note(self._index, "rest", "Hands were off until here.")
        self._began = self._index
        self._count(0)
        because = ""
        while self._pending:
            number, attempt = self._pending.popleft()
            because = self._ask(number, attempt, because)
            if not self._pending:
                self._wait(self._p.trail)

    def _ask(self, number: int, attempt: int, because: str) -> str:
        """Prompt for a press and check it. Returns the reason for asking again, or "" when accepted."""
        s = self._session
        words = s.words.format(button=s.button, participant=s.participant, number=number, of=s.of)
        self._paused()
        request = Press(
            s.button, s.participant, number, s.of, attempt, because, words, self._p.patience, self._wait_left
        )
        self._writer.note(self._index, "prompt", str(request))
        self._tell(request)
        self._await(request)
        self._writer.note(self._index, "pressed", f"Press {number} of {s.of} was seen.")
        verdict = self._check_last(number, attempt)
        self._writer.write_verdict(verdict)
        self._last = verdict if verdict.accepted else None
        self._told.on_verdict(verdict)
        if verdict.accepted:
            self._count(+1)
        else:
            self._again(verdict)
        return "" if verdict.accepted else verdict.reason

    def _await(self, request: Press) -> None:
        """Wait until a press is over and hands are off again. Raises DataError."""
        p, before, asked = self._p, len(self._detector.spans), self._index
        began: int | None = None
        self._remind_at = p.patience
        while len(self._detector.spans) == before:
            self._next()
            if self._detector.pressing and began is None:
                began = self._index
                self._wait_left -= max(0.0, (began - asked) / self._rate_hz - p.patience)
            if len(self._detector.spans) > before:
                return
            # A press that has begun is finished first.
            if began is None and self._paused():
                self._tell(request)
                before, asked, self._remind_at = 0, self._index, p.patience
            if began is None and (waited := self._overdue(asked, request)):
                raise DataError(
                    f"No press {request.number} of {request.of} arrived within {waited:g} s of the prompt; "
                    f"{self._kept}."
                )
            if began is not None and self._index > began + p.patience * self._rate_hz:
                cause = self._restlessness(
                    [block.volts[self._rows] for block in self._recent][-round(1 / p.block) :]
                )
                raise DataError(
                    f"Press {request.number} of {request.of} did not end within {p.patience:g} s of its "
                    f"beginning{f': {cause}' if cause else ''}; {self._kept}."
                )

    def _overdue(self, asked: int, request: Request) -> float:
        """Waiting limit (s) if more time has passed since sample `asked`, else 0.

        The request is repeated after `patience`, and then at doubling intervals.
        """
        waited = (self._index - asked) / self._rate_hz
        limit = self._p.patience + self._wait_left
        if waited > limit:
            return limit
        if waited > self._remind_at:
            self._remind_at *= 2
            self._tell(_still_waiting(request, limit - waited))
        return 0.0

    def _tell(self, request: Request) -> None:
        self._operator.tell(request)
        self._told.on_request(request)

    def _check_last(self, number: int, attempt: int) -> PressVerdict:
        """Check the quality of the press that has just ended."""
        volts = np.concatenate([block.volts for block in self._recent], axis=1)
        span = self._detector.spans[-1]
        # The detector counts samples from the end of the rest.
        span = span._replace(first=span.first + self._began, end=span.end + self._began)
        verdict = self._check_quality(volts, self._recent[0].first, span, number, attempt)
        # The next press is checked without any sample of this one.
        self._recent.clear()
        return verdict

    def _again(self, verdict: PressVerdict) -> None:
        """Queue another attempt at a press. Raises DataError after too many attempts."""
        tried = self._attempts[verdict.number] = self._attempts.get(verdict.number, 0) + 1
        if tried >= self._p.attempts:
            raise DataError(
                f"Press {verdict.number} of {self._session.of} was not accepted in {tried} attempts. Last "
                f"reason: {verdict.reason} Check the button and the sensors, and start again; {self._kept}."
            )
        self._pending.appendleft((verdict.number, verdict.attempt + 1))

    def _next(self) -> None:
        """Process one block. Raises InstrumentError when the stream has ended."""
        block = self._take()
        self._detector.feed(self._pressing(block.volts[self._rows]))

    def _take(self) -> Block:
        """Keep one block for the quality check, and do what the operator has asked for."""
        block = self._block()
        self._recent.append(block)
        history = block.end - _HISTORY * self._rate_hz
        while not self._detector.pressing and self._recent[0].end < history:
            self._recent.popleft()
        if self._operator.rejects() and self._last is not None:
            self._reject(self._last)
        for text in self._operator.notes():
            self._writer.note(self._index, "note", text)
        return block

    def _paused(self) -> bool:
        """Pause for as long as the operator wants, and `pause` allows; True when there was a pause.

        The samples of a pause are recorded, and no press is looked for in them.
        """
        if not self._operator.paused() or self._pause_left <= 0:
            return False
        began = self._index
        self._writer.note(began, "paused", "The operator paused the session.")
        until = began + self._pause_left * self._rate_hz
        while self._operator.paused() and self._index < until:
            self._take()
        self._pause_left -= (self._index - began) / self._rate_hz
        ended = "The longest pause was over." if self._operator.paused() else "The operator went on."
        self._writer.note(self._index, "resumed", ended)
        self._detector, self._began = self._new_detector(), self._index
        return True

    def _new_detector(self) -> Detector:
        levels = self._pressing.levels
        levels = replace(levels, quiet=max(levels.quiet, self._p.quiet))
        return Detector(self._rate_hz, self._p.segmentation, levels)

    def _reject(self, last: PressVerdict) -> None:
        """Reject the preceding press for the operator."""
        self._last = None
        rejected = last._replace(
            accepted=False, flags=(*last.flags, "rejected"), reason="The operator rejected it."
        )
        self._writer.write_verdict(rejected)
        self._told.on_verdict(rejected)
        self._count(-1)
        self._again(rejected)

    def _count(self, more: int) -> None:
        self._done += more
        session = self._session
        doing = (
            f"{session.participant}, {session.button}"
            if session.study
            else f"Record the {session.button} button"
        )
        self._told.progress(doing, self._done, session.of, "presses")

    def _wait(self, duration: float) -> None:
        end = self._index + duration * self._rate_hz
        while self._index < end:
            self._next()

    def _settle(self) -> None:
        """Take the first `p.rest` seconds without a hand for the sensors' rest. Raises DataError."""
        p, pressing = self._p, self._pressing
        recent: deque[FloatArray] = deque(maxlen=max(1, round(p.rest / p.block)))
        reminder = Rest(p.rest)
        while not (waited := self._overdue(0, reminder)):
            block = self._block()
            # Sensors are looked at in the rest before the first press.
            self._recent.append(block)
            if len(self._recent) > (recent.maxlen or 0):
                self._recent.popleft()
            recent.append(block.volts[self._rows])
            if len(recent) < (recent.maxlen or 0):
                continue
            # Block means suppress noise, but not the force of a hand, nor what it knocks.
            means = [float(pressing.at_rest(volts).mean()) for volts in recent]
            if np.ptp(means) < pressing.levels.spread:
                self._wait_left -= max(0.0, self._index / self._rate_hz - p.patience)
                pressing.settle(np.concatenate(recent, axis=1))
                self._check_quality.rests |= self._rests()
                return
        cause = self._restlessness(list(recent)) or "take hands off the button"
        what = NAMES[pressing.quantity]
        raise DataError(f"The {what} did not come to rest within {waited:g} s: {cause}, and start again.")

    def _rests(self) -> dict[str, FloatArray]:
        """(channels,) V that sensors with a rest of their own showed in the recent blocks."""
        volts = np.concatenate([block.volts for block in self._recent], axis=1)
        rows = {
            name: [self._channels.index(channel) for channel in channels]
            for name, channels in self._tared.items()
        }
        return {name: np.asarray(volts[own].mean(axis=1)) for name, own in rows.items()}

    def _restlessness(self, recent: Sequence[FloatArray]) -> str:
        """The cause of a restless force in recent blocks of its channels, (channels, samples) V each."""
        if self._pressing.quantity != "force":
            return ""
        return restlessness(self._pressing.sensor.along(np.concatenate(recent, axis=1)), self._rate_hz)

    def _block(self) -> Block:
        block = next(self._blocks, None)
        if block is None:
            raise InstrumentError(
                f"The DAQ ended its stream early, at sample {self._index}: check the DAQ, and start again."
            )
        self._index = block.end
        return block

    @property
    def _kept(self) -> str:
        return f"the samples recorded so far are in {self._writer.path}"


def telling_sensor(rig: Rig) -> LinearSensor:
    """Find the sensor that tells presses. Raises ConfigurationError."""
    quantity = press_quantity(rig.sensors)
    if quantity is None:
        raise ConfigurationError(
            f"The rig {rig.name!r} has no sensor that shows a press: describe one of [sensors.force], "
            "[sensors.displacement], [sensors.acceleration] or [sensors.velocity] in its file."
        )
    require_rate("recording", rig.file.rate_hz, f"The rig {rig.name!r}", "raise rate_hz in its file")
    return rig.sensors.linear[quantity]


def _tared(rig: Rig) -> dict[str, tuple[str, ...]]:
    """Channels of the sensors that have a rest of their own, by what they measure."""
    return {name: sensor.channels for name, sensor in rig.sensors.linear.items() if sensor.tared}


def _still_waiting(request: Request, left: float) -> Request:
    """Return the request with how long the session waits from now on."""
    if not isinstance(request, Press):
        return request
    minutes, seconds = divmod(round(left), 60)
    time = f"{minutes} min {seconds} s" if minutes else f"{seconds} s"
    because = f"Still waiting; without a press, the session ends in {time}."
    return replace(request, because=because, patience=0.0, wait=left)
