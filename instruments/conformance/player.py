"""Promises of the player role."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pytest

from ...base.arrays import FloatArray
from ...base.clock import Clock, RealClock
from ...base.errors import InstrumentError, LimitError
from ..player import Player
from .suite import Conformance, bypass_interlock, one_sentence, refused


class _BodyError(Exception):
    """Error raised in the body of a play."""


class PlayerConformance(Conformance):
    """Give a fixture `player`: a driver that has just been opened, with nothing playing."""

    peak: ClassVar[float] = 0.5
    """V of a waveform that the player can play; ten thousand times as much is beyond it."""
    rate_hz: ClassVar[float] = 50_000.0
    """Rate of the waveforms that it is given."""
    optional: ClassVar = {
        "output": "give playing(), which says whether anything comes out now",
        "ac": "the output is AC-coupled: a waveform with a mean must be refused",
    }

    def clock(self) -> Clock:
        """The player's clock: let a play's time pass on it."""
        return RealClock()

    def playing(self) -> bool:
        """True when the output plays now, measured independently of the driver."""
        raise NotImplementedError

    @pytest.fixture(autouse=True)
    def _playing(self, _skip_what_is_not_offered: None, request: pytest.FixtureRequest) -> None:
        bypass_interlock(request.getfixturevalue("player"))

    def test_says_what_it_is(self, player: Player) -> None:
        """Identity and the amplifier input are named; `max_latency` is seconds, `declared` a sentence."""
        assert player.identity.strip() and "\n" not in player.identity
        assert player.output.strip()
        assert 0 <= player.max_latency <= 10, f"max_latency is {player.max_latency} s"
        if player.declared is not None:
            one_sentence(player.declared)

    def test_rendered_is_what_was_asked_for(self, player: Player) -> None:
        """`rendered` is finite volts, as long and as loud as the waveform, and leaves its argument alone."""
        volts = self._burst()
        before = volts.copy()
        out, rate_hz = player.rendered(volts, self.rate_hz)
        assert np.array_equal(volts, before)
        assert out.ndim == 1 and np.all(np.isfinite(out)) and 0 < rate_hz < np.inf
        assert len(out) / rate_hz >= len(volts) / self.rate_hz
        assert np.abs(out).max() == pytest.approx(self.peak, rel=0.05)
        energy = np.sum(out**2) / rate_hz
        assert energy == pytest.approx(np.sum(volts**2) / self.rate_hz, rel=0.05)

    @pytest.mark.parametrize("what", ["too many volts", "nan", "no samples"])
    def test_what_cannot_be_played_is_refused(self, player: Player, what: str) -> None:
        """`rendered` and `play` raise LimitError for what cannot be played: it is never clipped."""
        volts = {
            "too many volts": 1e4 * self._burst(),
            "nan": np.where(np.arange(len(self._burst())) == 100, np.nan, self._burst()),
            "no samples": np.zeros(0),
        }[what]
        self._refused(player, volts)

    @pytest.mark.requires("ac")
    def test_a_mean_is_refused(self, player: Player) -> None:
        """A waveform with a mean raises LimitError on an AC-coupled output."""
        self._refused(player, self._burst() + 0.3 * self.peak)

    def test_response_passes_no_more_than_all(self, player: Player) -> None:
        """`response` is complex, of the frequencies' shape, and never above 1."""
        frequencies = np.linspace(1, self.rate_hz / 4, 501)
        response = player.response(frequencies)
        assert response.shape == frequencies.shape and np.iscomplexobj(response)
        assert np.all(np.isfinite(response)) and np.abs(response).max() <= 1 + 1e-6

    def test_plays_whole_and_again(self, player: Player) -> None:
        """A play that is left to finish raises nothing; another one may follow."""
        for _ in range(2):
            volts = self._burst()

            def play(volts: FloatArray = volts) -> None:
                with player.play(volts, self.rate_hz):
                    self._wait_for(player, volts)

            self.in_time(play)
            self._silent()

    def test_a_play_that_is_cut_short_is_an_error(self, player: Player) -> None:
        """Leaving before the waveform has been played whole is an InstrumentError, and it stops."""
        with refused(InstrumentError), player.play(self._burst(), self.rate_hz):
            pass
        self._silent()

    def test_an_error_of_the_body_counts(self, player: Player) -> None:
        """When the body raises, it stops at once, and the body's error is raised."""
        with pytest.raises(_BodyError), player.play(self._burst(), self.rate_hz):
            raise _BodyError
        self._silent()

    def test_stop_ends_a_play(self, player: Player) -> None:
        """`stop` reaches the safe state, and may be called again; the play was then not whole."""
        volts = self._burst()
        with refused(InstrumentError), player.play(volts, self.rate_hz):
            for _ in range(2):
                self.in_time(player.stop)
            self._silent()
            self._wait_for(player, volts)
        self._silent()

    def test_close_may_be_called_again(self, player: Player) -> None:
        """`close` is idempotent."""
        player.close()
        player.close()
        self._silent()

    def test_a_fault_is_one_error_in_time(self, player: Player, kind: str) -> None:
        """A misbehaving player raises InstrumentError within the deadline; the play is never complete."""
        volts = self._burst()

        def play() -> None:
            with player.play(volts, self.rate_hz):
                self._wait_for(player, volts)

        with self.fault(kind) as fault, refused(InstrumentError):
            self.in_time(play)
        assert fault.fired, f"the fault {kind!r} never fired"

    def _burst(self) -> FloatArray:
        """A fifth of a second at 200 Hz, at rest at both ends and without a mean."""
        t = np.arange(round(0.2 * self.rate_hz)) / self.rate_hz
        volts = np.sin(2 * np.pi * 200 * t) * np.sin(np.pi * t / 0.2) ** 2
        volts -= volts.mean()
        return np.asarray(self.peak * volts / np.abs(volts).max())

    def _wait_for(self, player: Player, volts: FloatArray) -> None:
        self.clock().sleep(player.max_latency + 1.1 * len(volts) / self.rate_hz)

    def _refused(self, player: Player, volts: FloatArray) -> None:
        with refused(LimitError):
            player.rendered(volts, self.rate_hz)
        with refused(LimitError), player.play(volts, self.rate_hz):
            pass
        self._silent()

    def _silent(self) -> None:
        if "output" in self.capabilities:
            assert not self.playing(), "something still comes out"
