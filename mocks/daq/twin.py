"""Twin of the DAQ: converters and outputs of the rig's cards, on the plant's clock."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby

import numpy as np

from ...instruments.arrays import FloatArray
from ...instruments.daq import Block, Daq, Stream
from ...instruments.daq.ni_daqmx import NiDaq
from ...instruments.daq.ni_sentences import cut_off, refused, zeroed
from ...instruments.daq.ni_settings import device_of
from ...instruments.errors import ConfigurationError, InstrumentError, LimitError
from ..plant import Plant, PlayStopped, Run, SamplesLost
from .converter import LOST, STOPPED, convert, noise_of, put_out
from .products import PRODUCTS, Product, convert_interval, input_range

__all__ = ["DaqTwin"]


_NO_CABLE = -89125
"""NI's error for cards without a trigger line between them."""
_APART = 0.5
"""Largest difference between two cards' sample counts that the driver accepts, as time (s)."""


class _Output:
    """An output terminal: holds its last value, or steps through a waveform."""

    def __init__(self) -> None:
        self._run: Run | None = None
        self._next = 0

    def play(self, run: Run) -> None:
        self._run, self._next = run, 0

    def cut_off(self, now: float) -> None:
        """Stop playing at `now` (s); the value is held."""
        self.play(Run(now, np.inf, np.array([self.volts(now)])))

    def volts(self, now: float) -> float:
        """Volts at `now` (s)."""
        run = self._run
        if run is None or run.start > now:
            return 0.0
        step = int((now - run.start) / run.period + 1e-3) if len(run.values) > 1 else 0
        return float(run.values[min(step, len(run.values) - 1)])

    def take(self, until: float) -> Sequence[Run]:
        """See `haploop.mocks.plant.Source.take`."""
        run = self._run
        if run is None or run.start > until:
            return []
        # The tolerance counts a step at `until` itself as past, in spite of rounding.
        past = len(run.values)
        if past > 1:
            past = min(past, int((until - run.start) / run.period + 1e-3) + 1)
        first, self._next = self._next, past
        start = run.start + first * run.period if first else run.start
        return [Run(start, run.period, run.values[first:past])] if first < past else []


class DaqTwin(Daq):
    """See `Daq`. One twin simulates all cards of the rig, which share a sample clock."""

    def __init__(self, settings: NiDaq.Settings, plant: Plant) -> None:
        self._settings = settings
        self._plant = plant
        self._products = {device: _product(device, name) for device, name in settings.devices.items()}
        self._starts = dict.fromkeys(self._products, 0)
        self._outputs = {name: _Output() for name in settings.outputs}
        self._times_zeroed = 0
        for name, output in self._outputs.items():
            plant.drive(name, output)
        self.identity = " + ".join(f"{p.name} ({device}, twin)" for device, p in self._products.items())

    def _stream(
        self,
        channels: Sequence[str],
        rate_hz: float,
        block: int,
        samples: int | None,
        play: Mapping[str, FloatArray] | None,
    ) -> Stream:
        self._refuse(channels, rate_hz, play or {})
        self._refuse_apart(channels)
        devices: list[_Device] = []
        known = self._settings.channels
        for name, product in self._products.items():
            mine = [c for c in channels if device_of(known[c].terminal) == name]
            if mine:
                noise = noise_of(self._plant.settings.seed, name, self._starts[name])
                self._starts[name] += 1
                ranges = np.array([_full_scale(product, c, known[c].range) for c in mine])
                interval = convert_interval(product, rate_hz, len(mine))
                delays = np.arange(len(mine), dtype=np.float64) * interval
                devices.append(_Device(name, product, tuple(mine), ranges, delays, noise))
        start = self._plant.clock.now()
        if play:
            # The plant takes what stood on the outputs until now, before it is replaced.
            self._plant.advance(start)
        for name, volts in (play or {}).items():
            put = put_out(volts, self._products[device_of(self._settings.outputs[name].terminal)])
            self._outputs[name].play(Run(start, 1 / rate_hz, put))
        playing = {name: device_of(self._settings.outputs[name].terminal) for name in play or {}}
        length = max((len(volts) for volts in (play or {}).values()), default=0)
        return _TwinStream(
            self, self._plant, devices, tuple(channels), rate_hz, block, samples, start, playing, length
        )

    def cut_off(self, outputs: Mapping[str, str], played: int) -> None:
        """Stop what plays on `outputs` (cards by name) when a fault ends it. Raises the driver's error."""
        now = self._plant.clock.now()
        for card in dict.fromkeys(outputs.values()):
            try:
                self._plant.plays(card)
            except PlayStopped as stopped:
                for name in outputs:
                    self._outputs[name].cut_off(now)
                if stopped.how in STOPPED:
                    raise refused(card, STOPPED[stopped.how], "") from None
                raise cut_off(card, played) from None

    def zero(self) -> None:
        """See `Daq.zero`."""
        now = self._plant.clock.now()
        self._times_zeroed += 1
        # The plant takes the output played until now before it is set to zero.
        self._plant.advance(now)
        for output in self._outputs.values():
            output.play(Run(now, np.inf, np.zeros(1)))

    def outputs_read(self) -> Mapping[str, float]:
        """See `Daq.outputs_read`."""
        now = self._plant.clock.now()
        return {name: output.volts(now) for name, output in self._outputs.items()}

    def close(self) -> None:
        """See `Daq.close`."""

    def _refuse(self, channels: Sequence[str], rate_hz: float, play: Mapping[str, FloatArray]) -> None:
        known, outputs = self._settings.channels, self._settings.outputs
        for name in [c for c in channels if c not in known] + [o for o in play if o not in outputs]:
            raise ConfigurationError(
                f"The DAQ has no channel {name!r}; the rig file names {', '.join([*known, *outputs])}."
            )
        devices = sorted(device_of(known[c].terminal) for c in channels)
        for device, group in groupby(devices):
            product, count = self._products[device], len(list(group))
            fastest = product.ai_rate_single_hz if count == 1 else product.ai_rate_hz
            total = rate_hz * (1 if product.ai_simultaneous else count)
            if total > fastest:
                raise ConfigurationError(
                    f"{device} ({product.name}) converts {fastest:g} samples per second, and "
                    f"{count} channels at {rate_hz:g} Hz need {total:g}: lower the rate."
                )
        if len({len(volts) for volts in play.values()}) > 1:
            raise LimitError("All waveforms that are played together must have the same length.")
        for name, volts in play.items():
            if not np.all(np.isfinite(volts)) or np.abs(volts).max(initial=0.0) > outputs[name].range:
                raise LimitError(
                    f"The waveform for {name!r} leaves the output's range of "
                    f"+-{outputs[name].range:g} V or is not finite."
                )

    def _refuse_apart(self, channels: Sequence[str]) -> None:
        """Raise the driver's error when the channels are on two cards without a cable between them."""
        used = {device_of(self._settings.channels[channel].terminal) for channel in channels}
        if len(used) > 1 and not self._plant.has_rtsi():
            first = next(device for device in self._products if device in used)
            raise refused(first, _NO_CABLE, "")


