"""Which cards are asked for: by options, by an export of NI MAX, by a bench."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from ...base.errors import ConfigurationError
from .file import Bench


def devices_of(named: Sequence[str], export: Path | None, bench: Bench | None) -> Mapping[str, str] | Path:
    """Return the product of each device that `named` ("Dev1=PCIe-6363") and a bench name, or the export.

    Raises ConfigurationError for what names no product, for a device that is named twice, and where an export
    and others name devices.
    """
    pairs = [name.partition("=")[::2] for name in named]
    if not all(name and product for name, product in pairs):
        raise ConfigurationError("--device takes NAME=PRODUCT: --device Dev1=PCIe-6363.")
    names = [*(name for name, _ in pairs), *(bench.devices if bench is not None else ())]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise ConfigurationError(f"{twice} is in --device or in the bench twice: name each device once.")
    if export is not None and names:
        raise ConfigurationError(
            "--devices names all devices: leave out --device, and [devices] of the bench."
        )
    return export or {**(bench.devices if bench is not None else {}), **dict(pairs)}
