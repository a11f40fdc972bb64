"""Files in TOML as models; what is wrong with one is one sentence with its place, its line and its key.

Python's parser gives no line numbers of keys, which are found here.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from .errors import ConfigurationError
from .files import os_error_text
from .wording import did_you_mean

Location = tuple[str | int, ...]
"""Location of a key: names of tables and keys, and indices within arrays."""

Places = tuple[str, dict[Location, int]]
"""A file, and the line numbers of its keys (`key_lines`)."""

_PART = r"(?:[\w-]+|\"[^\"]*\"|'[^']*')"
_NAME = rf"({_PART}(?:\s*\.\s*{_PART})*)"
_TABLE = re.compile(rf"\s*\[\s*{_NAME}\s*\]")
_TABLES = re.compile(rf"\s*\[\[\s*{_NAME}\s*\]\]")
_KEY = re.compile(rf"\s*{_NAME}\s*=(.*)")
_STRING = re.compile(r'"(?:[^"\\]|\\.)*"|\'[^\']*\'')
_DEEP = re.compile(r"""(?<![\w-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){100}""")
_LONG = re.compile(r'"""|\'\'\'')


def read_text(path: Path, missing: str) -> str:
    """Text of a file that a person wrote. Raises ConfigurationError; `missing` says that there is none."""
    try:
        return path.read_text(encoding="utf-8-sig")  # Notepad begins a file with a byte order mark
    except FileNotFoundError:
        raise ConfigurationError(missing) from None
    except UnicodeDecodeError:
        raise ConfigurationError(f"{path} is not text in UTF-8: save it as that.") from None
    except OSError as error:
        raise ConfigurationError(f"{path} cannot be read: {os_error_text(error)}.") from None


def parse_toml(text: str, path: Path) -> dict[str, Any]:
    """The tables and keys in the text of the file `path`. Raises ConfigurationError."""
    try:
        # Python's parser takes 1.6 GB for a key of 20,000 parts, which are 40 kB.
        if _DEEP.search(text):
            raise RecursionError
        return tomllib.loads(text)
    except RecursionError:
        raise ConfigurationError(f"{path} is not valid TOML: it is nested too deeply.") from None
    except ValueError as error:  # also for a number of thousands of digits
        raise ConfigurationError(f"{path} is not valid TOML: {error}.") from None


def key_lines(text: str) -> dict[Location, int]:
    """Line numbers, from 1, of the tables and keys of a valid TOML text.

    Keys inside a value (an inline table or an array) have the line of the key of that value.
    """
    lines: dict[Location, int] = {}
    counts: dict[Location, int] = {}
    table: Location = ()
    depth, in_string = 0, False
    for number, line in enumerate(text.splitlines(), start=1):
        rest = line
        if in_string or depth:
            in_string ^= len(_LONG.findall(line)) % 2 == 1
        elif header := _TABLES.match(line):
            name = _numbered(_parts(header[1]), counts)
            counts[name] = counts.get(name, -1) + 1
            table = (*name, counts[name])
            lines[table] = number
            continue
        elif header := _TABLE.match(line):
            table = _numbered(_parts(header[1]), counts)
            lines.setdefault(table, number)
            continue
        elif key := _KEY.match(line):
            lines[(*table, *_parts(key[1]))] = number
            rest = key[2]
            in_string = len(_LONG.findall(rest)) % 2 == 1
        bare = _STRING.sub("", rest).partition("#")[0]
        depth = max(0, depth + len(re.findall(r"[\[{]", bare)) - len(re.findall(r"[\]}]", bare)))
    return lines


def place(files: Sequence[Places], key: Location) -> str:
    """The file and line of a key, or of the nearest table above it."""
    for length in range(len(key), 0, -1):
        for path, lines in files:
            if key[:length] in lines:
                return f"{path}, line {lines[key[:length]]}"
    return files[0][0]


def _parts(name: str) -> Location:
    return tuple(part.strip("\"'") for part in re.findall(_PART, name))


def _numbered(name: Location, counts: dict[Location, int]) -> Location:
    """The location of a table; below an array of tables it belongs to the last element."""
    way: Location = ()
    for part in name[:-1]:
        way = (*way, part)
        if way in counts:
            way = (*way, counts[way])
    return (*way, name[-1])


Model = TypeVar("Model", bound=BaseModel)


def validate(
    model: type[Model],
    raw: object,
    source: str | Callable[[Location], str],
    above: Location = (),
    also: Iterable[str] = (),
) -> Model:
    """Validate `raw` as a `model`; the first error becomes a ConfigurationError of one sentence.

    `source` is the origin of the values, or a function that returns it for a key; `above` is the location
    of `raw` within it, and `also` are keys that may stand there besides the model's.
    """
    try:
        return model.model_validate(raw)
    except ValidationError as error:
        raise ConfigurationError(_sentences(error, model, source, above, also)[0]) from None


