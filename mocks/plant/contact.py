"""A body that rests on a surface: a mass behind a spring and a damper, at one place."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Contact:
    """See the module. Its force on the surface is stiffness x (u - x) + damping x (u' - x').

    u is the surface's displacement, x the body's, both from where they rest.
    """

    name: str
    """Which body it is: one that stays, with another stiffness, goes on moving as it did."""
    place: tuple[float, float]
    """Fractions of the surface's width and height."""
    stiffness: float
    """N/m."""
    damping: float
    """N s/m."""
    mass: float
    """kg."""
