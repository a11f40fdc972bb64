"""Twin of any DAQ: converters and outputs of the cards that are described to it, on the plant's clock.

A package that adds a DAQ's driver makes its twin by naming the card's channels with their ranges, its rate
and its outputs. NI's twin is one of these, with NI's products and NI's sentences.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ...base.arrays import BoolArray, FloatArray
from ...base.errors import ConfigurationError, HaploopError, InstrumentError, LimitError
from ...instruments.daq import Block, Daq, Stream, StreamRequest
from ...nidaqmx_twin.converter import convert, noise_of, put_out
from ...nidaqmx_twin.nodes import PlayStopped, Run, SamplesLost
from ..plant import Plant

_APART = 0.5
"""Largest difference between two cards' sample counts that is accepted, as time (s)."""
_EXACT = 1e-9
"""Relative difference within which two rates are one."""


@dataclass(frozen=True, eq=False)
class Card:
    """Terminals and converters of one card, under the names of the rig file.

    With its defaults it is a multiplexed 16-bit card with the noise of an ordinary one (estimate).
    """

    name: str
    """Product, as the driver's identity says it."""
    channels: Mapping[str, float]
    """Input range of each channel (+- V)."""
    ai_rate_hz: float
    """Conversions per second: of all channels together on a multiplexed card, else of each channel."""
    outputs: Mapping[str, float] = field(default_factory=dict)
    """Largest voltage of each output (+- V)."""
    device: str = ""
    """Name of the card in sentences and for faults; empty: its product."""
    ai_rate_single_hz: float = 0.0
    """Conversions per second when only one channel is read; 0: the same."""
    ai_simultaneous: bool = False
    """True when each channel has its own converter."""
    ai_bits: int = 16
    ai_noise: float = 0.28e-3
    """Noise in a range of +-10 V (V rms), scaled with the range."""
    ao_bits: int = 16
    ao_range: float = 0.0
    """Full scale of the outputs' converters (+- V); 0: the largest of `outputs`."""
    ao_unipolar: bool = False
    """True when the outputs go from 0 V upwards."""
    rates_hz: tuple[float, ...] = ()
    """The only rates that it runs at; empty: any up to `ai_rate_hz`."""
    counters: tuple[str, ...] = ()
    """Channels that count: their nodes carry counts, and their rows are whole, from 0 on."""

    def __post_init__(self) -> None:
        """Fill in what follows from other figures."""
        object.__setattr__(self, "ao_range", self.ao_range or max(self.outputs.values(), default=0.0))
        object.__setattr__(self, "ai_rate_single_hz", self.ai_rate_single_hz or self.ai_rate_hz)

    @property
    def label(self) -> str:
        """How sentences call it."""
        return self.device or self.name


class Terminal:
    """An output terminal: holds its last value, or steps through a waveform."""

    def __init__(self) -> None:
        self._run: Run | None = None
        self._next = 0

    def play(self, run: Run) -> None:
        """Step through `run` from its start on."""
        self._run, self._next = run, 0

    def cut_off(self, now: float) -> None:
        """Stop playing at `now` (s); the value is held."""
        self.play(Run(now, np.inf, np.array([self.volts(now)])))

    def volts(self, now: float) -> float:
        """Volts at `now` (s)."""
        return float(self.at(np.array([now]))[0])

    def at(self, times: FloatArray) -> FloatArray:
        """Volts at `times` ((times,) s), none of which lies before the present run."""
        run = self._run
        if run is None:
            return np.zeros(len(times))
        steps = np.floor((times - run.start) / run.period + 1e-3)
        index = np.clip(steps, 0, len(run.values) - 1).astype(np.int64)
        return np.where(times < run.start, 0.0, run.values[index])

    def take(self, until: float) -> Sequence[Run]:
        """See `haploop.nidaqmx_twin.nodes.Source.take`."""
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


