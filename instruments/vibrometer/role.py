"""The vibrometer role: the pick-up of the table's motion, with its scale, bandwidth and delay.

A laser shows velocity or displacement; an accelerometer that is glued to the table shows acceleration. What
is measured is brought to velocity in the frequency domain, by `response`: it holds the pick-up's filters, its
delay, and the derivative or integral between velocity and what the pick-up shows.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Literal, get_args

import numpy as np

from ...base.arrays import ComplexArray, FloatArray
from ...base.filters import first_order_low_pass

Quantity = Literal["velocity", "displacement", "acceleration"]
QUANTITIES: tuple[Quantity, ...] = get_args(Quantity)
UNITS: dict[Quantity, str] = {"velocity": "m/s", "displacement": "m", "acceleration": "m/s^2"}
_SMALL: dict[Quantity, tuple[float, str]] = {
    "velocity": (1e3, "mm/s"),
    "displacement": (1e6, "µm"),
    "acceleration": (1.0, "m/s²"),
}
"""Factor and unit in which a quantity is told to people."""
DERIVATIVE: dict[Quantity, int] = {"velocity": 0, "displacement": -1, "acceleration": 1}
"""Power of j omega from velocity to the quantity."""


class Vibrometer(ABC):
    """A pick-up of motion at one point, with an analog output. It has no unsafe state."""

    identity: str
    channel: str
    """Name of the DAQ channel that its output is wired to."""
    quantity: Quantity = "velocity"
    """What it shows."""
    range: float
    """Full scale (in `unit`)."""
    scale: float
    """Scale of its output (`unit` per V)."""
    zero: float = 0.0
    """Its output at zero (V), as a DC-coupled accelerometer has."""
    bandwidth_hz: float
    high_pass_hz: float = 0.0
    """Corner of a high-pass of one pole (Hz), as an accelerometer with a charge amplifier has; 0 without."""
    delay: float
    """Delay of the output (s)."""
    declared: str | None
    """Settings that only a person can check, as a sentence to confirm; None when they are read back."""
    mass: float = 0.0
    """Mass that it adds to the table where it measures (kg); 0 of a laser."""

    @property
    def unit(self) -> str:
        """SI unit of what it shows."""
        return UNITS[self.quantity]

    @abstractmethod
    def signal_level(self) -> float | None:
        """Fraction of full light that returns, 0 to 1; None where the product does not report it."""

    @abstractmethod
    def close(self) -> None:
        """Disconnect from the instrument. May be called again."""

    def to_si(self, volts: FloatArray) -> FloatArray:
        """Convert volts at the output to `unit`, in any shape."""
        return (volts - self.zero) * self.scale

    def response(self, frequencies: FloatArray) -> ComplexArray:
        """Response from the surface's velocity to `to_si`, at `frequencies` (Hz).

        No displacement or acceleration follows a velocity at 0 Hz: there the value is that at 1 Hz.
        """
        f = np.asarray(frequencies, dtype=np.float64)
        late = np.exp(-2j * np.pi * f * self.delay)
        found = first_order_low_pass(f, self.bandwidth_hz) * late
        turned = np.where(f == 0, 1.0, f)
        if self.high_pass_hz:
            found = found / (1 + self.high_pass_hz / (1j * turned))
        if self.quantity != "velocity":
            found = found * (2j * np.pi * turned) ** DERIVATIVE[self.quantity]
        return np.asarray(found)


def shown(quantity: Quantity, value: float) -> str:
    """A value of a quantity (SI) in the unit in which people say it: "20 mm/s"."""
    factor, unit = _SMALL[quantity]
    return f"{value * factor:.4g} {unit}"
