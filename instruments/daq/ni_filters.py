"""Delays of the digital filters of NI's delta-sigma inputs, which no property of the driver tells for all.

A sample is of a time before its clock edge: a filter of n samples needs as many after it (NI-DAQmx, "Alias
Rejection"). A module's figure is in its data sheet as "input delay"; docs/hardware.md says where each is
from.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Filter:
    """Delay of a converter's filter."""

    samples: float
    seconds: float = 0.0
    """Part that does not depend on the rate."""


_C_SERIES = 40 + 5 / 512
"""Samples of the filter of C Series modules of this kind."""
FILTERS: dict[str, Filter] = {
    "NI 9229": Filter(_C_SERIES, 3.3e-6),
    "NI 9230": Filter(32.0, 2.6e-6),
    "NI 9234": Filter(_C_SERIES, 2.6e-6),
    "NI 9237": Filter(_C_SERIES, 4.5e-6),
    "NI 9239": Filter(_C_SERIES, 3.3e-6),
    "NI 9250": Filter(32.0),
    "USB-4431": Filter(62.0),
    "PXI-4461": Filter(63.0),
    "PXI-4462": Filter(63.0),
    "PXIe-4464": Filter(63.0),
    "PXIe-4466": Filter(63.0),
    "PXIe-4480": Filter(63.0),
    "PXIe-4331": Filter(38.0),
}
"""Filters by product."""


def filter_delay(product: str, rate_hz: float) -> float:
    """Return the delay of a product's input filter at a sample rate (s); 0 for a product without one."""
    own = FILTERS.get(product)
    return 0.0 if own is None else own.samples / rate_hz + own.seconds