class CardTwin(Daq):
    """See `Daq`. One twin simulates all cards of the rig, which share a sample clock."""

    def __init__(self, plant: Plant, *cards: Card) -> None:
        self._plant = plant
        self._cards = cards
        self._card_of = {name: card for card in cards for name in card.channels}
        self._home_of = {name: card for card in cards for name in card.outputs}
        self._starts = {card.label: 0 for card in cards}
        self._outputs = {name: Terminal() for name in self._home_of}
        self._times_zeroed = 0
        for name, output in self._outputs.items():
            plant.drive(name, output)
        for name, card in self._card_of.items():
            plant.sample_by(name, card.label)
        self.identity = " + ".join(
            f"{card.name} ({f'{card.device}, ' if card.device else ''}twin)" for card in cards
        )

    def _stream(self, request: StreamRequest) -> Stream:
        request = replace(request, rate_hz=self._rate(request))
        self._refuse(request)
        rate_hz, play = request.rate_hz, request.play
        shares: list[_Share] = []
        for card in self._cards:
            mine = tuple(c for c in request.channels if self._card_of[c] is card)
            if mine:
                noise = noise_of(self._plant.settings.seed, card.label, self._starts[card.label])
                self._starts[card.label] += 1
                ranges = np.array([self._range(card, c) for c in mine])
                delays = np.zeros(len(mine))
                counts = np.array([c in card.counters for c in mine])
                analog = [c for c in mine if c not in card.counters]
                delays[~counts] = self._delays(card, rate_hz, analog)
                shares.append(_Share(card, mine, ranges, delays, noise, counts))
        start = self._plant.clock.now()
        if play:
            # The plant takes what stood on the outputs until now, before it is replaced.
            self._plant.advance(start)
        for name, volts in play.items():
            put = put_out(volts, self._home_of[name])
            self._outputs[name].play(Run(start, 1 / rate_hz, put))
        return _CardStream(self, shares, request, start)

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

    def cards(self, channels: Sequence[str]) -> Mapping[str, Sequence[str]]:
        """See `Daq.cards`."""
        groups: dict[str, list[str]] = {}
        for name in channels:
            card = self._card_of.get(name)
            groups.setdefault(card.label if card else "", []).append(name)
        return groups

    def close(self) -> None:
        """See `Daq.close`."""

    # How a maker's cards differ from this

    def _range(self, card: Card, channel: str) -> float:
        """Input range of a channel (+- V)."""
        return card.channels[channel]

    def _rate(self, request: StreamRequest) -> float:
        """Rate at which the cards really sample when `request.rate_hz` is asked for."""
        return request.rate_hz

    def _delays(self, card: Card, rate_hz: float, channels: Sequence[str]) -> FloatArray:
        """Delays of the conversions of `channels` after the clock edge, (channels,) s."""
        count = len(channels)
        interval = 0.0 if card.ai_simultaneous or count == 1 else 1 / card.ai_rate_hz
        return np.arange(count, dtype=np.float64) * interval

    def _lost(self, card: Card, lost: SamplesLost) -> HaploopError:
        """The driver's error for samples that a fault made a card lose."""
        return InstrumentError(
            f"{card.label} lost samples (a simulated {lost.how}): lower the rate, and try again."
        )

    def _ended(self, card: Card, stopped: PlayStopped, played: int) -> HaploopError:
        """The driver's error for a play that a fault ended after `played` samples."""
        return InstrumentError(
            f"{card.label} stopped playing when it had played {played} samples (a simulated {stopped.how}): "
            "the waveform was not played whole. Try again."
        )

    def _zeroed(self, cards: Sequence[Card]) -> HaploopError:
        """The driver's error for a play that `zero` cut short."""
        return InstrumentError(
            f"{' and '.join(card.label for card in cards)} was set to zero by this program while it played: "
            "the waveform was not played whole, and what was measured is not used."
        )

    # For streams

    def cut_off(self, outputs: Sequence[str], played: int) -> None:
        """Stop what plays on `outputs` when a fault ends it. Raises the driver's error."""
        now = self._plant.clock.now()
        for card in dict.fromkeys(self._home_of[name] for name in outputs):
            try:
                self._plant.plays(card.label)
            except PlayStopped as stopped:
                for name in outputs:
                    self._outputs[name].cut_off(now)
                raise self._ended(card, stopped, played) from None

    def _refuse(self, request: StreamRequest) -> None:
        request.refuse_unknown(self._card_of, self._outputs)
        for card in self._cards:
            count = sum(self._card_of[c] is card and c not in card.counters for c in request.channels)
            if count:
                _refuse_rate(card, request.rate_hz, count)
        for name, volts in request.play.items():
            card = self._home_of[name]
            most = card.outputs[name]
            least = 0.0 if card.ao_unipolar else -most
            if (
                not np.all(np.isfinite(volts))
                or volts.max(initial=0.0) > most
                or volts.min(initial=0.0) < least
            ):
                span = f"0 to {most:g}" if card.ao_unipolar else f"+-{most:g}"
                raise LimitError(
                    f"The waveform for {name!r} leaves the output's range of {span} V or is not finite."
                )


