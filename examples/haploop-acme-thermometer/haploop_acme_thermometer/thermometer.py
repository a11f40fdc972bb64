"""The role thermometer, and the ACME T1: it answers the lines `ID`, `T` and `H` (% per V of an output)."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field

from haploop.base.clock import Clock
from haploop.base.errors import InstrumentError
from haploop.instruments import Reading, Scale
from haploop.instruments.transport import Line, SerialLine


class Thermometer(ABC):
    """A thermometer, recorded along with presses (`haploop.instruments.RecordedAlong`)."""

    identity: str
    reads: tuple[str, ...] = ("temperature",)
    reads_hz: float = 1.0

    @abstractmethod
    def temperature(self) -> float:
        """Measure the temperature (degrees Celsius). Raises InstrumentError."""

    @abstractmethod
    def close(self) -> None:
        """Close the instrument. May be called again."""

    def start(self, stem: Path, clock: Clock) -> None:  # noqa: B027  an optional method
        """Do nothing: a temperature needs no preparation."""

    def read(self) -> Sequence[Reading]:
        return [Reading("temperature", self.temperature(), "°C")]

    def stop(self) -> Sequence[Reading]:
        """Do nothing: nothing was started."""
        return ()


class AcmeT1(Thermometer):
    taped = True  # every call to it goes through SerialLine

    class Settings(BaseModel):
        model_config = ConfigDict(frozen=True, extra="forbid")

        port: str
        humidity: str = ""  # DAQ channel that its analog output is wired to
        timeout: Annotated[float, Field(gt=0, le=60)] = 1.0

    def __init__(self, settings: Settings, line: Line) -> None:
        self._line = line
        self.identity = self._ask("ID")
        if not self.identity.startswith("ACME T1"):
            line.close()
            raise InstrumentError(f"{self.identity!r} is not an ACME T1: check 'port' in [thermometer].")
        self.scales = {settings.humidity: Scale(self._number("H"), "%")} if settings.humidity else {}

    @staticmethod
    def hardware(settings: Settings) -> tuple[str, ...]:
        return (settings.port,)

    @classmethod
    def open(cls, settings: Settings, clock: Clock) -> Self:
        return cls(settings, SerialLine("ACME T1", settings.port, 9600, settings.timeout))

    def temperature(self) -> float:
        return self._number("T")

    def close(self) -> None:
        self._line.close()

    def _number(self, command: str) -> float:
        answer = self._ask(command)
        try:
            return float(answer)
        except ValueError:
            raise InstrumentError(
                f"The ACME T1 answered {command!r} with {answer!r}: check its cable."
            ) from None

    def _ask(self, command: str) -> str:
        self._line.send(command)
        return self._line.receive(command)
