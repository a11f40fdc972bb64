"""The trade between loudness and likeness: what a drive is planned for."""

from __future__ import annotations

from dataclasses import dataclass

from ...base.errors import ConfigurationError
from ..model import Drift
from .actuation import Actuation

STEADY = Drift(common=0.0, own=0.0, damping=0.0, gain=0.0, delay=0.0)
"""A table that does not drift."""
BUDGET = 0.005
"""Error accepted in exchange for a larger output. Small, because unmodelled error (hysteresis is known to
some percent) adds to it, and learning needs spare volts to correct that; 3 % would raise the output by a
tenth."""
_MOST = 10.0
_DRIFTED = 0.06
"""The same of a table that has drifted by 1 %: of simulated tables with four patches, the least is 4 to 6 %,
at the loudness of one patch or twice that."""


@dataclass(frozen=True)
class Trade:
    """How much error is accepted for output, and the drift that is planned against."""

    error: float | None = None
    """Expected error accepted for the largest output, drift included; None: 0.5 %, or 6 % with a drift. If
    that is not within reach, the least error is taken."""
    scale: float | None = None
    """Scale at which the press is played, over its recorded size, with the least error."""
    drift: Drift | None = None
    """None: `Drift()` with more patches than points. Else none, because nothing is left to choose between:
    one patch buys little steadiness with much error."""

    def __post_init__(self) -> None:
        """Raises ConfigurationError for an error or a scale that no drive has."""
        for name, value in (("error", self.error), ("scale", self.scale)):
            if value is not None:
                object.__setattr__(self, name, float(value))  # a file knows no numpy numbers
            if value is not None and not 0 < value < _MOST:
                raise ConfigurationError(
                    f"A drive cannot be planned for {name} = {value:g}: it lies between 0 and {_MOST:g}."
                )
        if self.error is not None and self.scale is not None:
            raise ConfigurationError("A drive is planned for an error or for a scale: leave one out.")

    def drift_for(self, table: Actuation) -> Drift:
        """The drift that is planned against."""
        if self.drift is not None:
            return self.drift
        return Drift() if len(table.patches) > len(table.points) else STEADY

    def budget(self, drift: Drift) -> float:
        """The error accepted."""
        if self.error is not None:
            return self.error
        return BUDGET if drift == STEADY else _DRIFTED


TRADE = Trade()