def _refuse_rate(card: Card, rate_hz: float, count: int) -> None:
    """Raise ConfigurationError for a rate at which a card cannot sample `count` channels."""
    if card.rates_hz and not np.isclose(rate_hz, card.rates_hz, rtol=_EXACT, atol=0).any():
        rates = ", ".join(f"{rate:g}" for rate in card.rates_hz)
        raise ConfigurationError(
            f"{card.label} samples at {rates} Hz, and {rate_hz:g} Hz were asked for: write such a rate_hz."
        )
    fastest = card.ai_rate_single_hz if count == 1 else card.ai_rate_hz
    total = rate_hz * (1 if card.ai_simultaneous else count)
    if total > fastest:
        called = f"{card.device} ({card.name})" if card.device else card.name
        raise ConfigurationError(
            f"{called} converts {fastest:g} samples per second, and {count} channels at {rate_hz:g} Hz need "
            f"{total:g}: lower the rate."
        )


@dataclass(frozen=True, eq=False)
class _Share:
    """One card's share of a stream."""

    card: Card
    channels: tuple[str, ...]
    ranges: FloatArray
    delays: FloatArray
    noise: np.random.Generator
    counts: BoolArray
    """True for each channel that counts."""
    zeros: dict[int, FloatArray] = field(default_factory=dict)

    def counted(
        self, rows: FloatArray, volts: FloatArray, overload: BoolArray
    ) -> tuple[FloatArray, BoolArray]:
        """Replace the rows of counters by whole counts since the stream began."""
        whole = np.floor(rows[self.counts])
        whole -= self.zeros.setdefault(0, whole[:, :1].copy())
        volts[self.counts] = whole
        overload[self.counts] = np.abs(whole).max(axis=1) >= self.ranges[self.counts]
        return volts, overload


class _CardStream(Stream):
    """See `Stream`. Its first sample is taken at `start` (s)."""

    def __init__(self, daq: CardTwin, shares: Sequence[_Share], request: StreamRequest, start: float) -> None:
        self.channels, self.rate_hz = request.channels, request.rate_hz
        self._daq, self._plant, self._shares = daq, daq._plant, shares
        self._request, self._start = request, start
        self._zeroed = daq._times_zeroed
        order = [channel for share in shares for channel in share.channels]
        self._rows = [order.index(channel) for channel in self.channels]
        self.delays = np.concatenate([share.delays for share in shares])[self._rows]
        self.full_scale = np.concatenate([share.ranges for share in shares])[self._rows]
        self._open = True

    def __iter__(self) -> Iterator[Block]:
        """See `Stream.__iter__`."""
        request, daq = self._request, self._daq
        in_order = self._rows == list(range(len(self._rows)))
        for first, count in request.blocks():
            if not self._open:
                return
            edges = self._start + (first + np.arange(count)) / self.rate_hz
            # A filter's delay is of the past.
            self._plant.clock.sleep(edges[-1] + max(0.0, self.delays.max()) - self._plant.clock.now())
            parts, overloads = [], []
            for share in self._shares:
                try:
                    rows = self._plant.read(share.channels, edges + share.delays[:, np.newaxis])
                except SamplesLost as lost:
                    raise daq._lost(share.card, lost) from None
                for row, name in enumerate(share.channels):
                    plugged = self._plant.cables.get(name)
                    if plugged in daq._outputs:
                        rows[row] = daq._outputs[plugged].at(edges + share.delays[row])
                converted = convert(rows, share.ranges, share.card, share.noise)
                if share.counts.any():
                    converted = share.counted(rows, *converted)
                parts.append(converted[0])
                overloads.append(converted[1])
            if daq._times_zeroed != self._zeroed and first < request.length:
                raise daq._zeroed(list(dict.fromkeys(daq._home_of[name] for name in request.play)))
            daq.cut_off(tuple(request.play), first + count)
            if request.samples is None and self._plant.faults:
                self._refuse_drift(edges[-1])
            volts, overload = np.concatenate(parts), np.concatenate(overloads)
            if not in_order:
                volts, overload = volts[self._rows], overload[self._rows]
            yield Block(first, volts, overload)

    def _refuse_drift(self, now: float) -> None:
        """Raise InstrumentError, as a driver does, when the cards' sample counts differ too much."""
        counts = {}
        for share in self._shares:
            begin, end = self._plant.lateness(share.card.label, np.array([self._start, now]))
            counts[share.card.label] = round((now - self._start - (end - begin)) * self.rate_hz)
        fewest, most = min(counts, key=counts.__getitem__), max(counts, key=counts.__getitem__)
        if counts[most] - counts[fewest] > max(_APART * self.rate_hz, 2 * self._request.block):
            raise InstrumentError(
                f"{fewest} has taken {counts[fewest]} samples and {most} {counts[most]}: they do not "
                "run on one clock. Check the RTSI cable."
            )

    def close(self) -> None:
        """See `Stream.close`."""
        if self._open:
            self._open = False
            self._daq.zero()
