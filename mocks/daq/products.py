"""Data of the NI cards and modules that can be simulated, and their conversion timing.

Each figure is from docs/hardware.md, "NI cards" and "Conversion timing", unless it is marked as an
estimate: an estimate is typical of such a card, to be replaced by the data sheet of the lab's own card.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ...instruments.arrays import FloatArray

__all__ = ["PRODUCTS", "Product", "code_width", "convert_interval", "input_range"]

Family = Literal["E Series", "X Series", "C Series", "Digital I/O", "CompactDAQ Chassis"]

_PADDING = 10e-6
"""Padding that the driver adds between two channels of a multiplexed card (s; docs/hardware.md, "Conversion
timing")."""


@dataclass(frozen=True)
class Product:
    """Terminals and converters of one product. Zero means that it has none."""

    name: str
    family: Family
    number: int = 0
    """Product number that the driver reports; 0 if unknown."""
    ai_single_ended: int = 0
    """Number of single-ended analog inputs."""
    ai_differential: int = 0
    """Number of differential inputs; on a multiplexed card i is paired with i + 8 in each bank of 16."""
    ai_ranges: tuple[float, ...] = ()
    """Input ranges as +- full scale (V), widest first."""
    ai_bits: int = 16
    ai_rate_hz: float = 0.0
    """Conversions per second: of all channels together on a multiplexed card, else of each channel."""
    ai_rate_single_hz: float = 0.0
    """Conversions per second when only one channel is read."""
    ai_simultaneous: bool = False
    """True when each channel has its own converter."""
    ai_noise: float = 0.0
    """Noise in a range of +-10 V (V rms), scaled with the range (docs/hardware.md, "All NI cards")."""
    ai_fifo: int = 0
    """Size of the card's own input buffer (samples)."""
    ao_channels: int = 0
    ao_range: float = 0.0
    """Output range as +- full scale (V)."""
    ao_unipolar: bool = False
    """True when the outputs go from 0 V to `ao_range`."""
    ao_bits: int = 16
    ao_rate_hz: float = 0.0
    ao_fifo: int = 8191
    """Size of the card's own output buffer (samples; docs/hardware.md, "PCIe-6321 (X Series)")."""
    ports: tuple[int, ...] = ()
    """Number of digital lines of each port; only port 0 can be clocked."""
    counters: int = 0
    counter_bits: int = 32
    slots: int = 0
    """Number of module slots of a chassis."""


PRODUCTS: dict[str, Product] = {
    product.name: product
    for product in (
        Product(
            name="PCI-6034E",
            family="E Series",
            number=0x2CA0,
            ai_single_ended=16,
            ai_differential=8,
            ai_ranges=(10.0, 5.0, 0.5, 0.05),  # The gain table is known; the ranges are estimates.
            ai_rate_hz=200e3,
            ai_rate_single_hz=200e3,
            ai_noise=0.24e-3,  # estimate
            ai_fifo=512,
            ports=(8,),
            counters=2,  # estimate
            counter_bits=24,  # estimate
        ),
        Product(
            name="PCIe-6321",
            family="X Series",
            ai_single_ended=16,  # estimate
            ai_differential=8,  # estimate
            ai_ranges=(10.0, 5.0, 1.0, 0.2),  # estimate
            ai_rate_hz=250e3,
            ai_rate_single_hz=250e3,
            ai_noise=0.28e-3,  # estimate
            ai_fifo=4095,  # estimate
            ao_channels=2,
            ao_range=10.0,  # estimate
            ao_rate_hz=900e3,  # estimate
            ports=(8, 8, 8),  # estimate
            counters=4,
        ),
        Product(  # all estimates except the family's timing rules (docs/hardware.md, "Other NI products")
            name="PCIe-6363",
            family="X Series",
            ai_single_ended=32,
            ai_differential=16,
            ai_ranges=(10.0, 5.0, 2.0, 1.0, 0.5, 0.2, 0.1),
            ai_rate_hz=1e6,
            ai_rate_single_hz=2e6,
            ai_noise=0.3e-3,
            ai_fifo=2047,
            ao_channels=4,
            ao_range=10.0,
            ao_rate_hz=2.86e6,
            ports=(32, 8, 8),
            counters=4,
        ),
        Product(  # all estimates
            name="NI 9215",
            family="C Series",
            ai_differential=4,
            ai_ranges=(10.0,),
            ai_rate_hz=100e3,
            ai_rate_single_hz=100e3,
            ai_simultaneous=True,
            ai_noise=0.37e-3,
            ai_fifo=127,
        ),
        Product(  # all estimates
            name="NI 9775",
            family="C Series",
            ai_differential=4,
            ai_ranges=(10.0,),
            ai_bits=14,
            ai_rate_hz=20e6,
            ai_rate_single_hz=20e6,
            ai_simultaneous=True,
            ai_noise=1.5e-3,
            ai_fifo=127,
        ),
        Product(  # all estimates
            name="NI 9205",
            family="C Series",
            ai_single_ended=32,
            ai_differential=16,
            ai_ranges=(10.0, 5.0, 1.0, 0.2),
            ai_rate_hz=250e3,
            ai_rate_single_hz=250e3,
            ai_noise=0.24e-3,
            ai_fifo=1023,
        ),
        Product(  # all estimates
            name="NI 9263",
            family="C Series",
            ao_channels=4,
            ao_range=10.0,
            ao_rate_hz=100e3,
        ),
        # From here on: docs/hardware.md, "Other NI products". The counters of an NI 9401 are its chassis's.
        Product(name="NI 9401", family="C Series", ports=(8,), counters=4),
        Product(name="PCIe-6535", family="Digital I/O", ports=(8, 8, 8, 8)),
        Product(name="cDAQ-9174", family="CompactDAQ Chassis", slots=4, counters=4),
        Product(name="cDAQ-9178", family="CompactDAQ Chassis", slots=8, counters=4),
        Product(name="cDAQ-9185", family="CompactDAQ Chassis", slots=4, counters=4),
        Product(name="cDAQ-9189", family="CompactDAQ Chassis", slots=8, counters=4),
    )
}
"""Products that twin and wire simulate, by the driver's names."""


def convert_interval(product: Product, rate_hz: float, channels: int) -> float:
    """Return the interval between the conversions of two neighbouring channels of one scan (s).

    On a multiplexed card it is the shortest conversion time plus 10 us of padding, or an even division of
    the sample period if that is shorter (docs/hardware.md, "Conversion timing"). A single channel has no
    padding; a simultaneous card converts all channels at once.
    """
    if product.ai_simultaneous:
        return 0.0
    if channels <= 1:
        return 1 / product.ai_rate_single_hz
    fastest = 1 / product.ai_rate_hz
    return max(fastest, min(fastest + _PADDING, 1 / (rate_hz * channels)))


def input_range(product: Product, full_scale: float) -> float | None:
    """Return the narrowest input range (+- V) that contains +-`full_scale`, or None."""
    return min((r for r in product.ai_ranges if r >= full_scale * (1 - 1e-9)), default=None)


def code_width(product: Product, full_scale: FloatArray) -> FloatArray:
    """Return the volts per code of input ranges of +-`full_scale` (V, any shape)."""
    return full_scale / 2.0 ** (product.ai_bits - 1)
