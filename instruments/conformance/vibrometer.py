"""Promises of the vibrometer role."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pytest

from ...base.errors import InstrumentError
from ..vibrometer import DERIVATIVE, Vibrometer
from .suite import Conformance, one_sentence, refused


class VibrometerConformance(Conformance):
    """Give a fixture `vibrometer`: a driver that has just been opened."""

    optional: ClassVar = {
        "reopen": "give reopen(), which opens a second driver on the same instrument",
        "level": "the instrument reports its signal level",
    }

    def reopen(self) -> Vibrometer:
        """Return a second driver on the same instrument, opened as the first one was."""
        raise NotImplementedError

    def test_says_what_it_is(self, vibrometer: Vibrometer) -> None:
        """Identity and channel are named; range, scale, bandwidth and delay are SI numbers."""
        assert vibrometer.identity.strip() and "\n" not in vibrometer.identity
        assert vibrometer.channel.strip()
        for name in ("range", "scale", "bandwidth_hz"):
            value = getattr(vibrometer, name)
            assert np.isfinite(value) and value > 0, f"{name} is {value}"
        assert np.isfinite(vibrometer.delay) and 0 <= vibrometer.delay < 1

    def test_what_only_a_person_can_check_is_a_sentence(self, vibrometer: Vibrometer) -> None:
        """`declared` is None, or a sentence that an operator can answer."""
        if vibrometer.declared is not None:
            one_sentence(vibrometer.declared)

    def test_range_and_scale_belong_together(self, vibrometer: Vibrometer) -> None:
        """Full scale is a voltage that an output has: both are in SI units, not mm/s in one of them."""
        volts = vibrometer.range / vibrometer.scale
        assert 0.1 <= volts <= 50, f"full scale would be {volts:g} V: are both in SI units?"

    def test_volts_become_metres_per_second(self, vibrometer: Vibrometer) -> None:
        """`to_si` multiplies by the scale what lies above `zero`, and keeps shape and argument."""
        for shape in ((), (7,), (2, 5)):
            volts = np.full(shape, 0.25)
            velocity = vibrometer.to_si(volts)
            assert np.shape(velocity) == shape
            assert np.allclose(velocity, (0.25 - vibrometer.zero) * vibrometer.scale)
            assert np.all(volts == 0.25)

    def test_response_is_that_of_its_bandwidth_and_delay(self, vibrometer: Vibrometer) -> None:
        """`response` is 1 at low frequencies, 3 dB down at the bandwidth, never above 1, and late by `delay`.

        That of a pick-up of displacement or acceleration is so besides its j omega, and one with a high-pass
        from well above its corner on. All are finite and not zero, also at 0 Hz.
        """
        corner = vibrometer.bandwidth_hz
        low = 100 * vibrometer.high_pass_hz
        frequencies = np.linspace(low, corner, 1001)
        turned = 2j * np.pi * np.where(frequencies == 0, 1.0, frequencies)
        response = vibrometer.response(frequencies)
        assert response.shape == frequencies.shape and np.iscomplexobj(response)
        assert np.isfinite(vibrometer.response(np.zeros(1))).all() and vibrometer.response(np.zeros(1)).all()
        response = response / turned ** DERIVATIVE[vibrometer.quantity]
        assert abs(response[0]) == pytest.approx(1, abs=1e-3 + (low / corner) ** 2)
        assert np.abs(response).max() <= 1 + 1e-6
        assert abs(response[-1]) == pytest.approx(np.sqrt(0.5), rel=0.1)
        step = 1e-4 * min(corner, 1 / max(vibrometer.delay, 1e-12))
        if low:
            return  # its high-pass turns the phase there by more than a delay does
        turn = (2j * np.pi * step) ** DERIVATIVE[vibrometer.quantity]
        late = -np.angle(vibrometer.response(np.array([step])) / turn)[0] / (2 * np.pi * step)
        assert vibrometer.delay * 0.99 <= late <= vibrometer.delay + 1 / corner

    def test_signal_level_is_a_share(self, vibrometer: Vibrometer) -> None:
        """`signal_level` is None, or from 0 to 1."""
        level = self.in_time(vibrometer.signal_level)
        assert level is None or 0 <= level <= 1

    @pytest.mark.requires("level")
    def test_reports_its_signal_level(self, vibrometer: Vibrometer) -> None:
        """An instrument with this capability reports its signal level."""
        assert self.in_time(vibrometer.signal_level) is not None

    @pytest.mark.requires("reopen")
    def test_opening_changes_no_setting(self, vibrometer: Vibrometer) -> None:
        """Opening the driver changes no setting: a second one reads the same values."""
        names = ("identity", "channel", "range", "scale", "bandwidth_hz", "delay", "declared")
        other = self.reopen()
        assert [getattr(other, n) for n in names] == [getattr(vibrometer, n) for n in names]
        other.close()

    def test_close_may_be_called_again(self, vibrometer: Vibrometer) -> None:
        """`close` is idempotent; values that were read stay available."""
        scale = vibrometer.scale
        vibrometer.close()
        vibrometer.close()
        assert vibrometer.scale == scale

    def test_a_fault_is_one_error_in_time(self, vibrometer: Vibrometer, kind: str) -> None:
        """A misbehaving instrument raises InstrumentError within the deadline, in one sentence.

        Its answer is never taken for a signal level.
        """
        with self.fault(kind) as fault, refused(InstrumentError):
            self.in_time(vibrometer.signal_level)
        assert fault.fired, f"the fault {kind!r} never fired"
