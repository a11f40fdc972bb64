"""NI-DAQmx cards, on the public API of NI's `nidaqmx` package.

The cards are in this computer, or behind an NI device server (`server = "host:port"`): the same
calls then travel by gRPC, with no NI driver on this side.

Several cards are one Daq: the card of the outputs is master, and the others run on its sample
clock (docs/hardware.md, "Two cards on one clock"), armed before it. That needs an RTSI cable that is
declared in NI MAX.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from typing import Annotated, Any, Literal, Self

import numpy as np
from nidaqmx.constants import AcquisitionType, TerminalConfiguration
from nidaqmx.stream_readers import AnalogMultiChannelReader
from nidaqmx.stream_writers import AnalogMultiChannelWriter
from pydantic import BaseModel, ConfigDict, Field

from haploop.instruments.arrays import FloatArray
from haploop.instruments.clock import Clock
from haploop.instruments.daq.ni_cards import Plan, believed, device_of, find_cards
from haploop.instruments.daq.ni_errors import cut_off, translated, understood
from haploop.instruments.daq.ni_sessions import Sessions
from haploop.instruments.daq.role import Block, Daq, Stream
from haploop.instruments.driver import one_name
from haploop.instruments.errors import ConfigurationError, InstrumentError, LimitError

__all__ = ["NiDaq"]

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Terminal = Annotated[str, Field(pattern=r"^[^/\s]+/\w+$")]

_CONFIGS = {
    "diff": TerminalConfiguration.DIFF,
    "rse": TerminalConfiguration.RSE,
    "nrse": TerminalConfiguration.NRSE,
}
_LATE = 5.0
"""Delay beyond which a block counts as lost (s)."""
_BEYOND = 2.0
"""Multiple of its range beyond which a reading is invalid; some cards read a twentieth beyond the range."""
_SAME = 1e-6
"""Largest relative difference between the rates that cards on one clock report."""
_AFTER = 1.0
"""Time for an output to report its last sample, when the inputs have delivered theirs (s)."""
_COUNTED = 1.0
"""Interval at which the cards' sample counts are compared (s)."""
_APART = 0.5
"""Largest apparent lag between two cards on one clock (s): they transfer samples in chunks."""


class _Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Channel(_Section):
    """An analog input."""

    terminal: Terminal
    range: Positive
    """Full scale, +- V; the card takes its next wider range."""
    config: Literal["diff", "rse", "nrse"] = "diff"


class Output(_Section):
    """An analog output."""

    terminal: Terminal
    range: Positive = 10.0
    """Largest voltage to put out, +- V."""


