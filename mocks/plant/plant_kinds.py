"""Installed kinds of plant, and the surface of a rig file.

The set is open: an entry point of the group `haploop.plants` names a subclass of `PlantSettings`. A kind is
loaded only when a rig file names it, so that a broken package does not affect other rigs.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from ...base import entry_points
from ...base.errors import ConfigurationError, HaploopError, InstrumentError
from ...base.validation import validate
from ...instruments.config import RigFile
from .hysteresis import PatchLaw
from .modal_surface import ModalSurface
from .places import OnSurface
from .softening import SofteningSurface
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
