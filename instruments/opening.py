"""Opening a rig: its file's drivers, their twins, or the drivers at their wires."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

import instruments
from instruments.clock import RealClock
from instruments.driver import Driver, Mode, Simulation
from instruments.errors import ConfigurationError
from instruments.rig import ROLES, Rig
from instruments.rig_file import RigFile, SimulationSettings, load_rig_file, validate

__all__ = ["open_rig"]


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
        _connect(opened)
    except BaseException:
        opened.close()
        raise
    return opened


def _connect(rig: Rig) -> None:
    """Open each instrument that the rig file names."""
    drivers = {e.name: e for e in metadata.entry_points(group="haploop.drivers")}
    devices = {role: getattr(rig.file, role) for role in ROLES}
    for role, device in devices.items():
        if device is None:
            continue
        if device.driver not in drivers:
            raise ConfigurationError(
                f"The rig {rig.name!r} asks for the {role} driver {device.driver!r}; "
                f"installed drivers are {', '.join(sorted(drivers))}."
            )
        driver: Driver = drivers[device.driver].load()
        if rig.simulation and rig.mode:
            instrument = rig.simulation.instrument(role, device, driver, rig.mode)
        else:
            settings = validate(driver.Settings, device.settings, f"[{role}] of {rig.name}")
            instrument = driver.open(settings, rig.clock)
        if not isinstance(instrument, ROLES[role]):
            raise ConfigurationError(f"The driver {device.driver!r} is not for the role {role!r}.")
        rig.adopt(role, instrument)
    rig.complete()


def _check_import_name() -> None:
    """InstrumentKit uses the import name `instruments` too; found in our place, it breaks all."""
    if not hasattr(instruments, "Daq"):
        raise ConfigurationError(
            f"Another project named 'instruments' is installed at {instruments.__file__} and hides "
            "haploop's: uninstall it (InstrumentKit), or use a virtual environment of haploop's own."
        )
