"""The JSON schema of rig files, so that an editor completes keys and marks wrong ones while typing."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from importlib import metadata
from typing import Any

from pydantic import BaseModel

from haploop.instruments.config import RigFile, fault_kinds
from haploop.instruments.errors import ConfigurationError
from haploop.instruments.rig.roles import ROLES

__all__ = ["rig_schema"]


def rig_schema() -> dict[str, Any]:
    """The schema of rig files, with the drivers and the faults that are installed here.

    No key is required: a file with a base says only what differs, and haploop itself says what is
    missing in the end.
    """
    schema = RigFile.model_json_schema()
    definitions: dict[str, Any] = schema["$defs"]
    for role, kind in ROLES.items():
        drivers = {e.name: e.load() for e in metadata.entry_points(group="haploop.drivers")}
        settings = {name: driver.Settings for name, driver in drivers.items() if issubclass(driver, kind)}
        schema["properties"][role] = _chosen("driver", settings, definitions)
    faults = definitions["SimulationSettings"]["properties"]["faults"]
    faults["items"] = _chosen("kind", _usable(fault_kinds()), definitions)
    schema["properties"]["base"] = {
        "type": "string",
        "description": "Another rig file, of which this one says only how it differs.",
    }
    del definitions["Device"]
    _soften(schema)
    return {"$schema": "http://json-schema.org/draft-07/schema#", **schema, "title": "A rig of haploop"}


def _usable(kinds: Mapping[str, type[BaseModel]]) -> dict[str, type[BaseModel]]:
    """Those kinds of fault that can be loaded: a broken one is told to the rig that asks for it."""
    usable = {}
    for kind in kinds:
        with suppress(ConfigurationError):
            usable[kind] = kinds[kind]
    return usable


def _chosen(key: str, choices: Mapping[str, type[BaseModel]], definitions: dict[str, Any]) -> dict[str, Any]:
    """A table whose other keys are those of the model that `key` chooses."""
    rules = []
    for name, model in choices.items():
        # Definitions of two models may share a name: each model's get its own in front.
        own = model.model_json_schema(ref_template=f"#/$defs/{name}.{{model}}")
        definitions |= {f"{name}.{inner}": value for inner, value in own.pop("$defs", {}).items()}
        own["properties"] = {**own["properties"], key: {"const": name}}
        rules.append({"if": {"properties": {key: {"const": name}}}, "then": own})
    table = {"type": "object", "properties": {key: {"type": "string", "enum": sorted(choices)}}}
    return {**table, "allOf": rules}


def _soften(schema: Any) -> None:
    """Take out what a file need not have, and infinite defaults, for which JSON has no word."""
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
                value["required"] = list(value["properties"])
            else:
                _soften(value)
