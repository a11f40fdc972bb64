"""One acquisition of NI-DAQmx cards, with the waveforms that are played along: a task for each card.

The card of the outputs is master, and the others run on its sample clock (docs/hardware.md, "Two cards on one
clock"), armed before it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from typing import Any, Protocol

import numpy as np
from nidaqmx.constants import AcquisitionType, TaskMode
from nidaqmx.stream_readers import AnalogMultiChannelReader, CounterReader

from ...base.arrays import FloatArray
from ...base.clock import RealClock
from ...base.errors import InstrumentError
from .ni_cards import Plan, add_counter, add_input, believed, factor
from .ni_outputs import NiOutputs, Tasks, reservable
from .ni_sentences import cut_off, other_rate, shared_rates, unshared, zeroed
from .ni_settings import NiSettings, filter_delay
from .role import Block, Stream, StreamRequest

_LATE = 5.0
"""Delay beyond which a block counts as lost (s)."""
_BEYOND = 2.0
"""Multiple of its range beyond which a reading is invalid; some cards read a twentieth beyond the range."""
_SAME = 1e-6
"""Largest relative difference between the rates that cards on one clock report."""
_AFTER = 1.0
"""Time for an output to report its last sample, when the inputs have delivered theirs (s)."""
_PAUSE = 0.02
"""Time between two looks at it (s)."""
_PLAYED = 1e-3
"""Largest relative difference from the rate that a waveform was made for."""
_COUNTED = 1.0
"""Interval at which the cards' sample counts are compared (s)."""
_APART = 0.5
"""Largest apparent lag between two cards on one clock (s): they transfer samples in chunks."""


class Cards(Tasks, Protocol):
    """What a stream asks of the cards that it runs on."""

    @property
    def _settings(self) -> NiSettings:
        """Settings of the rig file."""

    def outputs_at(self, home: str) -> NiOutputs:
        """The outputs of a card or chassis."""

    def done(self, outputs: NiOutputs) -> None:
        """Free outputs whose play is over, unless they are held."""

    def zero(self) -> None:
        """Write zero volts to every output."""

    def forget(self, stream: NiStream) -> None:
        """Take note that a stream has released its tasks."""


