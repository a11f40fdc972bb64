"""Read a rig file, its bases and the files that it names, and validate all before anything is opened."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel

from ...base import entry_points
from ...base.errors import ConfigurationError
from ...base.files import beside
from ...base.validation import (
    Location,
    Places,
    key_lines,
    parse_toml,
    place,
    read_text,
    sentences,
    validate,
    validate_kind,
)
from ...base.wording import did_you_mean
from .ati_cal import read_ati_cal
from .contradictions import contradictions
from .rig_file import RigFile, SimulationSettings, roles


def load_rig_file(path: str | Path) -> RigFile:
    """Read and validate a rig file; the bare name of a rig that haploop ships is found as well.

    A file with `base = "NAME"` only states its differences from another rig file (a path beside it,
    or the bare name of a shipped rig). A file that holds nothing but `[simulation]` is the
    simulated rig with another plant. Settings of instruments are validated by their drivers, where
    these are installed.
    Raises ConfigurationError, which names the file, the line, the key, and what was expected.

    For example:

        >>> file = haploop.load_rig_file("usb-6211")
        >>> file.name, file.rate_hz
        ('usb-6211', 5000.0)
    """
    raw, places = _raw(Path(path))
    return _validated(raw, partial(place, places))


def problems_of(path: str | Path) -> list[str]:
    """Every error of a rig file, each as the sentence of `load_rig_file`, and drivers that are not installed.

    An error that hides others comes alone.
    """
    try:
        raw, places = _raw(Path(path))
    except ConfigurationError as error:
        return [str(error)]
    where = partial(place, places)
    drivers = entry_points.installed(entry_points.DRIVERS)
    wrong: list[str] = []
    for role in roles():
        device = raw.get(role)
        if not isinstance(device, dict) or not isinstance(name := device.get("driver"), str):
            continue
        if name not in drivers:
            wrong.append(f"{where((role, 'driver'))}: {entry_points.unknown_driver(name, role)}")
            continue
        try:
            driver = entry_points.driver_class(name, role)
        except ConfigurationError as error:
            wrong.append(f"{where((role, 'driver'))}: {error}")
            continue
        settings = {key: value for key, value in device.items() if key != "driver"}
        wrong += sentences(driver.Settings, settings, where, (role,))
    wrong = [*sentences(RigFile, raw, where, also=roles()), *wrong]
    if not wrong:
        try:
            _validated(raw, where)
        except ConfigurationError as error:
            return [str(error)]
    return wrong


def _validated(raw: dict[str, Any], where: Callable[[Location], str]) -> RigFile:
    file = validate(RigFile, raw, where, also=roles())
    drivers = entry_points.installed(entry_points.DRIVERS)
    settings = {}
    for role, device in file.devices.items():
        if device.driver in drivers:
            driver = entry_points.driver_class(device.driver, role)
            settings[role] = validate(driver.Settings, device.settings, where, (role,))
    for location, clause in contradictions(file, settings):
        raise ConfigurationError(f"{where(location)}: {'.'.join(map(str, location))}: {clause}.")
    if file.simulation.plant in entry_points.installed(entry_points.PLANTS):
        plant = entry_points.plant_class(file.simulation.plant)
        validate(plant, file.simulation.settings, where, ("simulation",), SimulationSettings.model_fields)
    for index, fault in enumerate(file.simulation.faults):
        validate_kind(fault_kinds(), fault, where, ("simulation", "faults", index))
    return file


def _raw(path: Path) -> tuple[dict[str, Any], list[Places]]:
    """Merge a file over its bases, as `_merged_raw`, with the amplifier's monitor as the drive monitor."""
    raw, places = _merged_raw(path, ())
    _take_monitor(raw)
    return raw, places


def _merged_raw(path: Path, above: tuple[Path, ...]) -> tuple[dict[str, Any], list[Places]]:
    """Merge a file over its bases; also return the line numbers of the keys in each, its own first."""
    if path in above:
        raise ConfigurationError(
            f"{above[-1]}: the base {path} is itself based on this file: use another base."
        )
    text = rig_text(path)
    raw = parse_toml(text, path)
    places = (str(path), key_lines(text))
    _read_beside(raw, path)
    base = "simulated" if set(raw) == {"simulation"} else raw.pop("base", None)
    if base is None:
        return raw, [places]
    if not isinstance(base, str):
        raise ConfigurationError(f"{path}: base must be the name of another rig file (found {base!r}).")
    # A rig may be anywhere: of what is no rig file, nothing is shown.
    found = next((one for one in (path.parent / base, Path(base)) if one.is_file()), None)
    if found is None and base not in shipped_rigs():
        meant = did_you_mean(base, shipped_rigs(), "write a file beside this one, or a shipped rig:")
        raise ConfigurationError(f"{place([places], ('base',))}: there is no rig {base!r}: {meant}")
    below, others = _merged_raw(found or Path(base), (*above, path))
    return _merged(below, raw), [places, *others]


def _read_beside(raw: dict[str, Any], path: Path) -> None:
    """Read the files beside the rig file that sensors name: `calibration` (.cal) and `frf` (CSV)."""
    sensors = raw.get("sensors")
    tables = sensors if isinstance(sensors, dict) else {}
    for name, table in tables.items():
        if not isinstance(table, dict):
            continue
        if isinstance(table.get("frf"), str):
            table["frf"] = read_frf(beside(path.parent, table["frf"], str(path)))
        if name == "force" and "calibration" in table:
            if "matrix" in table or not isinstance(table["calibration"], str):
                raise ConfigurationError(
                    f"{path}: sensors.force takes either matrix or calibration (the name of a .cal file)."
                )
            table.update(read_ati_cal(beside(path.parent, table["calibration"], str(path))).table)


