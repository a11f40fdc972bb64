"""Installed kinds of plant and of fault: the surface and the faults of a rig file.

The set is open: an entry point of the group `haploop.plants` names a subclass of `PlantSettings`. A kind is
loaded only when a rig file names it, so that a broken package does not affect other rigs.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, TypeVar, overload

import numpy as np

from ...base import entry_points
from ...base.errors import ConfigurationError, HaploopError, InstrumentError
from ...base.validation import validate, validate_kind
from ...instruments.config import RigFile, roles
from .hysteresis import PatchLaw
from .modal_surface import ModalSurface, SofteningSurface
from .places import PLACES, Fault, FaultSettings, OnSurface
from .surface import PlantSettings, PlantSource, Surface, table_of


def plant_source(file: RigFile) -> PlantSource:
    """Return the plant that a rig file names, with its settings.

    Raises ConfigurationError, which names the package, for a plant that is not installed, that cannot be
    loaded, that two packages provide, that is not a plant, or whose settings are wrong.
    """
    name = file.simulation.plant
    kind = entry_points.plant_class(name)
    if not issubclass(kind, PlantSettings):
        raise ConfigurationError(
            f"{entry_points.named(entry_points.PLANTS, name)} is not a plant: its entry point must name a "
            "subclass of haploop.mocks.plant.PlantSettings."
        )
    return validate(kind, file.simulation.settings, f"[simulation] of {file.name}")


def surface_and_laws(
    file: RigFile, source: PlantSource, faults: Sequence[OnSurface], rng: np.random.Generator
) -> tuple[Surface, dict[str, PatchLaw]]:
    """Make a plant's surface, and the law of each of its patches, with the faults that act on them.

    Raises ConfigurationError for a surface without the rig's patches, or without the modes that a fault
    needs; InstrumentError when another package's plant fails.
    """
    name = file.simulation.plant
    with asked(source, name):
        surface = source.make(file, rng)
    if not isinstance(surface, Surface):
        raise ConfigurationError(
            f"The plant {name!r} made an object of {type(surface).__name__}, which is no "
            "haploop.mocks.plant.Surface: ask its author."
        )
    missing = [patch for patch in table_of(file).patches if patch not in surface.patches]
    if missing:
        raise ConfigurationError(
            f"The plant {name!r} has the patches {', '.join(surface.patches) or '(none)'}, and [table] of "
            f"{file.name} also names {', '.join(missing)}: name those that it has."
        )
    coils = file.actuator is not None and file.actuator.kind == "coil"
    if coils and (not isinstance(surface, ModalSurface) or isinstance(surface, SofteningSurface)):
        raise ConfigurationError(
            f"The surface of the plant {name!r} is driven by patches only, because it softens or is not "
            "described by modes: simulate coils on another plant, without softening."
        )
    for fault in faults:
        if type(fault).modes is OnSurface.modes:
            continue
        if not isinstance(surface, ModalSurface):
            raise ConfigurationError(
                f"A fault of the kind {fault.kind!r} changes modes, and the surface of the plant {name!r} is "
                "not described by modes: use another fault, or another plant."
            )
        surface.alter(fault.modes, fault.every)
    laws = {}
    for patch in surface.patches:
        with asked(source, name):
            laws[patch] = source.law(patch, file)
        for fault in faults:
            laws[patch] = fault.law(patch, laws[patch])
    return surface, laws


@contextmanager
def asked(what: object, plant: str) -> Iterator[None]:
    """Convert what another package's code raises to an InstrumentError of one sentence."""
    try:
        yield
    except HaploopError:
        raise
    except (Exception, SystemExit) as error:
        if type(what).__module__.startswith("haploop."):
            raise
        told = " ".join(f"{type(error).__name__}: {error}".split())
        raise InstrumentError(f"The plant {plant!r} failed ({told}): ask its author.") from error


# Installed kinds of fault, and the faults of a rig file.
#
# haploop's own stand in a table (`mocks/faults/`), which the plant does not know: it asks the simulation. The
# set is open: an entry point of the group `haploop.faults` names a subclass of `Fault`. It is loaded only
# when a rig file names it, so that a broken package does not affect other rigs.

Place = TypeVar("Place", bound=Fault)


