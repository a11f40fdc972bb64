"""Data of the NI cards and modules that can be simulated, and their conversion timing.

The products are rows of products.toml, each with its source; an estimate is typical of such a card, to be
replaced by the data sheet of the lab's own card.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Literal, get_args

from pydantic import TypeAdapter, ValidationError

from ..base.entry_points import entries
from ..base.errors import ConfigurationError

Family = Literal[
    "E Series", "M Series", "X Series", "AO Series", "USB DAQ", "mioDAQ", "myDAQ", "DSA", "SC Express",
    "C Series", "TestScale", "Digital I/O", "CompactDAQ Chassis", "TestScale Chassis",
]  # fmt: skip
Configuration = Literal["rse", "nrse", "diff", "pseudodiff"]

TIMEBASE_HZ = {"E Series": 20e6, "M Series": 80e6, "X Series": 100e6, "Digital I/O": 100e6, "C Series": 80e6}
"""Timebase of the sample clocks, by family (X Series from its manual, others estimates)."""
PFI_LINES = {"E Series": 10, "AO Series": 10, "M Series": 16, "X Series": 16}
"""Number of PFI terminals by family (Linux, drivers/comedi/drivers/ni_mio_common.c; X Series manual 370784,
"PFI")."""
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
    """Number of differential inputs; where there are single-ended ones, i is paired with i + half a bank."""
    ai_bank: int = 16
    """Number of inputs in a bank, whose first half are the positive ends of differential inputs."""
    ai_names: tuple[str, ...] = ()
    """Names of the inputs; empty means ai0, ai1, and so on."""
    ai_configs: tuple[Configuration, ...] = ()
    """Terminal configurations; empty means all that follow from the numbers of inputs. The first that an
    input takes is its default."""
    ai_couplings: tuple[Literal["ac", "dc"], ...] = ("dc",)
    ai_excitation: tuple[float, ...] = ()
    """Currents of an IEPE supply (A); empty without one."""
    ai_bridge_excitation: tuple[float, ...] = ()
    """Voltages of a bridge's supply (V); empty without one."""
    ai_cjc: bool = False
    """True where thermocouples have a sensor of the cold junction."""
    ai_measures: tuple[str, ...] = ()
    """What the inputs measure, by NI's names (`UsageTypeAI`); empty means voltage and the like."""
    ai_timebase_hz: float = 0.0
    """Master timebase of a delta-sigma converter, which samples at this / 256 / n; 0 for any other."""
    ai_filter_samples: float = 0.0
    """Delay of the converters' digital filter (samples; docs/hardware.md, "delay of a digital filter")."""
    ai_filter_seconds: float = 0.0
    """What of it does not depend on the rate (s)."""
    ai_rate_least_hz: float = 0.0
    """Lowest sample rate; 0 for that of the timebase's divider."""
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
    """Noise in a range of +-10 V (V rms), scaled with the range (estimate)."""
    ai_fifo: int = 0
    """Size of the card's own input buffer (samples)."""
    ao_channels: int = 0
    ao_range: float = 0.0
    """Output range as +- full scale (V)."""
    ao_unipolar: bool = False
    """True when the outputs go from 0 V to `ao_range`."""
    ao_bits: int = 16
    ao_rate_hz: float = 0.0
    """Most updates per second; 0 where a program times them."""
    ao_fifo: int = 8191
    """Size of the card's own output buffer (samples; docs/hardware.md, "PCIe-6321 (X Series)")."""
    ports: tuple[int, ...] = ()
    """Number of digital lines of each port; only port 0 can be clocked."""
    port_ways: tuple[Literal["in", "out", "both"], ...] = ()
    """Direction of each port's lines; empty means both."""
    pfi: int | None = None
    """Number of PFI terminals, PFI0 and on, where they are not those of its family."""
    counters: int = 0
    counter_bits: int = 32
    slots: int = 0
    """Number of module slots of a chassis."""
    source: str = "estimate"
    """Where the figures are from; "estimate" where none of them was found."""
    estimates: tuple[str, ...] = ()
    """Fields whose figures are estimates though the row has a source."""

    @property
    def ends_late(self) -> bool:
        """True when a finite output on an external clock needs one pulse more than samples to be done.

        NI-DAQmx Device Considerations, "Timing Considerations" for E Series and AO Series devices.
        """
        return self.family in ("E Series", "AO Series")

    @property
    def pfi_lines(self) -> int | None:
        """Number of PFI terminals, PFI0 and on; None where it is not known."""
        return PFI_LINES.get(self.family) if self.pfi is None else self.pfi

    @property
    def puts_pulses(self) -> bool:
        """False where a counter counts edges only (USB-6008/6009 user guide, "Event Counter")."""
        return self.family != "USB DAQ"

    def pfi_way(self, number: int) -> Literal["in", "out", "both"]:
        """Direction of PFI terminal `number`.

        Where port 0 has inputs and port 1 outputs, PFI 0 to 3 and 8 to 11 are inputs, and the others outputs
        (NI-DAQmx Device Considerations, "Bus-Powered M Series Physical Channels").
        """
        if self.port_ways != ("in", "out"):
            return "both"
        return "out" if number // 4 % 2 else "in"

    @property
    def delta_sigma(self) -> bool:
        """True when the inputs have delta-sigma converters with a timebase, which give the rates."""
        return self.ai_timebase_hz > 0

    def configurations(self, channel: int) -> tuple[Configuration, ...]:
        """Terminal configurations that input `channel` takes, its default first."""
        paired = not self.ai_single_ended or channel % self.ai_bank < self.ai_bank // 2
        listed: tuple[Configuration, ...] = self.ai_configs or (
            ("diff",) if not self.ai_single_ended else ("diff", "rse", "nrse")
        )
        return tuple(config for config in listed if paired or config != "diff")

    def filter_delay(self, rate_hz: float) -> float:
        """Return the delay of the inputs' digital filter at a sample rate (s); 0 without one."""
        return self.ai_filter_samples / rate_hz + self.ai_filter_seconds

    @property
    def clock_hz(self) -> float:
        """Frequency of the timebase that its sample clocks divide."""
        return TIMEBASE_HZ.get(self.family, 100e6)

    def sample_rate(self, asked: float) -> float:
        """Sample rate that a delta-sigma converter takes for one that is asked: the next higher of its own.

        NI knowledge base, "Calculate the Input Delay on NI-9237", and kA00Z000000P6FrSAK. Any other takes
        what is asked.
        """
        if not self.delta_sigma:
            return asked
        fastest = self.ai_timebase_hz / 256
        divisor = int(fastest / asked * (1 + 1e-9))
        if self.ai_rate_least_hz:
            divisor = min(divisor, round(fastest / self.ai_rate_least_hz))
        return fastest / max(1, divisor)