class NiStream(Stream):
    """See `Stream`."""

    def __init__(self, daq: Cards, plan: Plan, request: StreamRequest) -> None:
        self.channels, rate_hz = request.channels, request.rate_hz
        self._daq, self._plan, self._request = daq, plan, request
        order = [name for _, names in plan.inputs for name in names]
        order += [name for _, name in plan.counters]
        self._rows = [order.index(name) for name in self.channels]
        self._inputs: list[Any] = []
        self._counters: list[Any] = []
        self._player: Any = None
        self._outputs: NiOutputs | None = None
        self._length = self._played = 0
        """Samples of the waveform, and how many of them are known to have been played."""
        self._zeroed = False
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
                        timebase = float(self._inputs[0].timing.samp_clk_timebase_rate)
                        fastest = max(float(device.ai_max_multi_chan_rate) for device in task.devices)
                        rates = shared_rates(timebase, fastest, rate_hz)
                        raise unshared(home, own, plan.master, self.rate_hz, rates)
                    self._refuse_other_rate(home)
                    listed = list(task.ai_channels)
                    if len(listed) != len(names):
                        raise InstrumentError(
                            f"{home} lists {len(listed)} channels and was given {len(names)}: try again."
                        )
                    delays += self._delays(task, names)
                    for name, channel in zip(names, listed, strict=True):
                        unit = factor(daq._settings.channels[name])
                        high = believed(home, "range (V)", unit * float(channel.ai_rng_high), 1e-3, 1e3)
                        bits = believed(home, "resolution (bits)", float(channel.ai_resolution), 8, 32)
                        ranges.append(high)
                        widths.append(2 * high / 2.0**bits)
            for home, name in plan.counters:
                with daq.talking_to(home):
                    self._counters.append(self._counter(home, name))
                delays.append(0.0)
                ranges.append(daq._settings.channels[name].range)
                widths.append(0.0)
            self._measure(np.array(delays), np.array(ranges), np.array(widths))
            if request.play:
                self._arm_player(request.play)
            for (home, _), task in zip(plan.counters, self._counters, strict=True):
                with daq.talking_to(home):
                    task.start()
            for (home, _), task in reversed(list(zip(plan.inputs, self._inputs, strict=True))):
                with daq.talking_to(home):
                    task.start()
            undo.pop_all()

    def _measure(self, delays: FloatArray, ranges: FloatArray, widths: FloatArray) -> None:
        """Note how the channels convert, (channels,) in the tasks' order, and make the readers."""
        self.delays = delays[self._rows]
        self.full_scale = ranges[self._rows]
        # One code below full scale, midway between two codes.
        self._end = (ranges - 1.5 * widths)[:, np.newaxis]
        self._beyond = _BEYOND * ranges[:, np.newaxis]
        self._readers = []
        for task in self._inputs:
            reader = AnalogMultiChannelReader(task.in_stream)
            reader.verify_array_shape = False  # The shape is known; a check costs a call per read.
            self._readers.append(reader)
        self._units = np.array(
            [factor(self._daq._settings.channels[name]) for _, names in self._plan.inputs for name in names]
        )[:, np.newaxis]

    @property
    def homes(self) -> tuple[str, ...]:
        """Devices whose inputs it has reserved, until it is forgotten."""
        return tuple(home for home, _ in self._plan.inputs)

    def __iter__(self) -> Iterator[Block]:
        """See `Stream.__iter__`."""
        for first, count in self._request.blocks():
            if not self._open:
                return
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

    def close(self) -> None:
        """See `Stream.close`."""
        if self._open:
            self._open = False
            try:
                self._daq.zero()
            finally:
                self.release()

    def release(self) -> None:
        """Release the tasks; outputs keep their value."""
        self._open = False
        with ExitStack() as every:
            every.callback(self._daq.forget, self)  # last: until then its inputs are reserved
            # Release each, even when another one cannot be reached.
            for task in (*self._inputs, *self._counters):
                every.enter_context(self._daq.talking_to(self._plan.master))
                every.callback(task.close)
            self._inputs, self._counters = [], []
            every.callback(self._free)

    def stopped(self, outputs: NiOutputs) -> None:
        """Note that these outputs are being stopped or freed: by this stream itself, or before its end."""
        if self._player is not None and outputs is self._outputs:
            self._zeroed |= self._open and self._played < self._whole
            self._player = None

    def _free(self) -> None:
        outputs, self._outputs, self._player = self._outputs, None, None
        if outputs is not None:
            self._daq.done(outputs)

    def _input(self, home: str, names: tuple[str, ...], rate_hz: float) -> Any:
        settings = self._daq._settings
        task = self._daq.task(f"{home} input")
        self._inputs.append(task)
        for name in names:
            add_input(task, settings.channels[name])
        source = "" if home == self._plan.master else f"/{self._plan.master}/ai/SampleClock"
        kept = max(int(settings.buffer_s * rate_hz), 2 * self._request.block)
        if self._request.samples is None:
            task.timing.cfg_samp_clk_timing(
                rate_hz, source, sample_mode=AcquisitionType.CONTINUOUS, samps_per_chan=kept
            )
            # NI's default at 5 kS/s is two seconds.
            task.in_stream.input_buf_size = kept
        else:
            task.timing.cfg_samp_clk_timing(
                rate_hz, source, sample_mode=AcquisitionType.FINITE, samps_per_chan=self._request.samples
            )
        # By default a read starts what a reset of the card has aborted: samples would be missing unseen.
        task.in_stream.auto_start = False
        if settings.ai_conv_rate is not None:
            for card in self._plan.scanning(names, settings):
                timing = task.timing if card.home == card.name else task.timing[card.name]
                timing.ai_conv_rate = settings.ai_conv_rate
        return task

    def _counter(self, home: str, name: str) -> Any:
        """Create the task of a counter that counts on the master's sample clock."""
        task = self._daq.task(f"{home} counter {name}")
        add_counter(task, self._daq._settings.channels[name])
        finite = self._request.samples is not None
        task.timing.cfg_samp_clk_timing(
            self.rate_hz,
            f"/{self._plan.master}/ai/SampleClock",
            sample_mode=AcquisitionType.FINITE if finite else AcquisitionType.CONTINUOUS,
            samps_per_chan=self._request.samples or max(2 * self._request.block, round(self.rate_hz)),
        )
        return task

    def _delays(self, task: Any, names: tuple[str, ...]) -> list[float]:
        """Delays of a task's channels after the clock edge (s): of the multiplexer less those of filters."""
        conversions, products = self._plan.conversions(task)
        own = (self._daq._settings.channels[name].filter_delay for name in names)
        return [
            late - (filter_delay(product, self.rate_hz) if given is None else given)
            for late, product, given in zip(conversions, products, own, strict=True)
        ]

    def _refuse_other_rate(self, home: str) -> None:
        """Refuse a rate far from what was asked: some cards have few, and choose the next one.

        A waveform that is played along keeps its length only at the very rate that it was made for.
        """
        asked = self._request.rate_hz
        if self._request.play:
            near = abs(self.rate_hz / asked - 1) <= _PLAYED
        else:
            near = asked / 2 < self.rate_hz < 2 * asked
        if not near:
            raise other_rate(home, self.rate_hz, asked)

    def _arm_player(self, play: Mapping[str, FloatArray]) -> None:
        """Load the waveforms; they begin with the master's first sample."""
        home = self._plan.output
        assert home is not None, "a waveform has an output"
        length = self._length = max(2, *(len(volts) for volts in play.values()))
        rows = {name: np.pad(volts, (0, length - len(volts)), mode="edge") for name, volts in play.items()}
        self._outputs = self._daq.outputs_at(home)
        for task in self._beside_outputs():
            with self._daq.talking_to(home):
                task.control(TaskMode.TASK_COMMIT)
        clock = f"/{self._plan.master}/ai/SampleClock"
        self._player = self._outputs.play(rows, self.rate_hz, clock, self._was_reset)

    def _beside_outputs(self) -> list[Any]:
        """The task of the inputs on the outputs' card; none where it has no inputs here."""
        named = zip(self._plan.inputs, self._inputs, strict=False)
        return [task for (home, _), task in named if home == self._plan.output]

    def _was_reset(self) -> bool:
        """True when the outputs' card was reset since its inputs were reserved: their task has lost them."""
        home = str(self._plan.output)
        names = dict(self._plan.inputs).get(home, ())
        if not self._beside_outputs():
            return False
        first = self._daq._settings.channels[names[0]]
        return reservable(self._daq, home, lambda task: add_input(task, first))

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
        if volts:
            volts = [np.concatenate(volts) * self._units]
        for (home, name), task in zip(self._plan.counters, self._counters, strict=True):
            counted = np.full(count, np.nan)
            with self._daq.talking_to(home):
                got = CounterReader(task.in_stream).read_many_sample_double(counted, count, timeout)
            if got != count:
                raise InstrumentError(
                    f"{home} delivered {got} of {count} counts of {name} from sample {first} on: the "
                    "acquisition has ended before its time."
                )
            volts.append(counted[np.newaxis])
        # Once a second: each card is asked for its count by a call of its own, which costs as much as a read.
        second = round(_COUNTED * self.rate_hz)
        if (
            len(self._plan.inputs) > 1
            and self._request.samples is None
            and (first + count) // second > first // second
        ):
            self._refuse_drift()
        return np.concatenate(volts)

    def _refuse_cut_off(self, end: int) -> None:
        """Check, when the inputs are at sample `end`, that the waveform has been played whole so far."""
        task, output = self._player, self._plan.output
        if self._zeroed:
            raise zeroed(str(output))
        if task is None or output is None:
            return
        with self._daq.talking_to(output):
            # The task's own error, such as an underflow, is raised here.
            done = task.is_task_done()
            if not done and end < self._whole:
                self._played = end
                return
            # Whether it was played whole its samples say: old cards are done a clock pulse later, which the
            # inputs' clock never gives (NI-DAQmx Device Considerations, E Series and AO Series).
            played = self._generated(task, 0.0 if done else _AFTER)
        if played < self._whole:
            raise cut_off(output, played)
        self._played = end

    def _generated(self, task: Any, patience: float) -> int:
        """Samples that a play has put out; its last may be late by `patience` (s)."""
        for _ in range(1 + round(patience / _PAUSE)):
            played = int(task.out_stream.total_samp_per_chan_generated)
            if played >= self._whole:
                break
            RealClock().sleep(_PAUSE)
        return played

    @property
    def _whole(self) -> int:
        """Samples to be played: an acquisition that is shorter than the waveform ends it, by its clock."""
        return self._length if self._request.samples is None else min(self._length, self._request.samples)

    def _refuse_drift(self) -> None:
        """Check that cards on one clock have taken equally many samples."""
        # The master is queried before and after the others: the calls may be a second apart.
        asked = [*self._inputs, self._inputs[0]]
        with self._daq.talking_to(self._plan.master):
            before, *counts, after = [int(task.in_stream.total_samp_per_chan_acquired) for task in asked]
        apart = max(_APART * self.rate_hz, 2 * self._request.block)
        for (home, _), count in zip(self._plan.inputs[1:], counts, strict=True):
            if not before - apart <= count <= after + apart:
                raise InstrumentError(
                    f"{home} has taken {count} samples and {self._plan.master} {before} to {after}: they do "
                    "not run on one clock. Check the RTSI cable."
                )