def sentences(
    model: type[BaseModel],
    raw: object,
    source: str | Callable[[Location], str],
    above: Location = (),
    also: Iterable[str] = (),
) -> list[str]:
    """Every error that `validate` finds, a sentence each."""
    try:
        model.model_validate(raw)
    except ValidationError as error:
        return _sentences(error, model, source, above, also)
    return []


def _sentences(
    error: ValidationError,
    model: type[BaseModel],
    source: str | Callable[[Location], str],
    above: Location,
    also: Iterable[str],
) -> list[str]:
    # A misspelt key comes before the key that is missing because of it.
    told = []
    for one in sorted(error.errors(), key=lambda e: e["type"] != "extra_forbidden"):
        place = source if isinstance(source, str) else source((*above, *one["loc"]))
        told.append(_sentence(one, model, place, above, also))
    return told


def validate_kind(
    kinds: Mapping[str, type[Model]],
    raw: Mapping[str, Any],
    source: str | Callable[[Location], str],
    above: Location = (),
) -> Model:
    """Validate `raw` as the model that its key `kind` selects among `kinds`; otherwise as `validate`."""
    kind = str(raw.get("kind"))
    if kind not in kinds:
        hint = did_you_mean(kind, kinds, "the kinds are")
        place = source if isinstance(source, str) else source((*above, "kind"))
        raise ConfigurationError(f"{place}: unknown fault kind {kind!r}; {hint}")
    return validate(kinds[kind], raw, source, above)


def _sentence(
    first: ErrorDetails, model: type[BaseModel], place: str, above: Location, also: Iterable[str]
) -> str:
    key = ".".join(str(part) for part in (*above, *first["loc"]))
    if first["type"] == "extra_forbidden":
        top = len(first["loc"]) == 1
        known = {*_keys_at(model, first["loc"][:-1]), *(also if top else ())}
        hint = did_you_mean(str(first["loc"][-1]), known, "known keys are")
        if top and not above and isinstance(first["input"], dict) and "driver" in first["input"]:
            hint += " If another package adds this role, install that package."
        return f"{place}: unknown key {key!r}; {hint}"
    if first["type"] == "missing":
        return f"{place}: the key {key!r} is missing."
    if first["type"] == "value_error":
        # Raised by a validator of haploop, whose message is complete.
        return f"{place}: {f'{key}: ' if key else ''}{first['ctx']['error']}."
    return f"{place}: {key or 'the file'} {told(first)} (found {first['input']!r})."


_MUST = {
    "float_type float_parsing": "must be a number",
    "finite_number": "must be a finite number",
    "int_type int_parsing int_from_float": "must be a whole number",
    "string_type": "must be text",
    "bool_type bool_parsing": "must be true or false",
    "greater_than": "must be above {gt:g}",
    "greater_than_equal": "must be {ge:g} or more",
    "less_than": "must be below {lt:g}",
    "less_than_equal": "must be {le:g} or less",
    "too_short": "must have {min_length} or more entries",
    "too_long": "must have {max_length} entries or fewer",
    "literal_error enum": "must be {expected}",
    "dict_type model_type model_attributes_type": "must be a table",
    "list_type tuple_type": "must be a list",
    "string_too_short": "must have {min_length} or more characters",
    "string_too_long": "must have {max_length} characters or fewer",
}
"""What a value must be, by the types of pydantic's errors."""
_FORMS = {
    r"\S": "must not be blank",
    r"^[^/\s]+/\w+$": 'must be a device and its terminal, such as "Dev1/ai0"',
    r"^[A-Za-z0-9]{1,12}-[A-Za-z0-9]{1,12}$": 'must be a serial number, such as "MXCOUPL1-12345"',
    r"^VeloDec,\d$": 'must be a decoder, "VeloDec,0" to "VeloDec,9"',
    r"^[A-Za-z0-9][A-Za-z0-9 _.-]{0,39}$": "must be at most 40 letters, digits, spaces, _, . and -, and "
    "begin with a letter or digit",
}
"""What a text must be, by the pattern of its field."""


def told(error: ErrorDetails) -> str:
    """What a value must be, in our own words as far as there are any."""
    if error["type"] == "string_pattern_mismatch":
        return _FORMS.get(error["ctx"]["pattern"], "has not the form that is needed here")
    for types, words in _MUST.items():
        if error["type"] in types.split():
            return words.format(**error.get("ctx", {}))
    return f"is wrong: {error['msg'][:1].lower()}{error['msg'][1:]}"


def _keys_at(kind: Any, location: Location) -> list[str]:
    """The keys of the table at `location` below a model or another annotation."""
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        if not location:
            return list(kind.model_fields)
        field = kind.model_fields.get(str(location[0]))
        if field is None:
            return []
        # A sensor is described by the keys of another model than its own (`instruments.sensors.Described`).
        described = next((one.table for one in field.metadata if hasattr(one, "table")), None)
        return _keys_at(described or field.annotation, location[1:])
    # A mapping or a sequence is one level of the location, a union none.
    step = int(get_origin(kind) in (dict, tuple, list))
    return [key for inner in get_args(kind) for key in _keys_at(inner, location[step:])]
