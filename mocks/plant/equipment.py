"""Relays and laser heads, as the plant sees them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from ...instruments.vibrometer import Quantity

Switched = tuple[str, bool, float]
"""A patch, True when its contact closed or False when it opened, and the time (s)."""


class Switches(Protocol):
    """A box of relays, as the plant sees it."""

    def take(self, until: float) -> Sequence[Switched]:
        """Return, once, each contact that switches as a result of events up to `until` (s)."""


@dataclass
class LaserHead:
    """Real state of a vibrometer's optics and decoder, which may differ from the rig file's."""

    range: float
    """Full scale (m/s, or SI of `quantity`), at which the output clips."""
    scale: float
    """Scale of the output (SI per V)."""
    bandwidth_hz: float
    delay: float
    """Delay of the output (s)."""
    level: float = 1.0
    """Fraction of the light that returns, 0 to 1; without light the output is noise only."""
    quantity: Quantity = "velocity"
    """What it shows; range and scale are in its SI unit."""
    high_pass_hz: float = 0.0
    """Corner of its high-pass (Hz); 0 without."""
    zero: float = 0.0
    """Its output at zero (V)."""
    mass: float = 0.0
    """Mass that is glued to the surface (kg)."""
