"""The kinds of fault that are installed, and the faults of a rig file.

The set is open: an entry point of the group `haploop.faults` names a subclass of `Fault`. A kind is loaded
when a rig file asks for it, so a broken package is in nobody else's way.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from importlib import metadata
from typing import overload

import numpy as np

from haploop.instruments.config import ROLES, RigFile, validate_kind
from haploop.instruments.errors import ConfigurationError
from haploop.mocks.plant.fault import Fault, FaultSettings

__all__ = ["KINDS", "FaultKinds", "Faults", "fault_class"]

_GROUP = "haploop.faults"


class FaultKinds(Mapping[str, type[FaultSettings]]):
    """The settings of each kind of fault that is installed now, by the name that rig files give it."""

    def __getitem__(self, kind: str) -> type[FaultSettings]:
        return fault_class(kind).Settings

    def __contains__(self, kind: object) -> bool:
        return any(entry.name == kind for entry in metadata.entry_points(group=_GROUP))

    def __iter__(self) -> Iterator[str]:
        return iter(dict.fromkeys(entry.name for entry in metadata.entry_points(group=_GROUP)))

    def __len__(self) -> int:
        return len(list(iter(self)))


KINDS = FaultKinds()
"""See `FaultKinds`."""


def fault_class(kind: str) -> type[Fault]:
    """The class of a kind of fault. Raises KeyError for one that is not installed.

    Raises ConfigurationError, which names the package, for a kind that cannot be imported or is no fault,
    and for a name that two packages give.
    """
    found = list(metadata.entry_points(group=_GROUP, name=kind))
    if not found:
        raise KeyError(kind)
    if len(found) > 1:
        packages = " and ".join(sorted(_package(entry) for entry in found))
        raise ConfigurationError(
            f"The fault kind {kind!r} is given by {packages}: uninstall all but one of them."
        )
    (entry,) = found
    try:
        loaded = entry.load()
    except Exception as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())
        raise ConfigurationError(
            f"The fault kind {kind!r} of {_package(entry)} cannot be imported ({reason}): repair or "
            "uninstall the package, or take the fault out of the rig file."
        ) from None
    settings = getattr(loaded, "Settings", None)
    if not (isinstance(loaded, type) and issubclass(loaded, Fault)) or not (
        isinstance(settings, type) and issubclass(settings, FaultSettings)
    ):
        raise ConfigurationError(
            f"The fault kind {kind!r} of {_package(entry)} is not a fault: its entry point {entry.value!r} "
            "must name a subclass of haploop.mocks.plant.Fault, whose Settings are a FaultSettings."
        )
    return loaded


def _package(entry: metadata.EntryPoint) -> str:
    return f"the package {entry.dist.name!r}" if entry.dist else f"the module {entry.module!r}"


class Faults(Sequence[Fault]):
    """All faults of a plant, in the order of the rig file."""

    def __init__(self, faults: Sequence[Fault] = ()) -> None:
        self._faults = tuple(faults)

    @classmethod
    def of_file(cls, file: RigFile) -> Faults:
        """The faults of a rig file. Raises ConfigurationError for one that the rig cannot have."""
        faults = []
        for index, raw in enumerate(file.simulation.faults):
            settings = validate_kind(KINDS, raw, f"simulation.faults.{index} of {file.name}")
            _refuse(settings, file)
            rng = np.random.default_rng([file.simulation.seed, 0xFA017, index])
            faults.append(fault_class(settings.kind)(settings, file, rng))
        return cls(faults)

    @overload
    def __getitem__(self, index: int) -> Fault: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Fault]: ...
    def __getitem__(self, index: int | slice) -> Fault | Sequence[Fault]:
        return self._faults[index]

    def __len__(self) -> int:
        return len(self._faults)


def _refuse(settings: FaultSettings, file: RigFile) -> None:
    """Raises ConfigurationError for a fault of something that the rig does not have."""
    daq = file.daq.settings
    known = {
        "patch": file.table.patches if file.table else (),
        "patches": file.table.patches if file.table else (),
        "channel": tuple(daq.get("channels", ())),
        "device": tuple(daq.get("devices", ())),
        "instrument": ROLES,
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
