"""A form's values as TOML, with what its model says of each key as a comment."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from typing import Any

from ...base.errors import ConfigurationError

_DEEPEST = 8
_BARE = re.compile(r"[A-Za-z0-9_-]+")


def toml_text(values: Mapping[str, Any], schema: Mapping[str, Any]) -> str:
    """Return tables, arrays of tables and keys as a TOML text; None and {} are left out.

    `schema` is the JSON schema of the model that will read it. Raises ConfigurationError for what is no text
    in UTF-8 or is nested too deeply.
    """
    try:
        text = "\n".join(_lines(values, schema)).lstrip("\n") + "\n"
        text.encode()
    except (UnicodeEncodeError, RecursionError):
        raise ConfigurationError(
            "The form holds what a file cannot: text that is not UTF-8, or nested too deeply."
        ) from None
    return text


def _lines(values: Mapping[str, Any], schema: Mapping[str, Any]) -> Iterator[str]:
    kept = {name: value for name, value in values.items() if value not in (None, {})}
    tables = {name for name, value in kept.items() if isinstance(value, dict) or _is_tables(value)}
    yield from _keys({name: value for name, value in kept.items() if name not in tables}, schema, schema)
    for name in (name for name in kept if name in tables):
        one = _model(schema["properties"].get(name, {}), schema)
        several = isinstance(kept[name], list)
        for table in kept[name] if several else [kept[name]]:
            yield f"\n[[{_key(name)}]]" if several else f"\n[{_key(name)}]"
            yield from _keys(table, one, schema)


def _is_tables(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(one, dict) for one in value)


def _keys(values: Mapping[str, Any], model: Mapping[str, Any], schema: Mapping[str, Any]) -> Iterator[str]:
    for name, value in values.items():
        if value in (None, {}):
            continue
        line = f"{_key(name)} = {_value(value)}"
        said = _model(model.get("properties", {}).get(name, {}), schema).get("description", "")
        comment = " ".join(said.replace("`", "").split())
        yield f"{line:<40}  # {comment}" if comment else line


def _model(one: Mapping[str, Any], schema: Mapping[str, Any]) -> Mapping[str, Any]:
    """What a key may hold: behind a reference, the items of an array of tables, what is not null."""
    options = [option for option in one.get("anyOf", [one]) if option.get("type") != "null"]
    found = options[0] if len(options) == 1 else one
    found = found if "$ref" not in found.get("items", {}) else found["items"]
    if "$ref" in found:
        found = schema["$defs"][found["$ref"].rpartition("/")[2]]
    return {**found, **({"description": one["description"]} if "description" in one else {})}


def _key(name: str) -> str:
    return name if _BARE.fullmatch(name) else _text(name)


def _text(value: str) -> str:
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _value(value: Any, depth: int = 0) -> str:
    if depth > _DEEPEST:
        raise RecursionError
    match value:
        case str():
            return _text(value)
        case bool():
            return "true" if value else "false"
        case list():
            return f"[{', '.join(_value(one, depth + 1) for one in value)}]"
        case dict():
            some = (f"{_key(k)} = {_value(v, depth + 1)}" for k, v in value.items() if v is not None)
            return f"{{ {', '.join(some)} }}"
        case _:
            return repr(value)
