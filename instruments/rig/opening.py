"""Open a rig: its drivers, twins or wires; its logbook; the scales that its instruments report."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, closing, suppress
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from ...base import entry_points
from ...base.clock import RealClock
from ...base.errors import ConfigurationError, HaploopError, InstrumentError
from ...base.validation import validate
from ..config import Device, RigFile, SimulationSettings, load_rig_file
from ..daq import CombinedDaq, Daq
from ..driver import TAPE, Driver, Mode, Simulation, hardware_of, settings_of
from ..interlock import Interlocked
from ..operator import Operator
from ..relay import DirectWire
from ..safety import Audit, clear_lockout, entries, hold, lockout_of, lockouts_folder, reserve, state_folder
from ..sensors import Scale, Sensors
from ..tape import Player, Recorder, current
from .rig import Rig
from .taping import PlayedWorld, TapedOperator, check_recordable, is_of_hardware, recording


def open_rig(
    rig: str | Path | RigFile | None = None,
    simulate: Mode | None = None,
    simulation: Mapping[str, Any] | None = None,
    *,
    plant: object = None,
    real_time: bool = False,
) -> Rig:
    """Open every instrument of a rig; use it as a context.

    `rig` is a rig file's path, the bare name of a rig that haploop ships, or a loaded file.
    `simulate` replaces every driver by its twin ("twin"), connects the drivers to their wires ("wire"), or
    to a tape of a session ("tape:FILE", which holds a rig too: `rig` may be None); None: as
    the file says, which for a lab's rig is the hardware. `simulation`
    overrides keys of the file's `[simulation]` table; `plant` replaces its plant by an object
    (docs/how-to/adding-a-plant.md). With `real_time`, a
    simulated rig takes as long as hardware does, for a person who acts on it. Connecting changes no
    output, but of a rig without a relay: there they are set to zero, and held. Hardware is locked while it is
    open: no other program, and no other rig of this one, can open it.

    Raises ConfigurationError, and InstrumentError when an instrument is missing or in use.

    For example:

        >>> with haploop.open_rig("simulated") as rig:
        ...     print(rig.name, rig.limits.peak)
        simulated 48.0
    """
    opened, holding = _made(rig, simulate, simulation or {}, plant, real_time)
    try:
        opened._stack.enter_context(holding)  # what must outlast the instruments
        for role, device, driver in _drivers(opened.file):
            _connect(opened, role, device, driver)
        _complete(opened)
    except BaseException:
        opened.close()
        raise
    return opened


def identify_each(
    file: RigFile, simulate: Mode | None = None, *, plant: object = None
) -> Iterator[tuple[str, str | HaploopError, bool]]:
    """Connect each instrument of a rig, whether or not the others are there; no output is changed.

    Yields each role, what its instrument calls itself or why it cannot be opened, and whether it was asked:
    one without a digital interface cannot be. `simulate` and `plant` as of `open_rig`. A simulated plant is
    wired to the DAQ: without that, nothing more is yielded. Raises as `open_rig` does for what is wrong with
    the rig as a whole.
    """
    opened, holding = _made(file, simulate, {}, plant, False)
    with opened:
        opened._stack.enter_context(holding)
        for role, device, driver in _drivers(opened.file):
            try:
                _connect(opened, role, device, driver)
                name = getattr(opened.instruments[role], "identity", f"The {role}")
                yield role, name, bool(_pieces(role, device, driver, opened.name))
            except HaploopError as error:
                yield role, error, True
                if role == "daq" and opened.mode is not None:
                    return


def _made(
    rig: str | Path | RigFile | None,
    simulate: Mode | None,
    simulation: Mapping[str, Any],
    plant: object,
    real_time: bool,
) -> tuple[Rig, AbstractContextManager[object]]:
    """A rig without its instruments, and what must be held as long as they are open."""
    if simulate is not None and simulate.startswith(TAPE):
        if simulation or plant is not None:
            raise ConfigurationError("A tape is played as it is: it takes no plant, and no setting of one.")
        return _played(rig, simulate)
    if rig is None:
        raise ConfigurationError("Name a rig file: only a tape holds a rig.")
    file = rig if isinstance(rig, RigFile) else load_rig_file(rig)
    mode = simulate or file.simulate
    if mode not in (None, "twin", "wire"):
        raise ConfigurationError(f"A rig is simulated as twin, wire or tape:FILE, not as {mode!r}.")
    deck = current()
    world: Simulation | None = None
    if mode is not None:
        file = simulated_file(file, simulation, plant)
        simulation_class = entry_points.load(entry_points.SIMULATION, "plant")
        world = simulation_class(file, plant=plant, real_time=real_time)
    elif plant is not None:
        raise ConfigurationError(
            f"The rig {file.name!r} is opened on its hardware, which takes no plant: simulate it."
        )
    pieces = hardware(file, mode)
    opened = Rig(file, world.clock if world else RealClock(), world, mode, pieces)
    if isinstance(deck, Recorder):
        check_recordable(file, mode)
        deck.begin(file.model_dump_json(), mode, opened.clock)
    return opened, closing(world) if world else hold(pieces, f"The rig {file.name!r}")


def _played(rig: str | Path | RigFile | None, mode: Mode) -> tuple[Rig, AbstractContextManager[object]]:
    """A rig on a tape: that of the session, or another for this rig alone."""
    path = Path(mode.removeprefix(TAPE))
    session = current()
    player = session if isinstance(session, Player) and session.path == path else Player(path)
    world = PlayedWorld(player)
    file = world.file if rig is None else rig if isinstance(rig, RigFile) else load_rig_file(rig)
    return Rig(file, world.clock, world, mode, hardware(file, mode)), closing(world)


def hardware(file: RigFile, mode: Mode | None) -> frozenset[str]:
    """Names of a rig's hardware, for its lock and its lockouts.

    A simulated rig is one piece, whatever its plant is and does: a trip under a seed that a command gave is
    reset without it.
    """
    if mode is not None:
        alike = file.model_copy(update={"simulation": SimulationSettings()})
        return frozenset({f"the simulated rig {file.name}, {alike.digest}"})
    return frozenset().union(
        *(_pieces(role, device, driver, file.name) for role, device, driver in _drivers(file))
    )


def _pieces(role: str, device: Device, driver: Driver, rig: str) -> frozenset[str]:
    return hardware_of(device.driver, driver, settings_of(driver, device, role, rig))


def _opened(instrument: Any, role: str, device: Device, driver: Driver, rig: str) -> frozenset[str]:
    """As `_pieces`, but as the instrument knows itself: what answered too late has another name."""
    known: Collection[str] | None = getattr(instrument, "pieces", None)
    return _pieces(role, device, driver, rig) if known is None else frozenset(known)


def simulated_file(file: RigFile, changes: Mapping[str, Any], plant: object = None) -> RigFile:
    """Return a rig file with keys of its `[simulation]` table changed, and the name of the `plant` in it.

    With another plant, the settings of the file's own plant are dropped.
    Raises ConfigurationError for an unknown key or a wrong value.
    """
    where = f"[simulation] of {file.name}"
    named = {} if plant is None else _described(plant)
    table = file.simulation.model_dump()
    if named or changes.get("plant", table["plant"]) != table["plant"]:
        table = {key: value for key, value in table.items() if key not in file.simulation.settings}
    settings = validate(SimulationSettings, {**table, **changes, **named}, where)
    if plant is None:
        own = validate(
            entry_points.plant_class(settings.plant),
            settings.settings,
            where,
            ("simulation",),
            SimulationSettings.model_fields,
        )
        # With the defaults of the plant, so that what a rig writes tells all of its simulation.
        settings = settings.model_copy(update=own.model_dump(mode="json"))
    return file.model_copy(update={"simulation": settings})


def _described(plant: object) -> dict[str, Any]:
    """Keys of `[simulation]` that tell a plant given as an object: its class, and its settings if it has any.

    The class of an installed plant is told by its entry point's name, with which it can be opened again.
    """
    kind = type(plant)
    name = entry_points.name_of(entry_points.PLANTS, kind) or f"{kind.__module__}.{kind.__qualname__}"
    return {**(plant.model_dump(mode="json") if isinstance(plant, BaseModel) else {}), "plant": name}


def _connect(rig: Rig, role: str, device: Device, driver: Driver) -> None:
    """Open an instrument of a rig."""
    try:
        with recording(rig, role, device, driver) as (opener, line):
            if rig.simulation and rig.mode:
                instrument = rig.simulation.instrument(role, device, opener, rig.mode)
            else:
                instrument = opener.open(settings_of(driver, device, role, rig.name), rig.clock)
            if isinstance(instrument, Operator) and line.taped:
                instrument = TapedOperator(instrument, line)
    except HaploopError:
        raise
    except (Exception, SystemExit) as error:
        if driver.__module__.startswith("haploop."):
            raise
        told = " ".join(f"{type(error).__name__}: {error}".split())
        raise InstrumentError(
            f"{entry_points.named(entry_points.DRIVERS, device.driver)} failed to open its instrument "
            f"({told}): ask the package's author."
        ) from error
    if not isinstance(instrument, entry_points.role_class(role)):
        raise ConfigurationError(
            f"What the driver {device.driver!r} opened is no {role}, but an object of "
            f"{type(instrument).__name__}: ask the author of the driver, or of its twin."
        )
    if isinstance(instrument, Interlocked):
        _refuse_shown(role, instrument, device.driver)
    rig.adopt(role, instrument)
    compare_scales(role, instrument, rig.sensors, rig.name)
    if not rig.simulation and not _opened(instrument, role, device, driver, rig.name) <= rig.hardware:
        raise InstrumentError(
            f"The {role} of the rig {rig.name!r} is another one than a moment ago, or answers only now: "
            "open the rig again."
        )
    if isinstance(instrument, Daq) and (not rig.simulation or is_of_hardware(rig.simulation)):
        # The lock proves that no running program on this computer uses it.
        instrument.clear_left()


def _refuse_shown(role: str, instrument: Interlocked, driver: str) -> None:
    """Refuse a driver that shows what a notebook can change: a DAQ may look up there what it sets to zero."""
    own = {*dir(type(instrument)), *vars(instrument)}.difference(dir(entry_points.role_class(role)))
    for name in sorted(name for name in own if not name.startswith("_")):
        value = None
        with suppress(Exception):  # a property that cannot be read now
            value = getattr(instrument, name)
        if isinstance(value, dict | list | set | BaseModel):
            raise ConfigurationError(
                f"The {role}'s driver {driver!r} shows {name!r}, in which a program could change what volts "
                f"rest on: ask its author to call it '_{name}'."
            )


def _complete(rig: Rig) -> None:
    """Join what belongs together, once every instrument is open, and let the rig be used."""
    if rig.file.wiring == "direct" and rig.has("amplifier"):
        rig.adopt("relay", DirectWire(rig.table.patches))
    if rig.has("adc"):
        channels = rig.file.daq.settings.get("channels")
        base = next(iter(channels), None) if isinstance(channels, Mapping) else None
        rig._roles["daq"] = CombinedDaq(rig._roles["daq"], rig._roles["adc"], rig.clock, base)
    rig.complete()


def _drivers(file: RigFile) -> Iterator[tuple[str, Device, Driver]]:
    """Yield each role of a rig file, its table, and the driver that the table names."""
    drivers = entry_points.installed(entry_points.DRIVERS)
    for role, device in file.devices.items():
        if device.driver not in drivers:
            raise ConfigurationError(
                f"[{role}] of {file.name}: {entry_points.unknown_driver(device.driver, role)}"
            )
        driver: Any = entry_points.driver_class(device.driver, role)
        yield role, device, driver


# State of a rig that outlasts a program: its audit log and its lockout.


def log_entries(rig: str | Path | RigFile, simulate: Mode | None = None) -> Iterator[Mapping[str, Any]]:
    """Read the audit log of rigs of this name, oldest entry first.

    `rig` and `simulate` are as in `open_rig`: a simulated rig has a separate log. A damaged line is an entry
    "damaged" of every rig. Raises ConfigurationError, and DataError for a log that cannot be read.
    """
    file = rig if isinstance(rig, RigFile) else load_rig_file(rig)
    folder = state_folder(file, (simulate or file.simulate) is not None)
    return (entry for entry in entries(folder) if entry.get("rig", file.name) == file.name)


def reset_lockout(rig: str | Path | RigFile, reason: str, simulate: Mode | None = None) -> None:
    """Clear the lockout of an inspected rig, once the reason is in its audit log.

    `rig` and `simulate` are as in `open_rig`. Raises ConfigurationError without a reason and for a rig that
    is not locked out, InstrumentError when another program has the rig.
    """
    file = rig if isinstance(rig, RigFile) else load_rig_file(rig)
    mode = simulate or file.simulate
    pieces = hardware(file, mode)
    with ExitStack() as stack:
        if mode is None:
            stack.enter_context(reserve(pieces, f"The rig {file.name!r}"))
        if not reason.strip():
            raise ConfigurationError(
                "A reset needs a reason: state the cause of the trip and what was done about it."
            )
        folder = state_folder(file, mode is not None)
        lockouts = lockouts_folder(folder, mode is not None)
        lockout = lockout_of(lockouts, pieces)
        if lockout is None:
            raise ConfigurationError(f"The rig {file.name!r} is not locked out: there is nothing to reset.")
        Audit(file, folder, mode is not None).note(
            "reset", reason=reason.strip(), locked_out=lockout.when, why=lockout.why
        )
        clear_lockout(lockouts, pieces)


# Scales that instruments report, compared with what the rig file says of the same channels.
#
# An instrument with an analog output (a charge amplifier, a high-voltage amplifier with a monitor) may have
# an attribute `scales`: the scale of each DAQ channel that it is wired to. A rig whose file says another is
# not opened, because everything that it recorded would be scaled wrongly.

_TOLERANCE = 1e-3
"""Relative tolerance: rig files give four digits or more."""


def compare_scales(role: str, instrument: Any, sensors: Sensors, rig: str) -> None:
    """Compare the scales that an instrument reports, if any, with its rig file's sensors.

    Raises ConfigurationError for the first channel that differs, and for one that no sensor reads.
    """
    scales = getattr(instrument, "scales", {})
    if not isinstance(scales, Mapping) or not all(isinstance(scale, Scale) for scale in scales.values()):
        raise ConfigurationError(
            f"The 'scales' of the {role} of the rig {rig!r} map no channels to haploop.instruments.Scale: "
            "ask the author of its driver, or of its twin."
        )
    for channel, reported in scales.items():
        told = f"The {role} of the rig {rig!r} reports {reported} on the channel {channel!r}, and"
        found = sensors.scale_of(channel)
        if found is None:
            raise ConfigurationError(
                f"{told} [sensors] has none with that channel and one scale: add one, or correct [{role}]."
            )
        table, filed = found
        if reported.unit != filed.unit or not math.isclose(
            reported.per_volt, filed.per_volt, rel_tol=_TOLERANCE
        ):
            raise ConfigurationError(
                f"{told} [sensors.{table}] says {filed}: set the instrument, or correct the rig file."
            )