class FaultKinds(Mapping[str, type[FaultSettings]]):
    """Settings classes of the installed kinds of fault, by the kinds' names in rig files."""

    def __getitem__(self, kind: str) -> type[FaultSettings]:
        if kind not in self:
            raise KeyError(kind)
        return fault_class(kind).Settings

    def __contains__(self, kind: object) -> bool:
        return kind in _names()

    def __iter__(self) -> Iterator[str]:
        return iter(_names())

    def __len__(self) -> int:
        return len(_names())


def _own() -> Mapping[str, type[Fault]]:
    own: Mapping[str, type[Fault]] = entry_points.load(entry_points.SIMULATION, "plant").own_faults()
    return own


def _names() -> list[str]:
    return sorted({*_own(), *entry_points.installed(entry_points.FAULTS)})


KINDS = FaultKinds()
"""The installed kinds of fault: see `FaultKinds`."""


def fault_class(kind: str) -> type[Fault]:
    """Load the class of a kind of fault.

    Raises ConfigurationError, which names the package, for a kind that is not installed, that cannot be
    loaded, that two packages provide, or that is not a fault.
    """
    own = _own().get(kind)
    if own is not None and not entry_points.entries(entry_points.FAULTS, kind):
        return own
    loaded: Any = entry_points.load(entry_points.FAULTS, kind)
    if own not in (None, loaded):
        raise ConfigurationError(
            f"{entry_points.named(entry_points.FAULTS, kind)} has the name of one of haploop's own: "
            "uninstall that package, or ask its author for another name."
        )
    settings = getattr(loaded, "Settings", None)
    if not (isinstance(loaded, type) and issubclass(loaded, Fault)) or not (
        isinstance(settings, type) and issubclass(settings, FaultSettings)
    ):
        raise ConfigurationError(
            f"{entry_points.named(entry_points.FAULTS, kind)} is not a fault: its entry point must name a "
            "subclass of haploop.mocks.plant.Fault, whose Settings are a FaultSettings."
        )
    for place in PLACES:
        idle = [name for name in vars(place) if name[0] != "_" and hasattr(loaded, name)]
        if idle and not issubclass(loaded, place):
            raise ConfigurationError(
                f"{entry_points.named(entry_points.FAULTS, kind)} has the hook {idle[0]!r}, and nobody "
                f"calls it: derive {loaded.__name__} from haploop.mocks.plant.{place.__name__} too."
            )
    return loaded


class Faults(Sequence[Fault]):
    """All faults of a plant, in the order of the rig file."""

    def __init__(self, faults: Sequence[Fault] = ()) -> None:
        self._faults = tuple(faults)
        self._at: dict[type[Fault], tuple[Any, ...]] = {
            place: tuple(fault for fault in faults if isinstance(fault, place)) for place in PLACES
        }

    @classmethod
    def of_file(cls, file: RigFile) -> Faults:
        """Create the faults of a rig file. Raises ConfigurationError for a fault that the rig cannot have."""
        faults = []
        for index, raw in enumerate(file.simulation.faults):
            settings = validate_kind(KINDS, raw, f"simulation.faults.{index} of {file.name}")
            _refuse(settings, file)
            rng = np.random.default_rng([file.simulation.seed, 0xFA017, index])
            faults.append(fault_class(settings.kind)(settings, file, rng))
        return cls(faults)

    def at(self, place: type[Place]) -> tuple[Place, ...]:
        """Return the faults that sit at a place (`OnRelay`), in the order of the rig file."""
        return self._at[place]

    @overload
    def __getitem__(self, index: int) -> Fault: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Fault]: ...
    def __getitem__(self, index: int | slice) -> Fault | Sequence[Fault]:
        return self._faults[index]

    def __len__(self) -> int:
        return len(self._faults)


def _refuse(settings: FaultSettings, file: RigFile) -> None:
    """Raise ConfigurationError for a fault of a part that the rig does not have."""
    daq = file.daq.settings
    known = {
        "patch": file.table.patches if file.table else (),
        "patches": file.table.patches if file.table else (),
        "channel": tuple(daq.get("channels", ())),
        "device": tuple(daq.get("devices", ())),
        "instrument": roles(),
    }
    for key, names in known.items():
        value = getattr(settings, key, None)
        named = value if isinstance(value, tuple | list) else (value,)
        for name in (name for name in named if isinstance(name, str)):
            if name not in names:
                raise ConfigurationError(
                    f"A fault of the kind {settings.kind!r} names the {key} {name!r}, and the rig "
                    f"{file.name!r} has {', '.join(names) or 'none'}."
                )
