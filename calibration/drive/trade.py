"""The trade between loudness and likeness: what a drive is planned for."""

from __future__ import annotations

from dataclasses import dataclass

from ...instruments import ConfigurationError

__all__ = ["BUDGET", "TRADE", "Trade"]

BUDGET = 0.005
"""Error accepted in exchange for a larger output. Small, because unmodelled error (hysteresis is known to
some percent) adds to it, and learning needs spare volts to correct that; 3 % would raise the output by a
tenth."""


@dataclass(frozen=True)
class Trade:
    """How much error is accepted for output."""

    error: float | None = None
    """Expected error accepted for the largest output; None: 0.5 %. If that is not within reach, the least
    error is taken."""

    def __post_init__(self) -> None:
        """Raises ConfigurationError for a number that is none."""
        if self.error is not None and not 0 < self.error < 10:
            raise ConfigurationError(
                f"A drive cannot be planned for error = {self.error:g}: above 0 is needed."
            )


TRADE = Trade()
