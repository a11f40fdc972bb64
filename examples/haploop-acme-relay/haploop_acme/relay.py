"""ACME RB-8: eight relays on a serial port, each with a timer that opens it.

Commands and answers are lines. `ID` returns the name. `CLOSE n ms` closes channel n for some milliseconds,
`OPEN n` opens it; both return `OK`. `READ` returns eight numbers: milliseconds until each opens, 0 if open.
"""

from collections.abc import Callable
from typing import Annotated, Self

from pydantic import Field

from haploop.base.clock import Clock
from haploop.base.errors import InstrumentError
from haploop.instruments.relay import BoardSettings, ChannelRelay, ChannelState
from haploop.instruments.transport import Line, SerialLine


class AcmeRelay(ChannelRelay):
    """Driver of the RB-8: `ChannelRelay` switches, reads back and renews; `_Board` speaks the protocol."""

    taped = True  # every call to the board goes through SerialLine

    class Settings(BoardSettings):
        patches: Annotated[dict[str, Annotated[int, Field(ge=1, le=8)]], Field(min_length=1)]
        port: str
        timeout: Annotated[float, Field(gt=0, le=60)] = 1.0
        dead_man: Annotated[float, Field(gt=0, le=60)] = 2.0

    def __init__(self, settings: Settings, clock: Clock, line: Line) -> None:
        super().__init__(settings, clock, _Board(line, settings.dead_man))

    @classmethod
    def open(cls, settings: Settings, clock: Clock) -> Self:
        """Open the port and check the board's identity, without switching. Raises InstrumentError."""
        return cls(settings, clock, SerialLine("ACME RB-8", settings.port, 9600, settings.timeout))


class _Board:
    def __init__(self, line: Line, dead_man: float) -> None:
        self._line, self.dead_man = line, dead_man
        self.identity = self._ask("ID", lambda answer: answer.startswith("ACME RB-8"))

    def states(self) -> dict[int, ChannelState]:
        times = self._ask("READ", lambda answer: [t.isdecimal() for t in answer.split()] == 8 * [True])
        return {n: ChannelState(int(t) > 0, int(t) / 1000) for n, t in enumerate(times.split(), start=1)}

    def open_channel(self, channel: int) -> None:
        self._ask(f"OPEN {channel}", "OK".__eq__)

    def close_channel(self, channel: int) -> None:
        self._ask(f"CLOSE {channel} {round(self.dead_man * 1000)}", "OK".__eq__)

    def release(self) -> None:
        self._line.close()

    def _ask(self, command: str, is_answer: Callable[[str], bool]) -> str:
        self._line.send(command)
        answer = self._line.receive(command)
        if not is_answer(answer):
            self._line.close()
            raise InstrumentError(f"The RB-8 answered {command!r} with {answer!r}: check 'port' in [relay].")
        return answer
