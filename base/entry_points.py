"""Entry points of installed packages, and packages of optional extras: loaded where they are needed.

haploop's own are found in the same way, except its faults (`mocks/faults/`). Only those that a rig needs
are loaded, so that a broken package affects only the rigs that use it.
"""

from __future__ import annotations

import importlib
import os
import sys
from contextlib import suppress
from functools import lru_cache
from importlib import metadata
from inspect import isabstract
from typing import Any

from pydantic import BaseModel

from .errors import ConfigurationError
from .signals import uninterrupted
from .wording import did_you_mean

ROLES, DRIVERS, TWINS, WIRES = "haploop.roles", "haploop.drivers", "haploop.twins", "haploop.wires"
FAULTS, PLANTS, SIMULATION = "haploop.faults", "haploop.plants", "haploop.simulation"


def installed(group: str) -> tuple[str, ...]:
    """Names of a group's entry points, sorted. Nothing is loaded."""
    return tuple(sorted(entries(group).names))


def load(group: str, name: str) -> Any:
    """Load the object that an entry point names.

    Raises ConfigurationError, which names the package, when it cannot be loaded or called, when two
    packages add the same name, and when none does.
    """
    found = tuple(entries(group, name))
    if not found:
        raise ConfigurationError(
            f"There is no {_kind(group)} {name!r}; installed are {', '.join(installed(group)) or 'none'}."
        )
    if len(found) > 1:
        raise ConfigurationError(
            f"{named(group, name)} is added more than once: uninstall all but one of these packages."
        )
    try:
        # Ctrl-C would leave half of a module, which cannot be imported again.
        with uninterrupted():
            loaded = found[0].load()
    except (Exception, SystemExit) as error:  # importing another's package runs its code: anything may come
        told = " ".join(f"{type(error).__name__}: {error}".split())
        raise ConfigurationError(
            f"{named(group, name)} cannot be loaded ({told}): install that package again, or ask its author."
        ) from error
    if not callable(loaded):
        raise ConfigurationError(
            f"{named(group, name)} must be a class or a function, and is an object of "
            f"{type(loaded).__name__}: ask the package's author."
        )
    return loaded


def name_of(group: str, kind: type[Any]) -> str | None:
    """Return the name of the entry point that names a class, or None. Nothing is loaded."""
    value = f"{kind.__module__}:{kind.__qualname__}"
    return next((entry.name for entry in entries(group) if entry.value == value), None)


def role_class(role: str) -> type[Any]:
    """Load the abstract class of a role. Raises ConfigurationError, which names the package."""
    kind = load(ROLES, role)
    if not isinstance(kind, type):
        raise ConfigurationError(
            f"{named(ROLES, role)} must be a class, and is an object of {type(kind).__name__}: ask the "
            "package's author."
        )
    return kind


def driver_class(name: str, role: str | None = None) -> type[Any]:
    """Load the driver `name`: a class with Settings and `open`, and a subclass of `role`'s class if given.

    Raises ConfigurationError, which names the package, for anything else.
    """
    driver = load(DRIVERS, name)
    if not isinstance(driver, type):
        wrong = f"must be a class, and is an object of {type(driver).__name__}: ask the package's author."
    elif not _is_model(getattr(driver, "Settings", None)):
        wrong = "must have a class Settings, a pydantic model: ask the package's author."
    elif not callable(getattr(driver, "open", None)):
        wrong = "must have a method open(settings, clock): ask the package's author."
    elif role is not None and not issubclass(driver, role_class(role)):
        wrong = f"is not for the role {role!r}: name another driver in [{role}]."
    else:
        return driver
    raise ConfigurationError(f"{named(DRIVERS, name)} {wrong}")


def unknown_driver(name: str, role: str) -> str:
    """A sentence about a driver that is not installed, with those of its role."""
    fitting = []
    for one in installed(DRIVERS):
        with suppress(ConfigurationError):  # of another role
            driver_class(one, role)
            fitting.append(one)
    article = "an" if role[:1] in "aeiou" else "a"
    return f"there is no driver {name!r} of {article} {role}; " + did_you_mean(name, fitting, "installed are")


def plant_class(name: str) -> type[BaseModel]:
    """Load the settings of the plant `name`. Raises ConfigurationError, which names the package."""
    kind = load(PLANTS, name)
    if not _is_model(kind) or not callable(getattr(kind, "make", None)) or isabstract(kind):
        raise ConfigurationError(
            f"{named(PLANTS, name)} must be a pydantic model, with a method make(file, rng): ask the "
            "package's author."
        )
    return kind  # type: ignore[no-any-return]


def entries(group: str, name: str | None = None) -> metadata.EntryPoints:
    """Return a group's entry points, or those of a name. Nothing is loaded."""
    found = _of(group, tuple((path, _changed(path)) for path in sys.path))
    return found if name is None else found.select(name=name)


@lru_cache(maxsize=32)
def _of(group: str, places: tuple[tuple[str, int | None], ...]) -> metadata.EntryPoints:
    found: metadata.EntryPoints = _installed(places).select(group=group)
    return found


@lru_cache(maxsize=1)
def _installed(_places: tuple[tuple[str, int | None], ...]) -> Any:
    """Read the entry points of all packages, once for all groups: it takes tens of milliseconds.

    They are read again when a package was added or removed, which changes the time of its folder. Python 3.11
    returns groups, and later ones EntryPoints; both select.
    """
    return metadata.entry_points()


def _changed(path: str) -> int | None:
    try:
        return os.stat(path).st_mtime_ns  # noqa: PTH116  a Path takes four times as long
    except OSError:
        return None


def _is_model(kind: object) -> bool:
    return isinstance(kind, type) and issubclass(kind, BaseModel)


def _kind(group: str) -> str:
    return group.removeprefix("haploop.").removesuffix("s")


def named(group: str, name: str) -> str:
    """Describe an entry point by its name and its package, to begin a sentence."""
    found = entries(group, name)
    packages = sorted(entry.dist.name if entry.dist else "(unknown)" for entry in found)
    return f"The {_kind(group)} {name!r} of the package {' and '.join(packages)}"


# Packages of optional extras, loaded where they are needed.


def optional(module: str, extra: str, user: str) -> Any:
    """Import `module` for `user`, the subject of the error's sentence.

    Raises ConfigurationError, which names the package and the extra to install.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        raise ConfigurationError(
            f'{user} needs {package}, which does not load ({error}): pip install "haploop[{extra}]".'
        ) from None