def _take_monitor(raw: dict[str, Any]) -> None:
    """Make an amplifier's monitor the drive monitor, in place of what the file or its base has."""
    amplifier = raw.get("amplifier")
    monitor = amplifier.get("monitor") if isinstance(amplifier, dict) else None
    if isinstance(monitor, dict) and {"channel", "scale"} <= set(monitor):
        drive = {"channels": [monitor["channel"]], "ratio": monitor["scale"]}
        sensors = raw.get("sensors", {})
        raw["sensors"] = {**sensors, "drive": drive} if isinstance(sensors, dict) else sensors


def _merged(base: dict[str, Any], own: dict[str, Any], above: str = "") -> dict[str, Any]:
    """Merge `own` over `base`, table by table; one with another driver, plant or kind replaces the base's.

    So does a sensor's with its own channels. `false` in place of a table takes the base's away.
    """
    both = {
        key: _merged(base[key], value, key)
        for key, value in own.items()
        if isinstance(value, dict)
        and isinstance(base.get(key), dict)
        and value.get("driver") in (None, base[key].get("driver"))
        and value.get("plant") in (None, base[key].get("plant", "table"))
        and value.get("kind") in (None, base[key].get("kind"))
        and not (above == "sensors" and "channels" in value)
    }
    away = {key for key, value in own.items() if value is False and isinstance(base.get(key), dict)}
    if "patches" in own:
        # Places of patches that this table does not have would be an error that nobody wrote.
        base = {key: value for key, value in base.items() if key != "patch_places"}
        both.pop("patch_places", None)
    return {key: value for key, value in {**base, **own, **both}.items() if key not in away}


def fault_kinds() -> Mapping[str, type[BaseModel]]:
    """Settings of each kind of fault of the installed plant."""
    kinds: Mapping[str, type[BaseModel]] = entry_points.load(entry_points.SIMULATION, "plant").fault_kinds
    return kinds


def rig_text(path: Path) -> str:
    """Text of a rig file, or of the shipped rig of a bare name. Raises ConfigurationError."""
    # A folder that is named like a rig, as of a calibration of it, is no rig file.
    if path.suffix == "" and path.name == str(path) and not path.is_file():
        return shipped_rig(path.name)
    shipped = ", ".join(shipped_rigs())
    return read_text(
        path, f"There is no rig file {path}: use an existing file, or a shipped rig ({shipped})."
    )


def shipped_rigs() -> list[str]:
    """Names of the rigs that haploop ships."""
    return sorted(p.name[:-5] for p in resources.files("haploop.rigs").iterdir() if p.name.endswith(".toml"))


def shipped_rig(name: str) -> str:
    """Text of a rig file that haploop ships. Raises ConfigurationError."""
    if name not in shipped_rigs():
        meant = did_you_mean(name, shipped_rigs(), "use a rig file, or a shipped rig:")
        raise ConfigurationError(f"There is no rig {name!r}: {meant}")
    return (resources.files("haploop.rigs") / f"{name}.toml").read_text(encoding="utf-8")


# A TOML file that describes one thing, as a validated model.

Model = TypeVar("Model", bound=BaseModel)


def load_model(path: Path, model: type[Model], absent: str) -> Model:
    """Read and validate a file; `absent` says what to do when there is none.

    Raises ConfigurationError: file, line, key, and what is wrong.
    """
    text = read_text(path, absent)
    return validate(model, parse_toml(text, path), partial(place, [(str(path), key_lines(text))]))


# Read a measured frequency response of a sensor: a CSV file with columns of Hz, gain and degrees.

_MOST = 10_000
"""Largest number of rows."""


def read_frf(path: Path) -> dict[str, Any]:
    """Keys of a measured response. Raises ConfigurationError, which names the file and the line."""
    text = read_text(path, f"There is no file {path}, which [sensors] names as frf: correct its name.")
    rows: list[tuple[float, float, float]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.replace(";", ",").replace("\t", ",").split(",")
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        try:
            hz, gain, degrees = (float(word) for word in words)
        except ValueError:
            if not rows and number < 10:  # headings
                continue
            hz = math.nan
        if not (math.isfinite(hz) and hz > 0 and gain > 0 and math.isfinite(gain + degrees)):
            raise ConfigurationError(
                f"{path}, line {number}: a measured response has rows of Hz, gain (1 where the sensor's "
                "scale holds) and degrees, all numbers with a decimal point, the first two above 0."
            )
        if (rows and hz <= rows[-1][0]) or len(rows) >= _MOST:
            raise ConfigurationError(
                f"{path}, line {number}: the frequencies must rise, and be at most {_MOST}: sort the rows."
            )
        rows.append((hz, gain, degrees))
    if len(rows) < 2:
        raise ConfigurationError(
            f"{path} holds no measured response: give it rows of Hz, gain and degrees, separated by commas."
        )
    hz_, gain_, degrees_ = zip(*rows, strict=True)
    return {"hz": hz_, "gain": gain_, "degrees": degrees_, "file": path.name}