class NiDaq(Daq):
    """See `Daq`."""

    class Settings(_Section):
        """The `[daq]` table of a rig file."""

        channels: dict[str, Channel]
        outputs: dict[str, Output] = {}
        devices: dict[str, str] = {}
        """Product of each device, to be checked against the one that the card reports."""
        server: str | None = None
        """NI device server as host:port; None takes the driver of this computer."""
        buffer_s: Positive = 10.0
        """Length of the host's buffer for a late reader (s)."""

    def __init__(self, settings: Settings, sessions: Sessions) -> None:
        self._settings = settings
        self._sessions = sessions
        self._streams: list[_NiStream] = []
        self._cards = find_cards(_products(settings), sessions, settings.server)
        self.simulated = any(card.simulated for card in self._cards.values())
        self.identity = " + ".join(
            f"{card.product} ({card.name}, serial {card.serial:X})" for card in self._cards.values()
        )

    @staticmethod
    def hardware(settings: Settings) -> tuple[str, ...]:
        """See `Driver.hardware`: each card."""
        return tuple(
            f"{one_name(settings.server or 'this computer')} {name.lower()}" for name in _products(settings)
        )

    @classmethod
    def open(cls, settings: Settings, clock: Clock) -> Self:
        """Find the cards. Changes no output. `clock` is not needed: the cards have their own.

        Raises InstrumentError when the driver, the server, or a card is not there, and
        ConfigurationError when a card is not the product that the rig file says.
        """
        sessions = Sessions.at(settings.server)
        try:
            return cls(settings, sessions)
        except BaseException:
            sessions.close()
            raise

    def _stream(
        self,
        channels: Sequence[str],
        rate_hz: float,
        block: int,
        samples: int | None,
        play: Mapping[str, FloatArray] | None,
    ) -> Stream:
        play = play or {}
        self._refuse(channels, block, samples, play)
        known, outputs = self._settings.channels, self._settings.outputs
        plan = Plan.of(
            {name: known[name].terminal for name in channels},
            {name: outputs[name].terminal for name in play},
            self._cards,
        )
        stream = _NiStream(self, plan, tuple(channels), rate_hz, block, samples, dict(play))
        self._streams.append(stream)
        return stream

    def clear_left(self) -> None:
        """See `Daq.clear_left`."""
        names = {name for card in self._cards.values() for name in (card.name, card.home)}
        purposes = ("input", "output", "zero", "outputs")
        self._sessions.clear_left(f"{n} {purpose}" for n in names for purpose in purposes)

    def zero(self) -> None:
        """See `Daq.zero`. Stops every play first, because a playing task reserves its outputs."""
        outputs: dict[str, list[Output]] = {}
        for output in self._settings.outputs.values():
            outputs.setdefault(device_of(output.terminal), []).append(output)
        steps: list[Callable[[], None]] = [stream.stop_playing for stream in self._streams]
        steps += [partial(self._write_zero, device, own) for device, own in outputs.items()]
        failures = []
        # One card that fails must not keep another one from zero.
        for step in steps:
            try:
                step()
            except InstrumentError as error:
                failures.append(error)
        if failures:
            raise InstrumentError(" ".join(str(error) for error in failures)) from failures[0]

    def _write_zero(self, device: str, outputs: Sequence[Output]) -> None:
        with self.talking_to(device), self.task(f"{device} zero") as task:
            for output in outputs:
                # A card whose range is narrower than the library's default of +-10 V refuses that.
                task.ao_channels.add_ao_voltage_chan(
                    output.terminal, min_val=-output.range, max_val=output.range
                )
            taken = task.write([0.0] * len(outputs) if len(outputs) > 1 else 0.0, auto_start=True)
        if taken != 1:
            raise InstrumentError(f"{device} did not say that its outputs took zero: try again.")

    def outputs_read(self) -> Mapping[str, float]:
        """See `Daq.outputs_read`, through the cards' internal channels for it."""
        named: dict[str, list[str]] = {}
        for name, output in self._settings.outputs.items():
            card = self._cards[device_of(output.terminal)]
            streaming = any(card.home in stream.homes for stream in self._streams)
            if card.reads_outputs and not streaming:
                named.setdefault(card.name, []).append(name)
        read: dict[str, float] = {}
        for device, names in named.items():
            with self.talking_to(device), self.task(f"{device} outputs") as task:
                for name in names:
                    terminal = self._settings.outputs[name].terminal
                    # Full scale, whatever the rig file allows: another program may put out more.
                    task.ai_channels.add_ai_voltage_chan(
                        f"{device}/_{terminal.partition('/')[2]}_vs_aognd", min_val=-10.0, max_val=10.0
                    )
                volts = task.read()
            read |= zip(names, volts if isinstance(volts, list) else [volts], strict=True)
        return read

    def close(self) -> None:
        """See `Daq.close`."""
        for stream in list(self._streams):
            stream.release()
        self._sessions.close()

    # For streams

    def task(self, purpose: str) -> Any:
        """See `Sessions.task`."""
        return self._sessions.task(purpose)

    def forget(self, stream: _NiStream) -> None:
        """Remove a stream that has released its tasks."""
        if stream in self._streams:
            self._streams.remove(stream)

    @property
    def settings(self) -> Settings:
        """Settings of the rig file."""
        return self._settings

    @contextmanager
    def talking_to(self, device: str) -> Iterator[None]:
        """Turn any error of NI's library into one sentence about `device`."""
        with understood(device), translated(device, self._settings.server):
            yield

    # Checks

    def _refuse(
        self, channels: Sequence[str], block: int, samples: int | None, play: Mapping[str, FloatArray]
    ) -> None:
        known, outputs = self._settings.channels, self._settings.outputs
        for name in [c for c in channels if c not in known] + [o for o in play if o not in outputs]:
            raise ConfigurationError(
                f"The DAQ has no channel {name!r}; the rig file names {', '.join([*known, *outputs])}."
            )
        if not channels or len(set(channels)) != len(channels):
            raise ConfigurationError("A stream needs at least one channel, and each channel once.")
        if block < 1 or (samples is not None and samples < 2):
            raise ConfigurationError("A block has 1 sample or more, a finite stream 2 or more.")
        lengths = {len(volts) for volts in play.values()}
        if len(lengths) > 1 or 0 in lengths:
            raise LimitError("All waveforms that are played together must have the same length, not zero.")
        for name, volts in play.items():
            largest = np.abs(volts).max()
            # NaN compares as false with everything.
            if not largest <= outputs[name].range:
                raise LimitError(
                    f"The waveform for {name!r} reaches {largest:g} V, and the output's range is "
                    f"+-{outputs[name].range:g} V."
                )


