"""The DAQ role: named channels sampled on one clock, and waveforms played on the same clock."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import final

import numpy as np

from ...base.arrays import BoolArray, ComplexArray, FloatArray
from ...base.errors import ConfigurationError, LimitError
from ...base.threads import Closing
from ..interlock import Interlocked


@dataclass(frozen=True, eq=False)
class Block:
    """Consecutive samples of all streamed channels.

    `first` is the index of the first sample since the stream began: time is the sample index.
    `volts` is (channels, samples). `overload` is (channels,): True when a sample was at the end of
    the converter's range, so that its true value is not known.
    """

    first: int
    volts: FloatArray
    overload: BoolArray

    @property
    def end(self) -> int:
        """Index of the sample that follows this block."""
        return self.first + int(self.volts.shape[1])


@dataclass(frozen=True, eq=False)
class Capture:
    """A complete finite acquisition.

    `volts` is (channels, samples), `delays` and `overload` are (channels,) as in `Stream` and `Block`.
    """

    channels: tuple[str, ...]
    rate_hz: float
    volts: FloatArray
    delays: FloatArray
    overload: BoolArray


class Stream(Closing, ABC):
    """A running acquisition: iterate over its blocks, leave its context to stop it.

    Iteration ends after a finite stream's last sample. The context manager's exit stops the
    acquisition and every waveform that it plays, and leaves all outputs at zero volts.
    """

    channels: tuple[str, ...]
    """Names of the channels, in the order of a block's rows."""
    rate_hz: float
    """Actual sample rate of the hardware (Hz)."""
    delays: FloatArray
    """(channels,) delay of each channel's sampling after the clock edge (s): a multiplexed card samples
    its channels one after the other, and the digital filter of a delta-sigma converter delivers what was
    before the edge, which is negative here."""
    full_scale: FloatArray
    """(channels,) V: the input range, as +- full scale."""

    @abstractmethod
    def __iter__(self) -> Iterator[Block]:
        """Yield blocks in order, without a gap.

        Raises InstrumentError when a sample was lost or the card did not deliver in time: a lost
        sample is never silence.
        """

    @abstractmethod
    def close(self) -> None:
        """Stop acquiring and playing, outputs to zero. May be called again."""

    def capture(self, each: Callable[[Block], object] = lambda _block: None) -> Capture:
        """Read a finite stream to its end; `each` is called with every block as it arrives.

        Raises InstrumentError, as iterating does.
        """
        blocks: list[Block] = []
        for block in self:
            blocks.append(block)
            each(block)
        return Capture(
            self.channels,
            self.rate_hz,
            np.concatenate([b.volts for b in blocks], axis=1),
            self.delays,
            np.any([b.overload for b in blocks], axis=0),
        )


@dataclass(frozen=True, eq=False)
class StreamRequest:
    """The parameters of `Daq.stream`; `play` is empty when nothing plays."""

    channels: tuple[str, ...]
    rate_hz: float
    block: int
    samples: int | None = None
    play: Mapping[str, FloatArray] = field(default_factory=dict)

    def refuse_unknown(self, known: Collection[str], outputs: Collection[str]) -> None:
        """Refuse what no DAQ can stream: names that the rig file does not have, waveforms of unequal length.

        `known` and `outputs` are the names of the rig file's channels and outputs. Raises ConfigurationError
        and LimitError.
        """
        for name in [c for c in self.channels if c not in known] + [o for o in self.play if o not in outputs]:
            raise ConfigurationError(
                f"The DAQ has no channel {name!r}; the rig file names {', '.join([*known, *outputs])}."
            )
        if len({len(volts) for volts in self.play.values()}) > 1:
            raise LimitError("All waveforms that are played together must have the same length.")

    @property
    def length(self) -> int:
        """Samples of the waveforms; 0 when nothing plays."""
        return max((len(volts) for volts in self.play.values()), default=0)

    def blocks(self) -> Iterator[tuple[int, int]]:
        """Give each block's first sample and its number of samples; the last one of a finite stream may be
        short.
        """
        first = 0
        while self.samples is None or first < self.samples:
            count = self.block if self.samples is None else min(self.block, self.samples - first)
            yield first, count
            first += count