def _read(
    rows: Mapping[str, Mapping[str, Any]], others: Mapping[str, Mapping[str, Any]]
) -> dict[str, Product]:
    """Return the products that `rows` describe, by name; a row can be like one of `others`.

    Raises ConfigurationError with one sentence that names the product and what is missing or wrong.
    """
    products: dict[str, Product] = {}
    for name, row in rows.items():
        figures = dict(row)
        like = figures.pop("like", None)
        model = rows.get(like) or others.get(like, {})
        if like is not None and not model:
            raise ConfigurationError(f"The product {name!r} is like {like!r}, which is not in the table.")
        if "like" in model:
            raise ConfigurationError(f"The product {name!r} is like {like!r}, which is like another itself.")
        figures = {key: value for key, value in model.items() if key not in _OWN} | figures
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
        products[name] = _checked(Product(name=name, **(figures | lists)))
    return products


def _checked(product: Product) -> Product:
    """Return `product`. Raises ConfigurationError for a figure of a wrong kind."""
    try:
        return _KIND.validate_python(asdict(product), strict=False)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise ConfigurationError(f"The product {product.name!r}: {where}: {first['msg']}.") from None


def _inputs(figures: dict[str, Any]) -> bool:
    return bool(figures.get("ai_single_ended") or figures.get("ai_differential"))


_OWN = ("like", "source", "estimates", "number")
"""Fields that a row does not take from the row that it is like."""

_FIELDS = {item.name for item in fields(Product)} - {"name"}

_ASKED = {"ai": ("ai_ranges", "ai_rate_hz", "ai_rate_single_hz"), "ao": ("ao_range", "ao_rate_hz")}
"""Fields that a product with analog inputs, and one with analog outputs, cannot be without."""

_KIND = TypeAdapter(Product)
_TABLE: dict[str, dict[str, Any]] = tomllib.loads(
    Path(__file__).with_suffix(".toml").read_text(encoding="utf-8")
)

PRODUCTS: dict[str, Product] = _read(_TABLE, {})
"""Products that twin and wire simulate, by the driver's names."""


def described(rows: Mapping[str, Mapping[str, Any]]) -> dict[str, Product]:
    """Return the products that `rows` describe, in the form of the table, and those of other packages and the
    table; the first of these that has a name counts.

    A package adds products by an entry point of the group `haploop.ni_products`: a mapping of such rows.
    Raises ConfigurationError with one sentence that names the product and what is missing or wrong.
    """
    found = dict(PRODUCTS)
    for entry in entries("haploop.ni_products"):
        found |= _read(entry.load(), _TABLE)
    return found | _read(rows, _TABLE)


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
