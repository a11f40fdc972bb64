"""Function generators by SCPI over VISA: Keysight's 33500 family and Rigol's DG1000Z.

The Rigol's commands are from its programming guide. Of the Keysight's, trigger and output were found in
sources, and the others are those usual in the family (docs/hardware.md, "Generators"). A sweep that waits for
its trigger is at its start frequency, not at zero: so the trigger also switches the output on.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal, Self, TypeVar

from pydantic import Field

from ...base.bounded import Positive, Strict, Timeout
from ...base.clock import Clock
from ...base.errors import ConfigurationError, InstrumentError, LimitError
from ..driver import one_name
from ..transport import Line, VisaLine
from ..waveforms import Arbitrary, Burst, Sweep, Waveform
from .role import Generator, error_of, number_of, switch_of, words_of

Value = TypeVar("Value")

_TOLERANCE = 1e-3
"""Relative tolerance of a read-back: instruments round to four digits or more."""
_QUEUE = 50
"""Most errors read from a queue (either family's holds 20; docs/hardware.md, "Generators")."""


@dataclass(frozen=True)
class Program:
    """How a family plays one kind of waveform; in the commands `{n}` is the channel."""

    values: Callable[[Any], dict[str, float]]
    """Values of a waveform by name, which are set and read back."""
    setup: tuple[str, ...]
    read: Mapping[str, str]
    """Queries that read the values back, by name."""
    arm: tuple[str, ...]
    armed: tuple[str, str]
    """A query, and the pattern of the answers that mean armed."""
    fire: str
    data: Callable[[Any], str] = lambda _waveform: ""
    """Samples of a waveform as text, for `{data}`."""


@dataclass(frozen=True)
class Dialect:
    """SCPI commands of one family."""

    models: str
    """Pattern of the model names."""
    programs: Mapping[type, Program]
    """The program of each kind of waveform that it plays."""


_STILL = (*(f"SOUR{{n}}:{mode}:STAT OFF" for mode in ("SWE", "BURS", "AM", "FM")), "SOUR{n}:FUNC SIN")
"""Commands that stop sweep, burst and modulation and select a sine, so that no later settings conflict."""
_LEVEL = (
    "OUTP{n}:LOAD {load}",
    "SOUR{n}:VOLT:UNIT VPP",
    "SOUR{n}:VOLT:OFFS 0",
    "SOUR{n}:VOLT {peak_to_peak:.6g}",
)
_READ_LEVEL = {"load": "OUTP{n}:LOAD?", "peak_to_peak": "SOUR{n}:VOLT?", "offset": "SOUR{n}:VOLT:OFFS?"}

_SWEEP = Program(
    values=lambda sweep: {
        "start_hz": sweep.start_hz, "stop_hz": sweep.stop_hz, "duration": sweep.duration
    },
    setup=(
        "SOUR{n}:FREQ:STAR {start_hz:.9g}",
        "SOUR{n}:FREQ:STOP {stop_hz:.9g}",
        "SOUR{n}:SWE:SPAC LIN",
        "SOUR{n}:SWE:TIME {duration:.9g}",
        "SOUR{n}:SWE:RTIM 0",
    ),
    read={
        "start_hz": "SOUR{n}:FREQ:STAR?",
        "stop_hz": "SOUR{n}:FREQ:STOP?",
        "duration": "SOUR{n}:SWE:TIME?",
    },
    arm=("SOUR{n}:SWE:STAT ON",),
    armed=("SOUR{n}:SWE:STAT?", "ON|1"),
    fire="*TRG",
)  # fmt: skip
_BURST = Program(
    values=lambda burst: {"frequency_hz": burst.frequency_hz, "cycles": burst.cycles},
    setup=(
        "SOUR{n}:FREQ {frequency_hz:.9g}",
        "SOUR{n}:BURS:MODE TRIG",
        "SOUR{n}:BURS:NCYC {cycles:.0f}",
        "SOUR{n}:BURS:PHAS 0",
    ),
    read={"frequency_hz": "SOUR{n}:FREQ?", "cycles": "SOUR{n}:BURS:NCYC?"},
    arm=("SOUR{n}:BURS:STAT ON",),
    armed=("SOUR{n}:BURS:STAT?", "ON|1"),
    fire="*TRG",
)

KEYSIGHT = Dialect(
    models=r"335\d\d[AB]|336\d\dA",
    programs={
        Sweep: replace(
            _SWEEP,
            setup=(*_SWEEP.setup, "SOUR{n}:SWE:HTIM 0", "TRIG{n}:SOUR BUS"),
            arm=("SOUR{n}:FREQ:MODE SWE",),
            armed=("SOUR{n}:FREQ:MODE?", "SWE.*"),
        ),
        Burst: replace(_BURST, setup=(*_BURST.setup, "TRIG{n}:SOUR BUS")),
        # A burst of one cycle. Without the filter the output is the staircase that the limiter has judged.
        Arbitrary: replace(
            _BURST,
            values=lambda waveform: {"rate_hz": waveform.rate_hz, "cycles": 1},
            data=lambda waveform: ", ".join(f"{v / waveform.amplitude:.6f}" for v in waveform.volts),
            setup=(
                "SOUR{n}:DATA:VOL:CLE",
                "SOUR{n}:DATA:ARB HAPLOOP, {data}",
                "SOUR{n}:FUNC:ARB HAPLOOP",
                "SOUR{n}:FUNC:ARB:SRAT {rate_hz:.9g}",
                "SOUR{n}:FUNC:ARB:FILT OFF",
                "SOUR{n}:FUNC ARB",
                *_BURST.setup[1:],
                "TRIG{n}:SOUR BUS",
            ),
            read={"rate_hz": "SOUR{n}:FUNC:ARB:SRAT?", "cycles": "SOUR{n}:BURS:NCYC?"},
        ),
    },
)
RIGOL = Dialect(
    models=r"DG10\d\dZ",
    programs={
        Sweep: replace(
            _SWEEP,
            setup=(
                *_SWEEP.setup,
                "SOUR{n}:SWE:HTIM:STAR 0",
                "SOUR{n}:SWE:HTIM:STOP 0",
                "SOUR{n}:SWE:TRIG:SOUR MAN",
            ),
            fire=":SOUR{n}:SWE:TRIG:IMM",
        ),
        Burst: replace(
            _BURST,
            setup=(*_BURST.setup, "SOUR{n}:BURS:IDLE CENTER", "SOUR{n}:BURS:TRIG:SOUR MAN"),
            fire=":SOUR{n}:BURS:TRIG",
        ),
    },
)


class ScpiGenerator(Generator):
    """See `Generator`. A subclass adds its family's dialect."""

    taped = True

    dialect: Dialect

    class Settings(Strict):
        """The `[generator]` table of a rig file."""

        resource: Annotated[str, Field(min_length=1)]
        """VISA name: USB0::..., or TCPIP::HOST::PORT::SOCKET (5025 for Keysight, 5555 for Rigol)."""
        output: str
        """Name of the amplifier input that its output is wired to."""
        channel: Annotated[int, Field(strict=True, ge=1, le=2)] = 1
        load: Literal["inf", 50] = "inf"
        """Load at the output (ohm); an amplifier's input counts as open."""
        highest: Positive = 1.0
        """Largest amplitude that may be set (V peak): 50 V at a patch behind a gain of 50."""
        visa: str = ""
        """VISA library: empty for the vendor's, or pyvisa-py without one; "@py" always takes pyvisa-py."""
        timeout: Timeout = 2.0
        """Time for a query to be answered completely (s)."""

    def __init__(self, settings: Settings, clock: Clock, line: Line) -> None:
        """Check the identity of the instrument on `line`. Raises InstrumentError."""
        self.output = settings.output
        self._settings = settings
        self._line = line
        self._program: Program | None = None
        """The program that is set."""
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
        return self._number(_READ_LEVEL["load"])

    @property
    def amplitude(self) -> float:
        """See `Generator.amplitude`."""
        return self._number(_READ_LEVEL["peak_to_peak"]) / 2

    @property
    def is_on(self) -> bool:
        """See `Generator.is_on`."""
        return self._value(self._named("OUTP{n}?"), switch_of)

    def _configure(self, waveform: Waveform) -> None:
        program = self.dialect.programs.get(type(waveform))
        if program is None:
            kinds = ", ".join(kind.__name__ for kind in self.dialect.programs)
            raise ConfigurationError(
                f"{self.identity} does not play {type(waveform).__name__}: its driver plays {kinds}."
            )
        if waveform.amplitude > self._settings.highest:
            raise LimitError(
                f"A waveform of {waveform.amplitude:g} V peak was refused: 'highest' in [generator] is "
                f"{self._settings.highest:g} V."
            )
        self._program = None
        self.off()
        for command in _STILL:
            self._tell(command)
        # Discard errors provoked by the settings before.
        self._tell("*CLS")
        level = {
            "load": float(self._settings.load), "peak_to_peak": 2 * waveform.amplitude, "offset": 0.0
        }  # fmt: skip
        wanted = level | program.values(waveform)
        texts = {"load": str(self._settings.load).upper(), "data": program.data(waveform)}
        for command in (*program.setup, *_LEVEL):
            self._tell(command, **(wanted | texts))
        self._complain("refused a setting")
        for name, question in (_READ_LEVEL | dict(program.read)).items():
            found, value = self._number(question), wanted[name]
            if not math.isclose(found, value, rel_tol=_TOLERANCE, abs_tol=1e-6):
                raise InstrumentError(
                    f"{self.identity} was given {value:g} for {name} but reads {found:g}: "
                    "choose what it can do, or check for a second program."
                )
        self._program = program

    def arm(self) -> None:
        """See `Generator.arm`."""
        if self._program is None:
            raise ConfigurationError(f"{self.identity} has no waveform to arm: configure one first.")
        self.off()
        for command in self._program.arm:
            self._tell(command)
        self._complain("cannot be armed")
        question, pattern = self._program.armed
        answer = self._ask(self._named(question))
        if not re.fullmatch(pattern, answer.upper()):
            raise self._wrong(self._named(question), answer)
        self._armed = True

    def _trigger(self) -> None:
        if not self._armed or self._program is None:
            raise ConfigurationError(f"{self.identity} is not armed: arm it before the trigger.")
        self._armed = False
        try:
            # One message: the network may delay a second one by 40 ms.
            self._tell("OUTP{n} ON;" + self._program.fire)
            self._complain("did not start its waveform")
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
            self._program = None
            raise InstrumentError(f"{self.identity} {what}: {'; '.join(found)}.")

    def _number(self, question: str) -> float:
        return self._value(self._named(question), number_of)

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
