"""A rig: every instrument that a rig file names, opened together and left in the safe state."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from importlib import metadata
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Protocol, Self, TypeVar

import numpy as np
from pydantic import BaseModel

import instruments
from instruments.amplifier import Amplifier
from instruments.arrays import FloatArray
from instruments.clock import Clock, RealClock
from instruments.daq import Block, Capture, Daq
from instruments.errors import ConfigurationError, InstrumentError
from instruments.limits import Limits
from instruments.operator import ConfirmSettings, Operator
from instruments.relay import Relay
from instruments.rig_file import Device, RigFile, SimulationSettings, Table, load_rig_file, validate
from instruments.sensors import Sensors
from instruments.vibrometer import Vibrometer

__all__ = ["Driver", "Mode", "Rig", "Simulation", "open_rig"]

Mode = Literal["twin", "wire"]
Role = TypeVar("Role")
_REST = 0.05
"""Seconds of zero drive before the relay switches: several time constants of the amplifier."""


class Driver(Protocol):
    """What an entry point of the group `haploop.drivers` names: usually a role's subclass."""

    Settings: type[BaseModel]
    """Validates the instrument's table of the rig file."""

    def open(self, settings: Any, clock: Clock) -> Any:
        """Connect, change no output, and return an implementation of the role."""


class Simulation(Protocol):
    """What the entry point `haploop.simulation` makes: the plant that stands in for the world."""

    clock: Clock
    truth: Any
    """What only a simulator can know. For tests and reports: no estimator may read it."""

    def instrument(self, role: str, device: Device, driver: Driver, mode: Mode) -> Any:
        """The role's twin, or in mode "wire" the real driver pointed at its wire."""

    def close(self) -> None:
        """Stop every wire."""


class Rig:
    """Open instruments. Made by `open_rig`; a context whose exit reaches the safe state."""

    def __init__(self, file: RigFile, clock: Clock, simulation: Simulation | None, mode: Mode | None) -> None:
        self.file = file
        self.clock = clock
        self.simulation = simulation
        self.mode = mode
        self._roles: dict[str, Any] = {}
        self._confirmed = False
        self._stack = ExitStack()

    @property
    def name(self) -> str:
        """The rig's name, from its file."""
        return self.file.name

    @property
    def simulated(self) -> bool:
        """Whether anything that this rig measures is simulated."""
        return self.simulation is not None

    @property
    def sensors(self) -> Sensors:
        """The rig's sensors."""
        return self.file.sensors

    @property
    def table(self) -> Table:
        """The touch table. Raises ConfigurationError for a rig that has none."""
        if self.file.table is None:
            raise ConfigurationError(f"The rig {self.name!r} has no [table]; this step needs one.")
        return self.file.table

    @property
    def daq(self) -> Daq:
        """The DAQ."""
        return self._role(Daq)

    @property
    def amplifier(self) -> Amplifier:
        """The amplifier. Raises ConfigurationError for a rig that has none."""
        return self._role(Amplifier)

    @property
    def relay(self) -> Relay:
        """The relay. Raises ConfigurationError for a rig that has none."""
        return self._role(Relay)

    @property
    def vibrometer(self) -> Vibrometer:
        """The vibrometer. Raises ConfigurationError for a rig that has none."""
        return self._role(Vibrometer)

    @property
    def operator(self) -> Operator:
        """The person at the rig, or their twin."""
        return self._role(Operator)

    @property
    def limits(self) -> Limits:
        """The strictest of the rig's own limits, the amplifier's, one patch's and the relay's."""
        return self.limits_for(1)

    def limits_for(self, patches: int) -> Limits:
        """As `limits`, with `patches` patches in parallel."""
        table = self.table
        patch = Limits(
            low=table.patch_low, high=table.patch_high, capacitance=patches * table.patch_capacitance
        )
        relay = Limits(low=-self.relay.rating, high=self.relay.rating)
        own = self.file.limits.limits()
        return own.within(patch).within(relay).within(self.amplifier.limits(patches))

    def confirm_settings(self) -> None:
        """Have the operator confirm, once, what no software can read. Raises InstrumentError."""
        sentence = self.vibrometer.declared
        if sentence and not self._confirmed and not self.operator.confirm(ConfirmSettings(sentence)):
            raise InstrumentError(
                f"The operator did not confirm the settings of the {self.vibrometer.identity}: "
                "set them as the rig file says, or change the rig file."
            )
        self._confirmed = True

    def excite(
        self,
        drive: FloatArray,
        patches: Collection[str],
        channels: Sequence[str],
        tail: float = 0.0,
        progress: Callable[[float], None] = lambda _seconds: None,
    ) -> Capture:
        """Play a drive into patches and record channels on the same clock.

        `drive` is (samples,) V at the patch at the table's rate; recording goes on for `tail`
        seconds of zero drive. The drive is checked against every limit before anything is
        written; the relay connects exactly `patches` while the output rests at zero, and opens
        again before this returns or raises. `progress` is told the seconds of each block.

        Raises LimitError, ConfigurationError, InstrumentError.
        """
        rate_hz = self.table.rate_hz
        self.limits_for(len(patches)).check(drive, rate_hz)
        padded = np.concatenate([drive, np.zeros(max(1, round(tail * rate_hz)))])
        play = {self.amplifier.input: self.amplifier.to_input(padded)}

        def each(block: Block) -> None:
            self.relay.renew()
            progress(block.volts.shape[1] / rate_hz)

        try:
            self.daq.zero()
            self.relay.connect(patches)
            with self.daq.stream(channels, rate_hz, round(rate_hz / 10), len(padded), play) as stream:
                return stream.capture(each)
        finally:
            # Zero first: the relay switches without voltage, and a patch is left without charge.
            with uninterrupted():
                self.make_safe()

    def make_safe(self) -> None:
        """Output to zero, then every relay channel open, read back. Idempotent.

        Both are tried whatever the first one does. Raises InstrumentError when either failed.
        """
        failures = []
        steps: list[Callable[[], object]] = []
        if "daq" in self._roles:
            steps += [self.daq.zero, lambda: self.clock.sleep(_REST if "relay" in self._roles else 0)]
        if "relay" in self._roles:
            steps.append(lambda: self.relay.connect(()))
        for step in steps:
            try:
                step()
            except Exception as error:
                failures.append(error)
        if failures:
            raise InstrumentError(
                "The safe state was not confirmed: "
                + " ".join(str(f) for f in failures)
                + " Switch the amplifier off by hand."
            ) from failures[0]

    def close(self) -> None:
        """Safe state first, then let go of the instruments in reverse order. May be called again."""
        with uninterrupted():
            self._stack.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _role(self, kind: type[Role]) -> Role:
        name = kind.__name__.lower()
        instrument = self._roles.get(name)
        if not isinstance(instrument, kind):
            raise ConfigurationError(f"The rig {self.name!r} has no [{name}]; this step needs one.")
        return instrument

    def _open(self) -> None:
        drivers = {e.name: e for e in metadata.entry_points(group="haploop.drivers")}
        self._stack.callback(self.simulation.close if self.simulation else lambda: None)
        devices = {role: getattr(self.file, role) for role in _ROLES}
        for role, device in devices.items():
            if device is None:
                continue
            if device.driver not in drivers:
                raise ConfigurationError(
                    f"The rig {self.name!r} asks for the {role} driver {device.driver!r}; "
                    f"installed drivers are {', '.join(sorted(drivers))}."
                )
            driver: Driver = drivers[device.driver].load()
            if self.simulation and self.mode:
                instrument = self.simulation.instrument(role, device, driver, self.mode)
            else:
                settings = validate(driver.Settings, device.settings, f"[{role}] of {self.name}")
                instrument = driver.open(settings, self.clock)
            if not isinstance(instrument, _ROLES[role]):
                raise ConfigurationError(f"The driver {device.driver!r} is not for the role {role!r}.")
            self._roles[role] = instrument
            if hasattr(instrument, "close"):
                self._stack.callback(instrument.close)
        self._stack.callback(self.make_safe)