class _Device:
    """One card's share of a stream."""

    def __init__(
        self,
        name: str,
        product: Product,
        channels: tuple[str, ...],
        ranges: FloatArray,
        delays: FloatArray,
        noise: np.random.Generator,
    ) -> None:
        self.name, self.product, self.channels, self.ranges = name, product, channels, ranges
        self.delays, self.noise = delays, noise


class _TwinStream(Stream):
    """See `Stream`."""

    def __init__(
        self,
        daq: DaqTwin,
        plant: Plant,
        devices: Sequence[_Device],
        channels: tuple[str, ...],
        rate_hz: float,
        block: int,
        samples: int | None,
        start: float,
        playing: Mapping[str, str],
        length: int,
    ) -> None:
        self.channels = channels
        self.rate_hz = rate_hz
        self._playing, self._length = playing, length
        self._zeroed = daq._times_zeroed
        order = [channel for device in devices for channel in device.channels]
        self._rows = [order.index(channel) for channel in channels]
        self.delays = np.concatenate([d.delays for d in devices])[self._rows]
        self.full_scale = np.concatenate([d.ranges for d in devices])[self._rows]
        self._daq, self._plant, self._devices = daq, plant, devices
        self._block, self._samples, self._start = block, samples, start
        self._open = True

    def __iter__(self) -> Iterator[Block]:
        """See `Stream.__iter__`."""
        clock, first = self._plant.clock, 0
        in_order = self._rows == list(range(len(self._rows)))
        while self._open and (self._samples is None or first < self._samples):
            count = self._block if self._samples is None else min(self._block, self._samples - first)
            edges = self._start + (first + np.arange(count)) / self.rate_hz
            clock.sleep(edges[-1] + self.delays.max() - clock.now())
            parts, overloads = [], []
            for device in self._devices:
                try:
                    rows = self._plant.read(device.channels, edges + device.delays[:, np.newaxis])
                except SamplesLost as lost:
                    raise refused(device.name, LOST[lost.how], str(lost)) from None
                converted = convert(rows, device.ranges, device.product, device.noise)
                parts.append(converted[0])
                overloads.append(converted[1])
            if self._daq._times_zeroed != self._zeroed and first < self._length:
                raise zeroed(" and ".join(dict.fromkeys(self._playing.values())))
            self._daq.cut_off(self._playing, first + count)
            if self._samples is None and self._plant.faults:
                self._refuse_drift(edges[-1])
            volts, overload = np.concatenate(parts), np.concatenate(overloads)
            if not in_order:
                volts, overload = volts[self._rows], overload[self._rows]
            yield Block(first, volts, overload)
            first += count

    def _refuse_drift(self, now: float) -> None:
        """Raise InstrumentError, as the driver does, when the cards' sample counts differ too much."""
        counts = {}
        for device in self._devices:
            begin, end = self._plant.lateness(device.name, np.array([self._start, now]))
            counts[device.name] = round((now - self._start - (end - begin)) * self.rate_hz)
        fewest, most = min(counts, key=counts.__getitem__), max(counts, key=counts.__getitem__)
        if counts[most] - counts[fewest] > max(_APART * self.rate_hz, 2 * self._block):
            raise InstrumentError(
                f"{fewest} has taken {counts[fewest]} samples and {most} {counts[most]}: they do not "
                "run on one clock. Check the RTSI cable."
            )

    def close(self) -> None:
        """See `Stream.close`."""
        if self._open:
            self._open = False
            self._daq.zero()


def _full_scale(product: Product, channel: str, wanted: float) -> float:
    """Return the card's next wider range (+- V), as the driver chooses it."""
    full_scale = input_range(product, wanted)
    if full_scale is None:
        raise ConfigurationError(
            f"The channel {channel!r} asks for +-{wanted:g} V, and the widest range of a {product.name} is "
            f"+-{max(product.ai_ranges, default=0):g} V."
        )
    return full_scale


def _product(device: str, name: str) -> Product:
    if name not in PRODUCTS:
        raise ConfigurationError(
            f"There is no twin of {name!r} ({device}); there are {', '.join(sorted(PRODUCTS))}."
        )
    return PRODUCTS[name]
