"""Promises of the generator role."""

from __future__ import annotations

import math
from functools import partial
from typing import ClassVar

import pytest

from ...base.errors import ConfigurationError, InstrumentError, LimitError
from ..generator import Burst, Generator, Sweep, Waveform
from .suite import Conformance, bypass_interlock, refused


class _Unknown(Sweep):
    """A kind of waveform that no driver knows."""


class GeneratorConformance(Conformance):
    """Give a fixture `generator`: a driver that has just been opened, its output off."""

    waveforms: ClassVar[tuple[Waveform, ...]] = (
        Sweep(start_hz=1, stop_hz=625, duration=2, amplitude=0.5),
        Burst(frequency_hz=263.5, cycles=20, amplitude=0.4),
    )
    """Waveforms that the generator can play, one of each kind."""
    optional: ClassVar = {"reopen": "give reopen(), which opens a second driver on the same generator"}

    def reopen(self) -> Generator:
        """Return a second driver on the same generator, opened as the first one was."""
        raise NotImplementedError

    @pytest.fixture(autouse=True)
    def _playing(self, _skip_what_is_not_offered: None, request: pytest.FixtureRequest) -> None:
        bypass_interlock(request.getfixturevalue("generator"))

    def test_says_what_it_is(self, generator: Generator) -> None:
        """Identity and the amplifier input it feeds are named, and its load is above zero."""
        assert generator.identity.strip() and "\n" not in generator.identity
        assert generator.output.strip()
        assert generator.load > 0

    def test_configuring_leaves_the_output_off(self, generator: Generator) -> None:
        """`configure` and `arm` set each waveform with the output off, and it is read back."""
        for waveform in self.waveforms:
            self.in_time(partial(generator.configure, waveform))
            assert not generator.is_on
            assert generator.amplitude == pytest.approx(waveform.amplitude, rel=1e-3)
            self.in_time(generator.arm)
            assert not generator.is_on

    def test_plays_only_when_triggered_and_stops(self, generator: Generator) -> None:
        """`trigger` switches the output on; `off` reaches the safe state, and may be called again."""
        for waveform in self.waveforms:
            generator.configure(waveform)
            generator.arm()
            self.in_time(generator.trigger)
            assert generator.is_on
            for _ in range(2):
                self.in_time(generator.off)
                assert not generator.is_on

    def test_a_kind_of_waveform_that_it_does_not_play_is_refused(self, generator: Generator) -> None:
        """A waveform of an unknown kind is a ConfigurationError that names it, and nothing is switched on."""
        with refused(ConfigurationError, naming="_Unknown"):
            generator.configure(_Unknown(1, 625, 2, 0.5))
        assert not generator.is_on
        with refused(ConfigurationError):
            generator.arm()

    def test_nothing_is_armed_or_triggered_out_of_order(self, generator: Generator) -> None:
        """`arm` without a waveform and `trigger` without arming are ConfigurationErrors, output off."""
        with refused(ConfigurationError):
            generator.arm()
        with refused(ConfigurationError):
            generator.trigger()
        generator.configure(self.waveforms[0])
        with refused(ConfigurationError):
            generator.trigger()
        assert not generator.is_on

    def test_too_many_volts_are_refused(self, generator: Generator) -> None:
        """More volts than are allowed is a LimitError, nothing is set, and nothing is played after it."""
        for waveform in self.waveforms:
            generator.configure(waveform)
            with refused(LimitError):
                generator.configure(waveform.scaled(1e6))
            assert generator.amplitude == pytest.approx(waveform.amplitude, rel=1e-3)
            with refused(ConfigurationError):
                generator.arm()
                generator.trigger()
            assert not generator.is_on

    def test_errors_are_taken_out_of_the_queue(self, generator: Generator) -> None:
        """`errors` empties the generator's own queue; a healthy one's is empty."""
        self.in_time(generator.errors)
        assert self.in_time(generator.errors) == ()

    @pytest.mark.requires("reopen")
    def test_opening_and_closing_change_nothing(self, generator: Generator) -> None:
        """Opening or closing another driver leaves the waveform that plays as it is."""
        generator.configure(self.waveforms[0])
        generator.arm()
        generator.trigger()
        load = generator.load
        other = self.reopen()
        assert other.is_on
        other.close()
        assert generator.is_on
        assert generator.load == load or (math.isinf(load) and math.isinf(generator.load))
        generator.off()

    def test_close_may_be_called_again(self, generator: Generator) -> None:
        """`close` is idempotent."""
        generator.close()
        generator.close()

    def test_a_fault_is_one_error_in_time(self, generator: Generator, kind: str) -> None:
        """A misbehaving generator raises InstrumentError within the deadline, in one sentence."""
        with self.fault(kind) as fault, refused(InstrumentError):
            self.in_time(lambda: generator.configure(self.waveforms[0]))
        assert fault.fired, f"the fault {kind!r} never fired"
