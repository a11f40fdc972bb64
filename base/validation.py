"""Tables of a file as models; what is wrong with one is one sentence with its place and its key."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from .errors import ConfigurationError
from .toml_lines import Location
from .wording import did_you_mean

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
