"""Watchdog timers, which expire unless the program resets them in time.

The outputs' expiration states are stored and reported, but not put out.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from nidaqmx.constants import Edge, TriggerType, WDTTaskAction

from .errors import DaqmxError, DAQmxErrors

_DEFAULTS: dict[str, Any] = {
    "TIMEOUT": 10.0,
    "EXPIR_TRIG_TYPE": TriggerType.NONE.value,
    "EXPIR_TRIG_TRIG_ON_NETWORK_CONN_LOSS": False,
    "DIG_EDGE_WATCHDOG_EXPIR_TRIG_EDGE": Edge.RISING.value,
    "DIG_EDGE_WATCHDOG_EXPIR_TRIG_SRC": "",
}


@dataclass
class Watchdog:
    """The timer of one watchdog task. Times are of the system's clock (s)."""

    values: dict[tuple[str, str], Any] = field(default_factory=dict)
    """Properties by (physical channel or "", name)."""
    _since: float | None = None
    """Time of the last reset (s); None while the timer is stopped."""
    _expired: bool = False

    def start(self, now: float) -> None:
        """Start the timer from zero."""
        self._since, self._expired = now, False

    def stop(self) -> None:
        """Stop the timer."""
        self._since = None

    def control(self, action: WDTTaskAction, now: float) -> None:
        """Reset the timer or clear its expiration; both restart it from zero. Raises DaqmxError."""
        if action is WDTTaskAction.CLEAR_EXPIRATION:
            self._expired = False
        elif self.expired(now):
            raise DaqmxError(
                DAQmxErrors.CANT_RESET_EXPIRED_WATCHDOG,
                "Watchdog timer cannot be reset, because it has expired: clear the expiration first.",
            )
        if self._since is not None:
            self._since = now

    def expired(self, now: float) -> bool:
        """Return True when the timer has expired since its start or clearing. Raises DaqmxError before a
        start.
        """
        if self._since is None:
            raise DaqmxError(
                DAQmxErrors.CANNOT_GET_PROPERTY_WHEN_TASK_NOT_RESERVED_COMMITTED_OR_RUNNING,
                "Specified property cannot be read while the task is not reserved, committed or running: "
                "the watchdog's expiration.",
            )
        self._expired |= now - self._since > float(self.get("", "TIMEOUT"))
        return self._expired

    def get(self, channel: str, name: str) -> Any:
        """Return a property of the task ("") or of one physical channel, or None."""
        return self.values.get((channel, name), None if channel else _DEFAULTS.get(name))