class _NiStream(Stream):
    """See `Stream`."""

    def __init__(
        self,
        daq: NiDaq,
        plan: Plan,
        channels: tuple[str, ...],
        rate_hz: float,
        block: int,
        samples: int | None,
        play: dict[str, FloatArray],
    ) -> None:
        self.channels = channels
        self._daq, self._plan = daq, plan
        self._block, self._samples = block, samples
        order = [name for _, names in plan.inputs for name in names]
        self._rows = [order.index(name) for name in channels]
        self._inputs: list[Any] = []
        self._player: Any = None
        self._length = 0
        self._open = True
        with ExitStack() as undo:
            undo.callback(self.release)
            delays, ranges, widths = [], [], []
            for home, names in plan.inputs:
                with daq.talking_to(home):
                    master = home == plan.master
                    task = self._input(home, names, rate_hz if master else self.rate_hz)
                    own = float(task.timing.samp_clk_rate)
                    if master:
                        self.rate_hz = own
                    elif not abs(own - self.rate_hz) <= _SAME * self.rate_hz:
                        raise ConfigurationError(
                            f"{home} would sample at {own:g} Hz on the clock of {plan.master}, which runs at "
                            f"{self.rate_hz:g} Hz: choose a rate that both cards have."
                        )
                    # Some cards have few rates, and choose the next one.
                    if not rate_hz / 2 < self.rate_hz < 2 * rate_hz:
                        raise ConfigurationError(
                            f"{home} would sample at {self.rate_hz:g} Hz, and {rate_hz:g} Hz were asked for: "
                            "choose a rate that it has."
                        )
                    delays += plan.delays(task)
                    listed = list(task.ai_channels)
                    if len(listed) != len(names):
                        raise InstrumentError(
                            f"{home} lists {len(listed)} channels and was given {len(names)}: try again."
                        )
                    for channel in listed:
                        high = believed(home, "range (V)", float(channel.ai_rng_high), 1e-3, 1e3)
                        bits = believed(home, "resolution (bits)", float(channel.ai_resolution), 8, 32)
                        ranges.append(high)
                        widths.append(2 * high / 2.0**bits)
            self.delays = np.array(delays)[self._rows]
            self.full_scale = np.array(ranges)[self._rows]
            # One code below full scale, midway between two codes.
            self._end = (np.array(ranges) - 1.5 * np.array(widths))[:, np.newaxis]
            self._beyond = _BEYOND * np.array(ranges)[:, np.newaxis]
            self._readers = []
            for task in self._inputs:
                reader = AnalogMultiChannelReader(task.in_stream)
                reader.verify_array_shape = False  # The shape is known; a check costs a call per read.
                self._readers.append(reader)
            if play:
                self._arm_player(play)
            for (home, _), task in reversed(list(zip(plan.inputs, self._inputs, strict=True))):
                with daq.talking_to(home):
                    task.start()
            undo.pop_all()

    @property
    def homes(self) -> tuple[str, ...]:
        """Devices whose inputs it has reserved."""
        return tuple(home for home, _ in self._plan.inputs) if self._open else ()

    def __iter__(self) -> Iterator[Block]:
        """See `Stream.__iter__`."""
        first = 0
        while self._open and (self._samples is None or first < self._samples):
            count = self._block if self._samples is None else min(self._block, self._samples - first)
            volts = self._read(first, count)
            size = np.abs(volts)
            # NaN fails this comparison too.
            if not np.all(size <= self._beyond):
                raise InstrumentError(
                    f"{' and '.join(home for home, _ in self._plan.inputs)} delivered values beyond range "
                    f"from sample {first} on: the block was discarded. Restart the driver or device server."
                )
            self._refuse_cut_off(first + count)
            overload = np.any(size >= self._end, axis=1)
            yield Block(first, volts[self._rows], overload[self._rows])
            first += count

    def close(self) -> None:
        """See `Stream.close`."""
        if self._open:
            self.release()
            self._daq.zero()

    def release(self) -> None:
        """Release the tasks; outputs keep their value."""
        self._open = False
        self._daq.forget(self)
        with ExitStack() as every:
            # Release each, even when another one cannot be reached.
            for task in self._inputs:
                every.enter_context(self._daq.talking_to(self._plan.master))
                every.callback(task.close)
            self._inputs = []
            every.callback(self.stop_playing)

    def stop_playing(self) -> None:
        """Stop the waveform and free its outputs."""
        player, self._player = self._player, None
        if player is not None and self._plan.output is not None:
            with self._daq.talking_to(self._plan.output):
                player.close()

    def _input(self, home: str, names: tuple[str, ...], rate_hz: float) -> Any:
        settings = self._daq.settings
        task = self._daq.task(f"{home} input")
        self._inputs.append(task)
        for name in names:
            channel = settings.channels[name]
            task.ai_channels.add_ai_voltage_chan(
                channel.terminal,
                terminal_config=_CONFIGS[channel.config],
                min_val=-channel.range,
                max_val=channel.range,
            )
        source = "" if home == self._plan.master else f"/{self._plan.master}/ai/SampleClock"
        kept = max(int(settings.buffer_s * rate_hz), 2 * self._block)
        if self._samples is None:
            task.timing.cfg_samp_clk_timing(
                rate_hz, source, sample_mode=AcquisitionType.CONTINUOUS, samps_per_chan=kept
            )
            # NI's default at 5 kS/s is two seconds.
            task.in_stream.input_buf_size = kept
        else:
            task.timing.cfg_samp_clk_timing(
                rate_hz, source, sample_mode=AcquisitionType.FINITE, samps_per_chan=self._samples
            )
        return task

    def _arm_player(self, play: dict[str, FloatArray]) -> None:
        """Load the waveforms; they begin with the master's first sample."""
        output = self._plan.output
        assert output is not None, "a waveform has an output"
        settings = self._daq.settings
        length = self._length = max(2, *(len(volts) for volts in play.values()))
        rows = np.array([np.pad(v, (0, length - len(v)), mode="edge") for v in play.values()], np.float64)
        with self._daq.talking_to(output):
            task = self._player = self._daq.task(f"{self._plan.output} output")
            for name in play:
                reach = settings.outputs[name].range
                task.ao_channels.add_ao_voltage_chan(
                    settings.outputs[name].terminal, min_val=-reach, max_val=reach
                )
            master = self._plan.master
            # Also on the master's own card: two dividers of one timebase need not give the same rate.
            task.timing.cfg_samp_clk_timing(self.rate_hz, f"/{master}/ai/SampleClock", samps_per_chan=length)
            taken = AnalogMultiChannelWriter(task.out_stream, auto_start=False).write_many_sample(rows)
            if taken != length:
                raise InstrumentError(
                    f"{output} took {taken} of a waveform's {length} samples; nothing was played."
                )
            task.start()

    def _read(self, first: int, count: int) -> FloatArray:
        """Read the next `count` samples of every task, (channels in the tasks' order, samples)."""
        volts = []
        timeout = count / self.rate_hz + _LATE
        for (home, names), reader in zip(self._plan.inputs, self._readers, strict=True):
            # NaN marks samples that were counted but not written.
            part = np.full((len(names), count), np.nan)
            with self._daq.talking_to(home):
                got = reader.read_many_sample(part, count, timeout)
            if got != count:
                raise InstrumentError(
                    f"{home} delivered {got} of {count} samples from sample {first} on: the acquisition "
                    "has ended before its time."
                )
            volts.append(part)
        # Once a second: each card is asked for its count by a call of its own, which costs as much as a read.
        second = round(_COUNTED * self.rate_hz)
        if len(volts) > 1 and self._samples is None and (first + count) // second > first // second:
            self._refuse_drift()
        return np.concatenate(volts)

    def _refuse_cut_off(self, end: int) -> None:
        """Check, when the inputs are at sample `end`, that the waveform has been played whole so far."""
        task, output = self._player, self._plan.output
        if task is None or output is None:
            return
        with self._daq.talking_to(output):
            # The task's own error, such as an underflow, is raised here.
            done = task.is_task_done()
            if not done and end >= self._length:
                task.wait_until_done(_AFTER)
                done = True
            played = int(task.out_stream.total_samp_per_chan_generated) if done else end
        # An acquisition that is shorter than the waveform ends it: the outputs run on its clock.
        whole = self._length if self._samples is None else min(self._length, self._samples)
        if played < whole and done:
            raise cut_off(output, played)

    def _refuse_drift(self) -> None:
        """Check that cards on one clock have taken equally many samples."""
        # The master is queried before and after the others: the calls may be a second apart.
        asked = [*self._inputs, self._inputs[0]]
        with self._daq.talking_to(self._plan.master):
            before, *counts, after = [int(task.in_stream.total_samp_per_chan_acquired) for task in asked]
        apart = max(_APART * self.rate_hz, 2 * self._block)
        for (home, _), count in zip(self._plan.inputs[1:], counts, strict=True):
            if not before - apart <= count <= after + apart:
                raise InstrumentError(
                    f"{home} has taken {count} samples and {self._plan.master} {before} to {after}: they do "
                    "not run on one clock. Check the RTSI cable."
                )


def _products(settings: NiDaq.Settings) -> dict[str, str | None]:
    """Product of every card that a rig file names; None where the file gives none."""
    used = [channel.terminal for channel in settings.channels.values()]
    used += [output.terminal for output in settings.outputs.values()]
    names = dict.fromkeys([*(device_of(terminal) for terminal in used), *settings.devices])
    return {name: settings.devices.get(name) for name in names}