class Daq(Interlocked, ABC):
    """One or several cards that share a sample clock.

    Safe state: nothing plays, every output holds zero volts. Opening a Daq changes no output. A
    driver implements `_stream`, which only `stream` calls, once the rig's limiter has authorised the play.
    """

    identity: str
    """Product names and serial numbers, as the cards themselves report them."""
    simulated = False
    """True when a card reports that it is simulated."""
    declared: str | None = None
    """Settings that only a person can check, as a sentence to confirm; None when there are none."""

    @final
    def stream(
        self,
        channels: Sequence[str],
        rate_hz: float,
        block: int,
        samples: int | None = None,
        play: Mapping[str, FloatArray] | None = None,
    ) -> Stream:
        """Start to acquire `channels` at `rate_hz`, `block` samples at a time.

        `samples` makes the stream finite; None runs until it is closed. `play` gives for named
        outputs one waveform each ((samples,) V at the output terminal, all of one length), begun
        on the sample clock edge of sample 0 and updated at `rate_hz`; after its last sample an
        output holds that sample's value until the stream is closed.

        Raises ConfigurationError for an unknown channel or output, or a rate that the card cannot
        run; LimitError for a waveform that is not finite, outside the output's range, or that
        the rig's limiter has not authorised (see `Rig.excite`); InstrumentError when the card refuses.
        """
        for output, volts in (play or {}).items():
            self._interlock.authorise(output, volts, rate_hz)
        return self._stream(StreamRequest(tuple(channels), rate_hz, block, samples, dict(play or {})))

    def captured(self, channels: Sequence[str], rate_hz: float, seconds: float) -> Capture:
        """Acquire `channels` at `rate_hz` for `seconds`, while nothing plays. Raises as `stream`."""
        with self.stream(channels, rate_hz, round(rate_hz / 10), round(seconds * rate_hz)) as stream:
            return stream.capture()

    @abstractmethod
    def _stream(self, request: StreamRequest) -> Stream:
        """Do the driver's part of `stream`."""

    def clear_left(self) -> None:
        """Clear what a killed program has left in the cards, if anything can remain there.

        The caller must hold the hardware's lock, which proves that no running program uses it.
        """

    def cards(self, channels: Sequence[str]) -> Mapping[str, Sequence[str]]:
        """`channels` by the name of the card that samples them, for tests of each card and of their clock.

        A DAQ of one card need not override this: the name is then empty.
        """
        return {"": channels}

    def response(self, channel: str, frequencies: FloatArray) -> ComplexArray:
        """Frequency response of a channel's input at `frequencies` (Hz): of an AC coupling, a high-pass."""
        return np.ones(len(frequencies), dtype=np.complex128)

    def filtered(self, channel: str) -> bool:
        """Return True where the card filters what lies above half the sample rate, which folds back else."""
        return False

    def output_response(self, output: str, frequencies: FloatArray) -> ComplexArray:
        """Frequency response of an output at `frequencies` (Hz), as `response` of an input."""
        return np.ones(len(frequencies), dtype=np.complex128)

    @abstractmethod
    def zero(self) -> None:
        """Write zero volts to every output. Idempotent. Raises InstrumentError.

        A play that this cuts short is none: the next block of its stream is an InstrumentError.
        """

    def hold(self) -> None:
        """Write zero volts to every output, and let no other program write to one until `let_go`.

        A stream takes its outputs over, and leaves them held. Called again, it also looks whether they still
        are. Raises InstrumentError where another program has an output, or has taken it. A driver whose cards
        cannot be reserved only writes zero.
        """
        self.zero()

    @final
    def let_go(self) -> None:
        """Let other programs write to the outputs again, which keep their value. Idempotent.

        Raises LimitError while a drive is played, or a contact may be closed.
        """
        self._interlock.authorise_release()
        self._let_go()

    def _let_go(self) -> None:
        """Do the driver's part of `let_go`."""

    def outputs_read(self) -> Mapping[str, float]:
        """Volts that stand now on the outputs that the cards can read back, by name (V).

        Outputs of other cards are left out, and so are those of a card that is being streamed from.
        Raises InstrumentError.
        """
        return {}

    @abstractmethod
    def close(self) -> None:
        """Release the cards without changing an output. May be called again."""
