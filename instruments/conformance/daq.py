"""Promises of the DAQ role."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice
from typing import ClassVar

import numpy as np
import pytest

from ...base.arrays import FloatArray
from ...base.errors import ConfigurationError, InstrumentError, LimitError
from ..daq import Block, Daq
from .suite import Conformance, bypass_interlock, refused

_SEED = 5
_ALIKE = 0.75
"""Correlation of a random waveform with itself, smoothed; with any other it is below 0.5."""


class DaqConformance(Conformance):
    """Give a fixture `daq`: a driver that has just been opened, its outputs at zero volts."""

    channels: ClassVar[tuple[str, ...]]
    """Some of its channels, at least two where it has them."""
    outputs: ClassVar[tuple[str, ...]] = ()
    """Its outputs."""
    rate_hz: ClassVar[float] = 1000.0
    """A rate at which it samples all of `channels`."""
    output_range: ClassVar[float] = 10.0
    """Range of each output (+- V)."""
    played: ClassVar[float] = 1.0
    """Largest voltage played (V): something may be connected to the output."""
    loop: ClassVar[tuple[str, str]]
    """An output, and the channel that it is wired to."""
    loop_gain: ClassVar[float] = 1.0
    """Volts at the channel per volt at the output."""
    ac_coupled: ClassVar[bool] = False
    """True when the outputs lose a mean, and refuse a waveform that has one."""
    tolerance: ClassVar[float] = 0.02
    """Largest difference between the volts read and those at the channel (V)."""
    optional: ClassVar = {
        "outputs": "name its outputs and their output_range",
        "loop": "wire an output to a channel, and name both in loop (with outputs)",
        "reopen": "give reopen(), which opens a second driver on the same cards",
    }

    def reopen(self) -> Daq:
        """Return a second driver on the same cards, opened as the first one was."""
        raise NotImplementedError

    @pytest.fixture(autouse=True)
    def _playing(self, _skip_what_is_not_offered: None, request: pytest.FixtureRequest) -> None:
        bypass_interlock(request.getfixturevalue("daq"))

    # Samples

    def test_says_what_it_is(self, daq: Daq) -> None:
        """Its identity is one line."""
        assert daq.identity.strip() and "\n" not in daq.identity

    @pytest.mark.parametrize(("block", "samples"), [(64, 200), (50, 100), (500, 120), (1, 5)])
    def test_a_finite_stream_delivers_exactly_its_samples(self, daq: Daq, block: int, samples: int) -> None:
        """Every sample once, in blocks that follow each other without a gap; then it ends."""
        with daq.stream(self.channels, self.rate_hz, block, samples) as stream:
            blocks = self.in_time(lambda: list(stream))
        self._contiguous(blocks)
        assert blocks[-1].end == samples
        assert all(b.volts.shape[1] == block for b in blocks[:-1])

    def test_a_continuous_stream_goes_on_until_it_is_closed(self, daq: Daq) -> None:
        """Without `samples` blocks keep coming, each whole, until the stream is closed."""
        blocks: list[Block] = []
        with daq.stream(self.channels, self.rate_hz, 40) as stream:
            self.in_time(lambda: blocks.extend(islice(stream, 6)))
            stream.close()
            stream.close()
        assert len(blocks) == 6
        self._contiguous(blocks)
        assert all(b.volts.shape[1] == 40 for b in blocks)

    def test_a_closed_stream_yields_no_more(self, daq: Daq) -> None:
        """Closing a stream from within its loop ends the loop."""

        def run() -> int:
            count = 0
            with daq.stream(self.channels, self.rate_hz, 40) as stream:
                for _ in stream:
                    count += 1
                    if count == 2:
                        stream.close()
            return count

        assert self.in_time(run) == 2

    def test_each_stream_counts_from_zero(self, daq: Daq) -> None:
        """The index of a block counts from its own stream's first sample."""
        for _ in range(2):
            with daq.stream(self.channels[:1], self.rate_hz, 30, 60) as stream:
                blocks = self.in_time(lambda s=stream: list(s))  # type: ignore[misc]
            assert [b.first for b in blocks] == [0, 30]

    def test_a_stream_says_how_it_samples(self, daq: Daq) -> None:
        """The real rate is near the one asked for; delays end within a period, ranges lie above zero."""
        with daq.stream(self.channels, self.rate_hz, 50, 50) as stream:
            count = len(self.channels)
            assert stream.channels == tuple(self.channels)
            assert stream.rate_hz == pytest.approx(self.rate_hz, rel=0.01)
            assert np.shape(stream.delays) == np.shape(stream.full_scale) == (count,)
            # A digital filter makes a sample older than its edge.
            assert np.all(np.isfinite(stream.delays)) and np.all(stream.delays < 1 / stream.rate_hz)
            assert np.all(stream.full_scale > 0)
            (block,) = self.in_time(lambda: list(stream))
        assert np.all(np.abs(block.volts) <= 1.1 * stream.full_scale[:, np.newaxis])

    def test_rows_keep_the_order_asked_for(self, daq: Daq) -> None:
        """Channels, ranges and rows come in the requested order, whichever the card prefers."""
        ranges = []
        for names in (self.channels, self.channels[::-1]):
            with daq.stream(names, self.rate_hz, 50, 50) as stream:
                assert stream.channels == tuple(names)
                ranges.append(dict(zip(names, stream.full_scale.tolist(), strict=True)))
        assert ranges[0] == ranges[1]

    @pytest.mark.requires("loop")
    def test_a_row_is_its_channels(self, daq: Daq) -> None:
        """A played waveform is found in the row of the channel that it is wired to, in any order."""
        output, channel = self.loop
        others = [name for name in self.channels if name != channel]
        wave = self._wave(100)
        for names in ([channel, *others], [*others, channel]):
            with daq.stream(names, self.rate_hz, 25, 100, {output: wave}) as stream:
                volts = self.in_time(stream.capture).volts[names.index(channel)]
            assert self._lag(volts, wave) in (0, 1)

    # Refusals

    def test_an_unknown_channel_is_refused(self, daq: Daq) -> None:
        """An unknown channel is a ConfigurationError that names it; the DAQ stays usable."""
        with refused(ConfigurationError, naming="no-such-channel"):
            daq.stream([*self.channels, "no-such-channel"], self.rate_hz, 50, 50)
        with daq.stream(self.channels, self.rate_hz, 50, 50) as stream:
            assert self.in_time(stream.capture).volts.shape == (len(self.channels), 50)

    def test_an_unknown_output_is_refused(self, daq: Daq) -> None:
        """An unknown output is a ConfigurationError that names it."""
        with refused(ConfigurationError, naming="no-such-output"):
            daq.stream(self.channels, self.rate_hz, 50, 50, {"no-such-output": np.zeros(50)})

    def test_an_impossible_rate_is_refused(self, daq: Daq) -> None:
        """A rate that no card runs is a ConfigurationError."""
        with refused(ConfigurationError):
            daq.stream(self.channels, 1e12, 50, 50)

    @pytest.mark.requires("outputs")
    @pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1.05, -1.05])
    def test_a_waveform_that_cannot_be_played_is_refused(self, daq: Daq, bad: float) -> None:
        """A waveform that is not finite or out of range is a LimitError, and none of it is written."""
        output = self.loop[0] if "loop" in self.capabilities else self.outputs[0]
        wave = np.full(60, self.played)
        wave[30] = bad * self.output_range
        with refused(LimitError):
            daq.stream(self.channels, self.rate_hz, 50, 100, {output: wave})
        self._rests(daq)

    # Playing

    @pytest.mark.requires("outputs", "loop")
    def test_plays_on_the_clock_edge_of_sample_0(self, daq: Daq) -> None:
        """A waveform begins on sample 0's clock edge (its converter may see it one sample later)."""
        output, channel = self.loop
        wave = self._wave(150)
        for _ in range(2):
            with daq.stream([channel], self.rate_hz, 40, 200, {output: wave}) as stream:
                volts = self.in_time(stream.capture).volts[0]
            assert self._lag(volts[:150], wave) in (0, 1)

    @pytest.mark.requires("outputs", "loop")
    def test_an_output_holds_its_last_sample_until_the_stream_is_closed(self, daq: Daq) -> None:
        """After its last sample an output keeps that value; when the stream closes it is zero."""
        if self.ac_coupled:
            pytest.skip("an AC-coupled output holds no voltage")
        output, channel = self.loop
        wave = np.linspace(0, self.played, 50)
        with daq.stream([channel], self.rate_hz, 50, 150, {output: wave}) as stream:
            volts = self.in_time(stream.capture).volts[0]
            assert volts[60:] == pytest.approx(self.loop_gain * wave[-1], abs=self.tolerance)
        self._rests(daq)

    @pytest.mark.requires("outputs", "loop")
    def test_an_exception_leaves_the_output_at_zero(self, daq: Daq) -> None:
        """Leaving a stream by an exception stops what plays and leaves zero volts."""
        output, channel = self.loop
        wave = self._loud(1000)
        with (
            pytest.raises(ZeroDivisionError),
            daq.stream([channel], self.rate_hz, 20, 1000, {output: wave}) as stream,
        ):
            next(iter(stream))
            raise ZeroDivisionError
        self._rests(daq)

    @pytest.mark.requires("outputs", "loop")
    def test_zero_stops_what_plays(self, daq: Daq) -> None:
        """`zero` writes zero volts even during a play, which counts for nothing then; again too."""
        output, channel = self.loop
        wave = self._loud(1000)
        with daq.stream([channel], self.rate_hz, 20, 1000, {output: wave}) as stream:
            blocks = iter(stream)
            next(blocks)
            self.in_time(daq.zero)
            self.in_time(daq.zero)
            with refused(InstrumentError):
                self.in_time(lambda: list(blocks))
        self._rests(daq)

    @pytest.mark.requires("outputs", "loop", "reopen")
    def test_opening_changes_no_output(self, daq: Daq) -> None:
        """Another driver that is opened and closed leaves what an output holds as it is."""
        output, channel = self.loop
        held = self.played
        with daq.stream([channel], self.rate_hz, 50, play={output: np.full(50, held)}) as stream:
            blocks = iter(stream)
            list(islice(blocks, 2))
            self.reopen().close()
            volts = next(blocks).volts[0]
        assert volts == pytest.approx(self.loop_gain * held, abs=self.tolerance)

    # Leaving

    def test_zero_may_be_called_at_any_time(self, daq: Daq) -> None:
        """`zero` is idempotent, and needs no stream."""
        self.in_time(daq.zero)
        self.in_time(daq.zero)

    @pytest.mark.requires("outputs", "loop")
    def test_outputs_that_are_held_play_and_rest(self, daq: Daq) -> None:
        """`hold` leaves zero volts; a stream plays on held outputs, and leaves them at zero and held."""
        output, channel = self.loop
        wave = self._wave(100)
        self.in_time(daq.hold)
        self.in_time(daq.hold)
        self._rests(daq)
        for _ in range(2):
            with daq.stream([channel], self.rate_hz, 25, 100, {output: wave}) as stream:
                assert self._lag(self.in_time(stream.capture).volts[0], wave) in (0, 1)
            self.in_time(daq.hold)
            self._rests(daq)
        self.in_time(daq.let_go)
        self.in_time(daq.let_go)
        self._rests(daq)

    def test_close_may_be_called_again(self, daq: Daq) -> None:
        """`close` is idempotent, also while a stream is open."""
        daq.stream(self.channels, self.rate_hz, 50, 50)
        self.in_time(daq.close)
        self.in_time(daq.close)

    def test_a_fault_is_one_error_in_time(self, daq: Daq, kind: str) -> None:
        """Misbehaving cards raise InstrumentError within the deadline, in one sentence.

        A lost sample is never silence, and never a shorter recording.
        """
        with self.fault(kind) as fault, refused(InstrumentError):

            def run() -> None:
                with daq.stream(self.channels, self.rate_hz, 50, 200) as stream:
                    stream.capture()

            self.in_time(run)
        assert fault.fired, f"the fault {kind!r} never fired"

    def _wave(self, samples: int) -> FloatArray:
        wave = np.random.default_rng(_SEED).uniform(-self.played, self.played, samples)
        if self.ac_coupled:
            wave -= wave.mean()
            wave *= self.played / np.abs(wave).max()
        return wave

    def _loud(self, samples: int) -> FloatArray:
        """The largest voltage, held; of alternating sign where a held one is lost."""
        return np.asarray(self.played * np.tile([1.0, -1.0 if self.ac_coupled else 1.0], samples // 2))

    def _lag(self, volts: FloatArray, wave: FloatArray) -> int:
        """Samples by which `wave` is late in `volts`; -1 when it is not found there.

        By correlation, because an amplifier in the loop may smooth it.
        """
        for lag in range(len(wave) // 2):
            if np.corrcoef(volts[lag:], wave[: len(wave) - lag])[0, 1] > _ALIKE:
                return lag
        return -1

    def _rests(self, daq: Daq) -> None:
        """The looped output is at zero volts."""
        if "loop" not in self.capabilities:
            return
        with daq.stream([self.loop[1]], self.rate_hz, 20, 20) as stream:
            volts = self.in_time(stream.capture).volts[0]
        # The first sample may fall on the very edge of the step.
        assert volts[1:] == pytest.approx(0, abs=self.tolerance)

    def _contiguous(self, blocks: Sequence[Block]) -> None:
        end = 0
        for block in blocks:
            assert block.first == end, f"a block begins at sample {block.first}, expected {end}"
            assert block.volts.shape[0] == len(self.channels) and block.volts.dtype == np.float64
            assert block.overload.shape == (len(self.channels),) and block.overload.dtype == np.bool_
            assert np.all(np.isfinite(block.volts))
            end = block.end
