"""Failures that a program puts into the simulated cards."""

from __future__ import annotations

from .devices import Inventory
from .errors import DaqmxError, DAQmxErrors, error_string
from .tasks import Task


class Failures:
    """Cards that fail in the next read, and those that fail for good."""

    def __init__(self, inventory: Inventory) -> None:
        self._inventory = inventory
        self._next: dict[str, DAQmxErrors] = {}
        self._lasting: dict[str, DAQmxErrors] = {}

    def inject(self, device: str, code: DAQmxErrors) -> None:
        """Make the next read on `device` fail with `code`."""
        self._next[device] = code

    def fail(self, device: str, code: DAQmxErrors | None) -> None:
        """Make every use of `device` fail with `code` from now on; None ends that.

        PAL_RESOURCE_RESERVED is another program's task: the device's tasks can be made, and not reserved.
        """
        name = self._inventory.device(device).name
        if code is None:
            self._lasting.pop(name, None)
        else:
            self._lasting[name] = code

    def refuse(self, task: Task | None, reserving: bool = False) -> None:
        """Raise DaqmxError when a device of a task fails for good, or another program has reserved it."""
        for device in task.devices if task is not None and task.channels else ():
            code = self._lasting.get(device.name)
            if code is not None and (reserving or code is not DAQmxErrors.PAL_RESOURCE_RESERVED):
                sentence = error_string(code.value).partition("\n")[0]
                raise DaqmxError(code, f"{sentence}\n\nDevice: {device.name}")

    def of_read(self, task: Task) -> DAQmxErrors | None:
        """Return, once, the failure injected for the next read of `task`, or None."""
        for device in task.devices:
            if device.name in self._next:
                return self._next.pop(device.name)
        return None
