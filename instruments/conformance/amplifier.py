"""Promises of the amplifier role."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from ...base.errors import LimitError
from ..amplifier import Amplifier
from .suite import Conformance, refused


class AmplifierConformance(Conformance):
    """Give a fixture `amplifier`."""

    def test_says_what_it_is(self, amplifier: Amplifier) -> None:
        """Identity and the output, or the outputs by patch, that feed it are named."""
        assert amplifier.identity.strip() and "\n" not in amplifier.identity
        assert amplifier.input.strip() or all(name.strip() for name in amplifier.inputs.values())
        assert bool(amplifier.input) != bool(amplifier.inputs)

    def test_limits_the_voltage_about_zero(self, amplifier: Amplifier) -> None:
        """Its limits are finite volts with zero, the safe state, between them."""
        limits = amplifier.limits(1)
        assert -np.inf < limits.min <= 0 < limits.max < np.inf

    def test_more_patches_never_widen_a_limit(self, amplifier: Amplifier) -> None:
        """Several patches in parallel ask for more current: no limit grows with them."""
        one, four = amplifier.limits(1), amplifier.limits(4)
        for field in (f for f in fields(one) if f.name != "coil"):  # the actuator's
            ratio = getattr(one, field.name), getattr(four, field.name)
            wider = ratio[1] < ratio[0] if field.name in ("min", "capacitance") else ratio[1] > ratio[0]
            assert not wider, f"{field.name} is {ratio[0]:g} for one patch and {ratio[1]:g} for four"

    def test_refuses_what_is_beyond_its_limits(self, amplifier: Amplifier) -> None:
        """A drive beyond the limits, or one that is not finite, is a LimitError."""
        limits = amplifier.limits(1)
        for peak in (1.01 * limits.max, 1.01 * limits.min - 1e-3, np.nan, np.inf):
            drive = np.zeros(100)
            drive[50] = peak
            with refused(LimitError):
                limits.check(drive, 1000.0)

    def test_input_is_the_drive_over_the_gain(self, amplifier: Amplifier) -> None:
        """`to_input` is linear with a gain that is not zero, so zero drive is zero input; shape is kept."""
        drive = np.linspace(-1, 1, 101)
        before = drive.copy()
        volts = amplifier.to_input(drive)
        assert volts.shape == drive.shape
        assert np.array_equal(drive, before), "the drive itself was changed"
        gain = 1 / amplifier.to_input(np.ones(1))[0]
        assert np.isfinite(gain) and gain != 0
        assert np.allclose(volts * gain, drive)
        assert amplifier.to_input(np.zeros(3)).tolist() == [0, 0, 0]

    def test_input_stays_within_a_dac(self, amplifier: Amplifier) -> None:
        """The volts of its limits come from an input of 10 V or less: a gain, not its inverse."""
        limits = amplifier.limits(1)
        volts = amplifier.to_input(np.array([limits.min, limits.max]))
        assert np.abs(volts).max() <= 10.5
