"""The JSON schema of rig files, so that an editor completes keys and marks wrong ones while typing."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel

from ...base import entry_points
from ...base.errors import ConfigurationError
from ..config import RigFile, fault_kinds, roles


def rig_schema() -> dict[str, Any]:
    """Build the schema of rig files, with the installed drivers and faults.

    No key is required, because a file with a base states only its differences; haploop reports a
    missing key when it loads the file.
    """
    schema = RigFile.model_json_schema()
    definitions: dict[str, Any] = schema["$defs"]
    broken: list[str] = []
    for role in roles():
        schema["properties"][role] = _chosen("driver", _settings_of(role, broken), definitions)
    schema["additionalProperties"] = False
    simulation = definitions["SimulationSettings"]
    faults = simulation["properties"]["faults"]
    _any_plant(simulation, definitions, broken)
    faults["items"] = _chosen("kind", _usable(fault_kinds(), broken), definitions)
    if broken:
        schema["$comment"] = " ".join(broken)
    schema["properties"]["base"] = {
        "type": "string",
        "description": "Another rig file; this one states only its differences from it.",
    }
    del definitions["Device"]
    _soften(schema)
    return {"$schema": "http://json-schema.org/draft-07/schema#", **schema, "title": "A rig of haploop"}


def _settings_of(role: str, broken: list[str]) -> dict[str, type[BaseModel]]:
    """Settings of each driver of a role. One that cannot be loaded is left out; its error is in `broken`."""
    settings: dict[str, type[BaseModel]] = {}
    try:
        kind = entry_points.role_class(role)
    except ConfigurationError as error:
        broken.append(str(error))
        return settings
    for name in entry_points.installed(entry_points.DRIVERS):
        try:
            driver = entry_points.driver_class(name)
            if issubclass(driver, kind):
                settings[name] = driver.Settings
        except ConfigurationError as error:
            if str(error) not in broken:
                broken.append(str(error))
    return settings


def _any_plant(simulation: dict[str, Any], definitions: dict[str, Any], broken: list[str]) -> None:
    """Allow the settings of the installed plants in the schema of `[simulation]`, each with its plant."""
    plants: dict[str, type[BaseModel]] = {}
    for name in entry_points.installed(entry_points.PLANTS):
        try:
            plants[name] = entry_points.plant_class(name)
        except ConfigurationError as error:
            broken.append(str(error))
    rules = _chosen("plant", plants, definitions)["allOf"]
    default = simulation["properties"]["plant"]["default"]
    for rule in rules:
        rule["then"]["properties"] = {**simulation["properties"], **rule["then"]["properties"]}
        if rule["if"]["properties"]["plant"]["const"] == default:
            rule["if"]["required"] = []  # it holds without the key, too
    simulation["properties"]["plant"]["enum"] = sorted(plants)
    simulation["allOf"] = rules


def _usable(kinds: Mapping[str, type[BaseModel]], broken: list[str]) -> dict[str, type[BaseModel]]:
    """Settings of each kind of fault that can be loaded; errors of the others are added to `broken`."""
    usable: dict[str, type[BaseModel]] = {}
    for kind in kinds:
        try:
            usable[kind] = kinds[kind]
        except ConfigurationError as error:
            broken.append(str(error))
    return usable


def _chosen(key: str, choices: Mapping[str, type[BaseModel]], definitions: dict[str, Any]) -> dict[str, Any]:
    """A table whose other keys are those of the model that `key` chooses."""
    rules = []
    for name, model in choices.items():
        # Definitions of two models may share a name, so each is prefixed by its model's.
        own = model.model_json_schema(ref_template=f"#/$defs/{name}.{{model}}")
        definitions |= {f"{name}.{inner}": value for inner, value in own.pop("$defs", {}).items()}
        own["properties"] = {**own["properties"], key: {"const": name}}
        rules.append({"if": {"properties": {key: {"const": name}}}, "then": own})
    table = {"type": "object", "properties": {key: {"type": "string", "enum": sorted(choices)}}}
    return {**table, "allOf": rules}


def _soften(schema: Any) -> None:
    """Remove lists of required keys, and infinite defaults, which JSON cannot express."""
    if isinstance(schema, list):
        for value in schema:
            _soften(value)
    elif isinstance(schema, dict):
        if isinstance(schema.get("required"), list):
            del schema["required"]
        if isinstance(schema.get("default"), float) and math.isinf(schema["default"]):
            del schema["default"]
        for name, value in schema.items():
            if name == "if":
                value.setdefault("required", list(value["properties"]))
            else:
                _soften(value)