_ROLES: dict[str, type[Any]] = {
    "daq": Daq,
    "amplifier": Amplifier,
    "relay": Relay,
    "vibrometer": Vibrometer,
    "operator": Operator,
}


def open_rig(
    rig: str | Path | RigFile, simulate: Mode | None = None, simulation: Mapping[str, Any] | None = None
) -> Rig:
    """Open every instrument of a rig; use it as a context.

    `rig` is a rig file's path, the bare name of a rig that haploop ships, or a loaded file.
    `simulate` replaces every driver by its twin, or keeps the drivers and points them at their
    wires; None takes what the file says, which for a lab's rig is the hardware. `simulation`
    overrides keys of the file's `[simulation]` table. Connecting changes no output.

    Raises ConfigurationError, and InstrumentError when an instrument is not there.
    """
    _check_import_name()
    file = rig if isinstance(rig, RigFile) else load_rig_file(rig)
    mode = simulate or file.simulate
    world: Simulation | None = None
    if mode is not None:
        plant = {**file.simulation.model_dump(), **(simulation or {})}
        file = file.model_copy(
            update={"simulation": validate(SimulationSettings, plant, f"[simulation] of {file.name}")}
        )
        (entry,) = metadata.entry_points(group="haploop.simulation", name="plant")
        world = entry.load()(file)
    opened = Rig(file, world.clock if world else RealClock(), world, mode)
    try:
        opened._open()
    except BaseException:
        opened.close()
        raise
    return opened


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Let no Ctrl-C or SIGTERM cut short what brings the rig to its safe state.

    A signal that arrives meanwhile is delivered once at the end. Only the main thread sees
    signals; in any other thread this does nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    arrived: list[int] = []
    kinds = (signal.SIGINT, signal.SIGTERM)
    before = {kind: signal.signal(kind, lambda number, _frame: arrived.append(number)) for kind in kinds}
    try:
        yield
    finally:
        for kind, handler in before.items():
            signal.signal(kind, handler)
        if arrived:
            signal.raise_signal(arrived[0])


def _check_import_name() -> None:
    """InstrumentKit uses the import name `instruments` too; found in our place, it breaks all."""
    if not hasattr(instruments, "Daq"):
        raise ConfigurationError(
            f"Another project named 'instruments' is installed at {instruments.__file__} and hides "
            "haploop's: uninstall it (InstrumentKit), or use a virtual environment of haploop's own."
        )
