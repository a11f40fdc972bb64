"""Driver of the T7, on LabJack's `labjack-ljm` and its LJM library. Not tried on hardware.

Inputs and DACs run in one stream: in each scan the DACs are set first, then the inputs are converted one
after the other (T-series data sheet, "Stream Mode" and "Stream-Out"). The DACs' values are written ahead of
what is read, as the package's example stream_in_with_aperiodic_stream_out does.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from haploop.base.clock import Clock
from haploop.base.errors import ConfigurationError, InstrumentError, LimitError
from haploop.instruments import Block, Daq, Stream
from haploop.instruments.daq import StreamRequest

FASTEST = 100_000.0
"""Samples of inputs and DACs per second, all together (data sheet, "Stream Mode")."""
INTERVAL = 10e-6
"""Time between the conversions of two inputs of a scan (s; estimate: the fastest rate's)."""
DAC = 5.0
"""Largest voltage of a DAC (data sheet; the least is some millivolts)."""
GROUND = 199
"""Value of AIN#_NEGATIVE_CH for ground."""
STREAM_OUT = 4800
"""Address of STREAM_OUT0; that of DAC0 is 1000, and each DAC has two."""
LOST = -9999.0
"""What stands in the data for scans that were lost."""
AHEAD = 3
"""Blocks of the DACs' values that are written ahead."""


class _Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Input(_Section):
    ain: Annotated[int, Field(ge=0, le=13)]
    negative: Annotated[int, Field(ge=1, le=13)] | None = None
    """The input of a differential pair that follows `ain`; None for ground."""
    range: Literal[10, 1, 0.1, 0.01] = 10

    @model_validator(mode="after")
    def _pair(self) -> Self:
        if self.negative is not None and (self.ain % 2 or self.negative != self.ain + 1):
            raise ValueError(
                "a differential pair is an even input and the next one, such as ain = 0, negative = 1"
            )
        return self


class Output(_Section):
    """One DAC, of one sign, or the voltage between two."""

    plus: Literal[0, 1]
    minus: Literal[0, 1] | None = None
    highest: Annotated[float, Field(gt=0, le=DAC)] = DAC
    """Largest voltage to put out (V)."""

    @property
    def dacs(self) -> tuple[int, ...]:
        return (self.plus,) if self.minus is None else (self.plus, self.minus)


class LabJackT7(Daq):
    class Settings(_Section):
        channels: Annotated[dict[str, Input], Field(min_length=1)]
        outputs: dict[str, Output] = {}
        connection: Literal["ANY", "USB", "ETHERNET"] = "USB"
        identifier: str = "ANY"
        """Serial number, or IP address; ANY for the only one."""

        @model_validator(mode="after")
        def _once(self) -> Self:
            taken: dict[int, str] = {}
            for name, output in self.outputs.items():
                for dac in output.dacs:
                    if dac in taken:
                        raise ValueError(f"DAC{dac} is used twice, by {taken[dac]!r} and {name!r}: keep one")
                    taken[dac] = name
            return self

        def refuse(self, request: StreamRequest) -> None:
            """Raise for a stream that the T7 cannot run."""
            channels, rate_hz, play = request.channels, request.rate_hz, request.play
            request.refuse_unknown(self.channels, self.outputs)
            dacs = sum(len(self.outputs[name].dacs) for name in play)
            if (total := rate_hz * (len(channels) + dacs)) > FASTEST:
                raise ConfigurationError(
                    f"The T7 streams {FASTEST:g} samples per second, and {len(channels)} inputs and {dacs} "
                    f"DACs at {rate_hz:g} Hz need {total:g}: lower the rate."
                )
            for name, volts in play.items():
                most = self.outputs[name].highest
                least = 0.0 if self.outputs[name].minus is None else -most
                inside = volts.min(initial=0.0) >= least and volts.max(initial=0.0) <= most
                if not (inside and np.isfinite(volts).all()):
                    raise LimitError(
                        f"The waveform for {name!r} leaves the output's range of {least:g} to {most:g} V or "
                        "is not finite."
                    )

    def __init__(self, settings: Settings, ljm: Any) -> None:
        self._settings, self._ljm = settings, ljm
        self._running: _T7Stream | None = None
        self._handle = self.call(ljm.openS, "T7", settings.connection, settings.identifier)
        self._closed = False
        serial = self.call(ljm.getHandleInfo, self._handle)[2]
        self.identity = f"LabJack T7, serial {serial}"

    @staticmethod
    def hardware(settings: Settings) -> tuple[str, ...]:
        return (f"LabJack T7 {settings.identifier}",)

    @classmethod
    def open(cls, settings: Settings, clock: Clock) -> Self:
        try:
            ljm = importlib.import_module("labjack.ljm")
        except ImportError as error:
            raise ConfigurationError(
                f"A T7 needs labjack-ljm, which does not load ({error}): pip install labjack-ljm."
            ) from None
        return cls(settings, ljm)

    def _stream(self, request: StreamRequest) -> Stream:
        self._settings.refuse(request)
        self._running = _T7Stream(self, request)
        return self._running

    def clear_left(self) -> None:
        """A stream of a killed program goes on in the T7."""
        with suppress(self._ljm.LJMError):  # none was running
            self._ljm.eStreamStop(self._handle)

    def zero(self) -> None:
        if self._running is not None:
            self._running.cut_short()
        names = [f"DAC{dac}" for output in self._settings.outputs.values() for dac in output.dacs]
        if names and not self._closed:
            self.call(self._ljm.eWriteNames, self._handle, len(names), names, [0.0] * len(names))

    def outputs_read(self) -> Mapping[str, float]:
        """What the DACs were set to: the T7 does not measure them."""
        if self._running is not None and self._running.plays:
            return {}
        volts = {}
        for name, output in self._settings.outputs.items():
            plus, *minus = (self.call(self._ljm.eReadName, self._handle, f"DAC{dac}") for dac in output.dacs)
            volts[name] = plus - sum(minus)
        return volts

    def close(self) -> None:
        if not self._closed:
            if self._running is not None:
                self._running.release()
            self._closed = True
            self.call(self._ljm.close, self._handle)

    # For streams

    @property
    def ljm(self) -> Any:
        return self._ljm

    @property
    def handle(self) -> int:
        return self._handle  # type: ignore[no-any-return]

    def call(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Call LJM; its errors become one sentence."""
        try:
            return function(*arguments)
        except self._ljm.LJMError as error:
            told = " ".join(str(error).split())
            raise InstrumentError(
                f"The T7 refused ({told}): check its cable, and close other programs that use it."
            ) from None
        except AttributeError as error:
            # Without LJM itself the package loads, and has no library to call.
            raise ConfigurationError(
                f"LabJack's LJM library does not load ({error}): install it from labjack.com."
            ) from None


class _T7Stream(Stream):
    def __init__(self, daq: LabJackT7, request: StreamRequest) -> None:
        settings, ljm = daq._settings, daq.ljm
        self.channels = channels = request.channels
        self.delays = INTERVAL * np.arange(len(channels))
        self.full_scale = np.array([float(settings.channels[name].range) for name in channels])
        self._daq, self._request = daq, request
        self._block, rate_hz = request.block, request.rate_hz
        self._dacs = _dac_values(settings, request.play)
        self._written, self._read = 0, 0
        self._cut, self._open = False, True
        for name in channels:
            own = settings.channels[name]
            names = [f"AIN{own.ain}_RANGE", f"AIN{own.ain}_NEGATIVE_CH"]
            values = [float(own.range), float(GROUND if own.negative is None else own.negative)]
            daq.call(ljm.eWriteNames, daq.handle, 2, names, values)
        daq.call(
            ljm.eWriteNames, daq.handle, 2, ["STREAM_RESOLUTION_INDEX", "STREAM_SETTLING_US"], [0.0, 0.0]
        )
        for index, dac in enumerate(self._dacs):
            daq.call(ljm.initializeAperiodicStreamOut, daq.handle, index, 1000 + 2 * dac, rate_hz)
        for _ in range(AHEAD if self._dacs else 0):
            self._feed()
        # First in the scan, so that an input of the same scan sees the DAC's new value.
        scan = [STREAM_OUT + index for index in range(len(self._dacs))]
        scan += [2 * settings.channels[name].ain for name in channels]
        self.rate_hz = float(daq.call(ljm.eStreamStart, daq.handle, self._block, len(scan), scan, rate_hz))

    @property
    def plays(self) -> bool:
        return self._open and bool(self._dacs)

    def __iter__(self) -> Iterator[Block]:
        for first, count in self._request.blocks():
            if self._cut:
                raise InstrumentError(
                    "The T7 was set to zero by this program while it played: the waveform was not played "
                    "whole, and what was measured is not used."
                )
            if not self._open:
                return
            data, _, _ = self._daq.call(self._daq.ljm.eStreamRead, self._daq.handle)
            # The package's array has room for the DACs, which give no data.
            rows = np.array(data[: self._block * len(self.channels)], dtype=np.float64)
            volts = rows.reshape(self._block, len(self.channels)).T[:, :count]
            if (volts == LOST).any():
                raise InstrumentError(
                    f"The T7 lost samples near sample {first}: lower the rate, or close what loads this "
                    "computer."
                )
            self._read += self._block
            if self._dacs:
                self._feed()
            yield Block(first, volts, np.any(np.abs(volts) >= self.full_scale[:, np.newaxis], axis=1))

    def close(self) -> None:
        if self._open:
            self.release()
            self._daq.zero()

    def release(self) -> None:
        """Stop, and leave the DACs as they are."""
        if self._open:
            self._open = False
            self._daq.call(self._daq.ljm.eStreamStop, self._daq.handle)

    def cut_short(self) -> None:
        """Stop a play, whose DACs the stream would go on setting."""
        if self.plays:
            self._cut = self._read < self._request.length
            self.release()

    def _feed(self) -> None:
        """Write a block of each DAC's values, and the last one after the end."""
        for index, values in enumerate(self._dacs.values()):
            part = values[self._written : self._written + self._block]
            part = np.pad(part, (0, self._block - len(part)), constant_values=values[-1])
            ljm = self._daq.ljm
            self._daq.call(ljm.writeAperiodicStreamOut, self._daq.handle, index, self._block, part.tolist())
        self._written += self._block


def _dac_values(settings: LabJackT7.Settings, play: Mapping[str, np.ndarray]) -> dict[int, np.ndarray]:
    """Volts of each DAC: of an output between two, one carries what is positive, and the other what is
    not."""
    values: dict[int, np.ndarray] = {}
    for name, volts in play.items():
        output = settings.outputs[name]
        values[output.plus] = np.maximum(volts, 0.0)
        if output.minus is not None:
            values[output.minus] = np.maximum(-volts, 0.0)
    return values
