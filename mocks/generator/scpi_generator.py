"""Twins and wires of the SCPI generators: a simulated box, reached by calls or over TCP."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from ...instruments.generator.scpi_generator import Dg1000z, Keysight33500, ScpiGenerator
from ..transport import DirectLine, LineServer
from .box import Box, Input
from .headers import DG1000Z, KEYSIGHT_33500, Product


def keysight(settings: ScpiGenerator.Settings, plant: Input) -> Keysight33500:
    """Create the twin of a 33500: the real driver's class, connected to a box by calls."""
    return Keysight33500(
        settings, plant.clock, DirectLine(Box(KEYSIGHT_33500, plant, settings.output).answer)
    )


def dg1000z(settings: ScpiGenerator.Settings, plant: Input) -> Dg1000z:
    """Create the twin of a DG1000Z: the real driver's class, connected to a box by calls."""
    return Dg1000z(settings, plant.clock, DirectLine(Box(DG1000Z, plant, settings.output).answer))


@contextmanager
def keysight_wire(settings: ScpiGenerator.Settings, plant: Input) -> Iterator[dict[str, object]]:
    """Serve a 33500; yield the settings that point the driver at it."""
    yield from _served(KEYSIGHT_33500, settings, plant)


@contextmanager
def dg1000z_wire(settings: ScpiGenerator.Settings, plant: Input) -> Iterator[dict[str, object]]:
    """Serve a DG1000Z; yield the settings that point the driver at it."""
    yield from _served(DG1000Z, settings, plant)


def _served(product: Product, settings: ScpiGenerator.Settings, plant: Input) -> Iterator[dict[str, object]]:
    with LineServer(Box(product, plant, settings.output).answer) as server:
        yield {"resource": f"TCPIP::127.0.0.1::{server.port}::SOCKET", "visa": "@py"}
