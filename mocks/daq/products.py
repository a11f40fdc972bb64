"""Data of the NI cards and modules that can be simulated, and their conversion timing.

The products are rows of products.toml, each with its source; an estimate is typical of such a card, to be
replaced by the data sheet of the lab's own card.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal, get_args

from ...instruments.errors import ConfigurationError

__all__ = ["PRODUCTS", "Product", "convert_interval", "input_range"]

Family = Literal["E Series", "M Series", "X Series", "C Series", "Digital I/O", "CompactDAQ Chassis"]

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
    source: str = "estimate"
    """Where the figures are from; "estimate" where none of them was found."""
    estimates: tuple[str, ...] = ()
    """Fields whose figures are estimates though the row has a source."""


def _read(text: str) -> dict[str, Product]:
    """Return the products that a table in TOML describes, by name.

    Raises ConfigurationError with one sentence that names the product and what is missing or wrong.
    """
    rows: dict[str, dict[str, Any]] = tomllib.loads(text)
    products: dict[str, Product] = {}
    for name, row in rows.items():
        figures = dict(row)
        like = figures.pop("like", None)
        if like is not None and like not in rows:
            raise ConfigurationError(f"The product {name!r} is like {like!r}, which is not in the table.")
        taken = {key: value for key, value in rows.get(like, {}).items() if key not in _OWN}
        figures = taken | figures
        unknown = figures.keys() - _FIELDS
        missing = [key for key in ("family", "source") if key not in figures]
        missing += [key for key in _ASKED["ai"] if _inputs(figures) and key not in figures]
        missing += [key for key in _ASKED["ao"] if figures.get("ao_channels") and key not in figures]
        if unknown or missing:
            wrong = [f"has unknown fields: {', '.join(sorted(unknown))}"] if unknown else []
            wrong += [f"lacks: {', '.join(missing)}"] if missing else []
            raise ConfigurationError(f"The product {name!r} {' and '.join(wrong)}.")
        if figures["family"] not in get_args(Family):
            families = ", ".join(get_args(Family))
            raise ConfigurationError(
                f"The product {name!r} is of the family {figures['family']!r}; there are {families}."
            )
        lists = {key: tuple(value) for key, value in figures.items() if isinstance(value, list)}
        products[name] = Product(name=name, **(figures | lists))
    return products


def _inputs(figures: dict[str, Any]) -> bool:
    return bool(figures.get("ai_single_ended") or figures.get("ai_differential"))


_OWN = ("like", "source", "estimates", "number")
"""Fields that a row does not take from the row that it is like."""

_FIELDS = {item.name for item in fields(Product)} - {"name"}

_ASKED = {"ai": ("ai_ranges", "ai_rate_hz", "ai_rate_single_hz"), "ao": ("ao_range", "ao_rate_hz")}
"""Fields that a product with analog inputs, and one with analog outputs, cannot be without."""

PRODUCTS: dict[str, Product] = _read(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
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
