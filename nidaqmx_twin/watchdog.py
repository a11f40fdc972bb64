"""Watchdog timers, which expire unless the program resets them in time; then outputs go to their states.

X Series manual 370784 and cDAQ-9185 manual, "Watchdog Timer".
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from nidaqmx.constants import AOPowerUpOutputBehavior, Edge, Level, TriggerType, WDTTaskAction

from .devices import NiDevice
from .errors import DaqmxError, DAQmxErrors
from .terminals import OutputTerminal

_DEFAULTS: dict[str, Any] = {
    "TIMEOUT": 10.0,
    "EXPIR_TRIG_TYPE": TriggerType.NONE.value,
    "EXPIR_TRIG_TRIG_ON_NETWORK_CONN_LOSS": False,
    "DIG_EDGE_WATCHDOG_EXPIR_TRIG_EDGE": Edge.RISING.value,
    "DIG_EDGE_WATCHDOG_EXPIR_TRIG_SRC": "",
}
_LONGEST = {"X Series": (2**32 - 1) * 8e-9, "CompactDAQ Chassis": (2**32 - 1) * 25e-9}
"""Longest time-outs by family (s; the manuals)."""
_WITHOUT = ("E Series", "M Series", "AO Series", "USB DAQ", "myDAQ", "DSA", "C Series")
_CHASSIS = ("cDAQ-9185", "cDAQ-9189")
"""Families without a timer, and chassis with one (inferred)."""


_LEVELS = {Level.LOW.value: 0.0, Level.HIGH.value: 1.0}
_VOLTAGE = AOPowerUpOutputBehavior.VOLTAGE.value


@dataclass
class Watchdog:
    """The timer of one watchdog task. Times are of the system's clock (s)."""

    device: NiDevice
    values: dict[tuple[str, str], Any] = field(default_factory=dict)
    """Properties by (physical channel or "", name)."""
    _since: float | None = None
    """Time of the last reset (s); None while the timer is stopped."""
    _expired: bool = False
    _put: bool = False
    """True once its outputs are in their states."""

    def __post_init__(self) -> None:
        """Raise DaqmxError for a device that has no timer."""
        product = self.device.product
        if product.family in _WITHOUT or (product.slots and product.name not in _CHASSIS):
            raise DaqmxError(
                DAQmxErrors.WATCHDOG_TIMER_NOT_SUPPORTED,
                f"Watchdog timer is not supported by the device: {self.device.name}, a {product.name}.",
            )

    @property
    def timeout(self) -> float:
        """Time from a reset to its end (s); infinite where only a trigger ends it."""
        asked = float(self.get("", "TIMEOUT"))
        return np.inf if asked == -1 else asked

    def start(self, now: float) -> None:
        """Start the timer from zero. Raises DaqmxError for a time-out that it has not."""
        longest = _LONGEST.get(self.device.product.family, np.inf)
        if not 0 < self.timeout <= longest and np.isfinite(self.timeout):
            raise DaqmxError(
                DAQmxErrors.WATCHDOG_TIMEOUT_OUT_OF_RANGE_AND_NOT_SPECIAL_VAL,
                f"Watchdog timeout of {self.timeout:g} s is out of range: above 0 to {longest:.4g} s, or -1.",
            )
        self._since, self._expired, self._put = now, False, False

    def stop(self) -> None:
        """Stop the timer."""
        self._since = None

    def control(self, action: WDTTaskAction, now: float) -> None:
        """Reset the timer or clear its expiration; both restart it from zero. Raises DaqmxError."""
        if action is WDTTaskAction.CLEAR_EXPIRATION:
            self._expired = self._put = False
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
        self._expired |= now - self._since > self.timeout
        return self._expired

    def guard(self, outputs: Mapping[str, OutputTerminal], now: float) -> None:
        """Let outputs go to their states at the moment when it has expired, once."""
        if self._since is None or self._put or not self.expired(now):
            return
        self._put, when = True, self._since + self.timeout
        for (channel, name), value in self.values.items():
            level = _LEVELS.get(value) if name == "DO_EXPIR_STATE" else None
            if name == "AO_EXPIR_STATE" and self.get(channel, "AO_OUTPUT_TYPE") == _VOLTAGE:
                level = float(value)
            if level is None:
                continue
            for output, terminal in outputs.items():
                if f"{output}/".lower().startswith(f"{channel.lstrip('/')}/".lower()):
                    terminal.stop(when)
                    terminal.hold(level, when)

    def refuse(self, device: NiDevice, now: float) -> None:
        """Raise DaqmxError for what is written to a device whose timer has expired."""
        if (
            self._since is None
            or self.device.name not in (device.name, device.chassis)
            or not self.expired(now)
        ):
            return
        code = DAQmxErrors.WRITE_FAILED_BECAUSE_WATCHDOG_EXPIRED
        if self.device.product.slots:
            code = DAQmxErrors.CHASSIS_WATCHDOG_TIMER_EXPIRED
        raise DaqmxError(
            code,
            f"Write failed, because the watchdog timer of {self.device.name} expired: clear the expiration.",
        )

    def get(self, channel: str, name: str) -> Any:
        """Return a property of the task ("") or of one physical channel, or None."""
        return self.values.get((channel, name), None if channel else _DEFAULTS.get(name))
