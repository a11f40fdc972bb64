"""Function generators by SCPI over VISA: Keysight's 33500 family and Rigol's DG1000Z.

The Rigol's commands are from its programming guide. Of the Keysight's, trigger and output were found in
sources, and the sweep's are those usual in the family (docs/hardware.md, "Generators"). A generator that
waits for its trigger puts out the start frequency, not zero: so the trigger also switches the output on.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Annotated, Literal, Self, TypeVar

from pydantic import BaseModel, ConfigDict, Field

from ..clock import Clock
from ..driver import one_name
from ..errors import ConfigurationError, InstrumentError, LimitError
from ..transport import Line, VisaLine
from .role import Generator, Sweep
from .scpi_codec import error_of, number_of, switch_of, words_of

__all__ = ["Dg1000z", "Keysight33500", "ScpiGenerator"]

Value = TypeVar("Value")
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]

_TOLERANCE = 1e-3
"""Relative tolerance of a read-back: instruments round to four digits or more."""
_QUEUE = 50
"""Most errors read from a queue (either family's holds 20; docs/hardware.md, "Generators")."""


@dataclass(frozen=True)
class Dialect:
    """SCPI commands of one family; `{n}` is the channel."""

    models: str
    """Pattern of the model names."""
    still: tuple[str, ...]
    """Commands that stop sweep and burst and select a sine, so that no later settings conflict."""
    setup: tuple[str, ...]
    read: Mapping[str, str]
    """Queries that read a value back, by its name."""
    arm: tuple[str, ...]
    armed: tuple[str, str]
    """A query, and the pattern of the answers that mean armed."""
    fire: str


_SETUP = (
    "OUTP{n}:LOAD {load}",
    "SOUR{n}:VOLT:UNIT VPP",
    "SOUR{n}:VOLT:OFFS 0",
    "SOUR{n}:VOLT {peak_to_peak:.6g}",
    "SOUR{n}:FREQ:STAR {start_hz:.9g}",
    "SOUR{n}:FREQ:STOP {stop_hz:.9g}",
    "SOUR{n}:SWE:SPAC LIN",
    "SOUR{n}:SWE:TIME {duration:.9g}",
    "SOUR{n}:SWE:RTIM 0",
)
_READ = MappingProxyType(
    {
        "load": "OUTP{n}:LOAD?",
        "peak_to_peak": "SOUR{n}:VOLT?",
        "offset": "SOUR{n}:VOLT:OFFS?",
        "start_hz": "SOUR{n}:FREQ:STAR?",
        "stop_hz": "SOUR{n}:FREQ:STOP?",
        "duration": "SOUR{n}:SWE:TIME?",
    }
)
_STILL = ("SOUR{n}:SWE:STAT OFF", "SOUR{n}:BURS:STAT OFF", "SOUR{n}:FUNC SIN")

KEYSIGHT = Dialect(
    models=r"335\d\d[AB]|336\d\dA",
    still=_STILL,
    setup=(*_SETUP, "SOUR{n}:SWE:HTIM 0", "TRIG{n}:SOUR BUS"),
    read=_READ,
    arm=("SOUR{n}:FREQ:MODE SWE",),
    armed=("SOUR{n}:FREQ:MODE?", "SWE.*"),
    fire="*TRG",
)
RIGOL = Dialect(
    models=r"DG10\d\dZ",
    still=_STILL,
    setup=(
        *_SETUP,
        "SOUR{n}:SWE:HTIM:STAR 0",
        "SOUR{n}:SWE:HTIM:STOP 0",
        "SOUR{n}:SWE:TRIG:SOUR MAN",
    ),
    read=_READ,
    arm=("SOUR{n}:SWE:STAT ON",),
    armed=("SOUR{n}:SWE:STAT?", "ON|1"),
    fire=":SOUR{n}:SWE:TRIG:IMM",
)


class ScpiGenerator(Generator):
    """See `Generator`. A subclass adds its family's dialect."""

    dialect: Dialect

    class Settings(BaseModel):
        """The `[generator]` table of a rig file."""

        model_config = ConfigDict(frozen=True, extra="forbid")

        resource: Annotated[str, Field(min_length=1)]
        """VISA name: USB0::..., or TCPIP::HOST::PORT::SOCKET (5025 for Keysight, 5555 for Rigol)."""
        output: str
        """Name of the amplifier input that its output is wired to."""
        channel: Annotated[int, Field(ge=1, le=2)] = 1
        load: Literal["inf", 50] = "inf"
        """Load at the output (ohm); an amplifier's input counts as open."""
        highest: Positive = 1.0
        """Largest amplitude that may be set (V peak): 50 V at a patch behind a gain of 50."""
        visa: str = ""
        """VISA library: empty for the vendor's, or pyvisa-py without one; "@py" always takes pyvisa-py."""
        timeout: Annotated[float, Field(gt=0, le=60)] = 2.0
        """Time for a query to be answered completely (s)."""

    def __init__(self, settings: Settings, clock: Clock, line: Line) -> None:
        """Check the identity of the instrument on `line`. Raises InstrumentError."""
        self.output = settings.output
        self._settings = settings
        self._line = line
        self._sweep: Sweep | None = None
        self._armed = False
        self.identity = f"The generator at {settings.resource}"
        maker, model, number, _ = self._value("*IDN?", words_of)
        if not re.fullmatch(self.dialect.models, model):
            raise InstrumentError(
                f"{self.identity} says that it is a {maker[:40]} {model[:40]}, which this driver is not for: "
                "correct 'driver' or 'resource' in [generator]."
            )
        self.identity = f"{maker} {model} {number}"

    @staticmethod
    def hardware(settings: Settings) -> tuple[str, ...]:
        """See `Driver.hardware`: the generator."""
        return (one_name(settings.resource),)

    @classmethod
    def open(cls, settings: Settings, clock: Clock) -> Self:
        """Connect and read the identity; no setting is changed. Raises InstrumentError."""
        line = VisaLine("The generator", settings.resource, settings.visa, settings.timeout)
        try:
            return cls(settings, clock, line)
        except BaseException:
            line.close()
            raise

    @property
    def load(self) -> float:
        """See `Generator.load`."""
        return self._number("load")

    @property
    def amplitude(self) -> float:
        """See `Generator.amplitude`."""
        return self._number("peak_to_peak") / 2

    @property
    def is_on(self) -> bool:
        """See `Generator.is_on`."""
        return self._value(self._named("OUTP{n}?"), switch_of)

    def _configure(self, sweep: Sweep) -> None:
        if sweep.amplitude > self._settings.highest:
            raise LimitError(
                f"A sweep of {sweep.amplitude:g} V peak was refused: 'highest' in [generator] is "
                f"{self._settings.highest:g} V."
            )
        self._sweep = None
        self.off()
        for command in self.dialect.still:
            self._tell(command)
        # Discard errors provoked by the settings before.
        self._tell("*CLS")
        wanted = {
            "load": float(self._settings.load),
            "peak_to_peak": 2 * sweep.amplitude,
            "offset": 0.0,
            "start_hz": sweep.start_hz,
            "stop_hz": sweep.stop_hz,
            "duration": sweep.duration,
        }
        for command in self.dialect.setup:
            self._tell(command, **(wanted | {"load": str(self._settings.load).upper()}))
        self._complain("refused a setting")
        for name, value in wanted.items():
            found = self._number(name)
            if not math.isclose(found, value, rel_tol=_TOLERANCE, abs_tol=1e-6):
                raise InstrumentError(
                    f"{self.identity} was given {value:g} for {name} but reads {found:g}: "
                    "choose what it can do, or check for a second program."
                )
        self._sweep = sweep

    def arm(self) -> None:
        """See `Generator.arm`."""
        if self._sweep is None:
            raise ConfigurationError(f"{self.identity} has no sweep to arm: configure one first.")
        self.off()
        for command in self.dialect.arm:
            self._tell(command)
        self._complain("cannot be armed")
        question, pattern = self.dialect.armed
        answer = self._ask(self._named(question))
        if not re.fullmatch(pattern, answer.upper()):
            raise self._wrong(self._named(question), answer)
        self._armed = True

    def _trigger(self) -> None:
        if not self._armed:
            raise ConfigurationError(f"{self.identity} is not armed: arm it before the trigger.")
        self._armed = False
        try:
            # One message: the network may delay a second one by 40 ms.
            self._tell("OUTP{n} ON;" + self.dialect.fire)
            self._complain("did not start the sweep")
            if not self.is_on:
                raise InstrumentError(f"{self.identity} did not switch its output on: is it overloaded?")
        except InstrumentError:
            self.off()
            raise

    def off(self) -> None:
        """See `Generator.off`."""
        self._armed = False
        self._tell("OUTP{n} OFF")
        if self.is_on:
            raise InstrumentError(
                f"{self.identity} was told to switch its output off but reads on: switch it off by hand."
            )

    def errors(self) -> tuple[str, ...]:
        """See `Generator.errors`."""
        found: list[str] = []
        while len(found) < _QUEUE:
            number, text = self._value("SYST:ERR?", error_of)
            if number == 0:
                return tuple(found)
            found.append(f"{number} {text}")
        raise InstrumentError(f"{self.identity} reports errors without end, the last {found[-1]!r}.")

    def close(self) -> None:
        """See `Generator.close`."""
        self._line.close()

    def _complain(self, what: str) -> None:
        found = self.errors()
        if found:
            self._sweep = None
            raise InstrumentError(f"{self.identity} {what}: {'; '.join(found)}.")

    def _number(self, name: str) -> float:
        return self._value(self._named(self.dialect.read[name]), number_of)

    def _value(self, question: str, parse: Callable[[str], Value]) -> Value:
        answer = self._ask(question)
        try:
            return parse(answer)
        except ValueError:
            raise self._wrong(question, answer) from None

    def _named(self, command: str, **values: object) -> str:
        return command.format(n=self._settings.channel, **values)

    def _tell(self, command: str, **values: object) -> None:
        self._line.send(self._named(command, **values))

    def _ask(self, question: str) -> str:
        self._line.send(question)
        return self._line.receive(question).strip()

    def _wrong(self, question: str, answer: str) -> InstrumentError:
        return InstrumentError(
            f"{self.identity} answered {question!r} with {answer[:60]!r}, which cannot be right: "
            "check for a second program that uses it."
        )


class Keysight33500(ScpiGenerator):
    """Keysight or Agilent 33500 or 33600. See `Generator`."""

    dialect = KEYSIGHT


class Dg1000z(ScpiGenerator):
    """Rigol DG1000Z. See `Generator`."""

    dialect = RIGOL
