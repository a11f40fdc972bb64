"""Making an experiment or a study on a page: duplicate one, change it in a form, preview a trial, save.

The file stays what is made: the form's values become its text, and the loader that every command has reads
it, so that a refusal is the same sentence as there. Nothing that exists is changed.
"""

from __future__ import annotations

import asyncio
import json
import re
import shutil
import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from pydantic import BaseModel
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from ...acquisition.session import StudyFile, load_study_file
from ...base.errors import ConfigurationError, HaploopError
from ...base.files import new_file, private_files
from ...experiments import ExperimentFile, balance_of, example_names, load_experiment
from ...experiments.shown import first_steps, steps_grid
from ...reports.contents import Contents, Grid
from ..data_folder import DataFolder
from .conductor import question
from .security import json_object
from .shown_routes import contents_json

_FOLDER = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,59}")
_RIG = ", the rig plays digital buttons"
"""Behind the name of an example: its lines with "#:" are taken in."""
_FIRST_STUDY = {
    "name": "study",
    "buttons": ["latch", "toggle", "push"],
    "participants": ["P01", "P02", "P03"],
}


@dataclass(frozen=True)
class _Kind:
    """An experiment, or a study: its file, its model, what its loader finds and a preview shows."""

    file: str
    model: type[BaseModel]
    load: Callable[[Path], Any]
    preview: Callable[[Any], dict[str, Any]]


def design_routes(data: DataFolder) -> list[Route]:
    """Return the routes."""

    def route(path: str, act: Callable[[DataFolder, Mapping[str, Any]], Any], method: str) -> Route:
        async def answer(request: Request) -> Response:
            try:
                values = await json_object(request) if method == "POST" else request.query_params
                return JSONResponse(await asyncio.to_thread(act, data, values))
            except HaploopError as error:
                return JSONResponse({"error": str(error)}, 409)

        return Route(path, answer, methods=[method])

    return [
        route("/api/design", _begin, "GET"),
        route("/api/design/preview", _preview, "POST"),
        route("/api/design/save", _save, "POST"),
    ]


def _begin(data: DataFolder, asked: Mapping[str, str]) -> dict[str, Any]:
    """What can be duplicated, the schema of the form, and the values of the one that was chosen."""
    kind, source = _kind(asked), asked.get("from", "")
    folders = [name.removesuffix(f"/{kind.file}") for name in data.found(f"*/{kind.file}")]
    examples = [*_examples()] if kind.model is ExperimentFile else ["example"]
    values = dict[str, Any]()
    if asked.get("example"):
        values = _example(kind, asked["example"])
    elif source:
        path = data.path(f"{source}/{kind.file}")
        kind.load(path)
        values = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    return {"examples": examples, "folders": folders, "schema": _schema(kind.model), "values": values}


@cache
def _schema(model: type[BaseModel]) -> dict[str, Any]:
    return model.model_json_schema()


@cache
def _examples() -> dict[str, str]:
    """The text of each shipped experiment, and once more with the digital buttons that a rig plays in it."""
    found = {}
    for name in example_names():
        text = load_experiment(name).path.read_text(encoding="utf-8")
        found[name] = text
        if "\n#:" in text:
            found[name + _RIG] = re.sub(r"^#: ?", "", text, flags=re.MULTILINE)
    return found


def _example(kind: _Kind, name: str) -> dict[str, Any]:
    if kind.model is StudyFile:
        return _FIRST_STUDY
    if name not in _examples():
        raise ConfigurationError(f"There is no example {name[:40]!r}: choose another.")
    return tomllib.loads(_examples()[name])


def _kind(asked: Mapping[str, Any]) -> _Kind:
    return _KINDS["study" if asked.get("kind") == "study" else "experiment"]


def _preview(_: DataFolder, asked: Mapping[str, Any]) -> dict[str, Any]:
    """The text of the file; what the loader refuses, or what a session would be."""
    kind = _kind(asked)
    text = _text(kind, asked)
    with TemporaryDirectory() as place:
        try:
            return {"text": text, "problem": "", **kind.preview(_loaded(kind, Path(place), "form", text))}
        except HaploopError as error:
            return {"text": text, "problem": str(error)}


def _text(kind: _Kind, asked: Mapping[str, Any]) -> str:
    values = asked.get("values")
    if not isinstance(values, Mapping):
        raise ConfigurationError("The form has no values.")
    return toml_text(values, _schema(kind.model))


def _loaded(kind: _Kind, place: Path, folder: str, text: str) -> Any:
    """Write the file into a folder that only begins to be, and load it."""
    path = place / folder / kind.file
    path.parent.mkdir()
    with new_file(path) as part:
        part.write_text(text, encoding="utf-8", newline="\n")
    try:
        return kind.load(path)
    except HaploopError as error:
        said = str(error).replace(f"{path.parent}/", "").replace(str(path.parent), "the new folder")
        raise type(error)(said) from None


@private_files()
def _save(data: DataFolder, asked: Mapping[str, Any]) -> dict[str, str]:
    """Make the folder, with the digital buttons that it names, all at once."""
    kind, folder = _kind(asked), str(asked.get("folder") or "")
    if not _FOLDER.fullmatch(folder):
        raise ConfigurationError(
            "The folder's name has up to 60 letters, digits, _ and -, such as matching-2."
        )
    path = data.path(folder)
    if path.exists():
        raise ConfigurationError(
            f"There is {folder} already, and nothing is overwritten: choose another name."
        )
    text, source = _text(kind, asked), str(asked.get("from") or "buttons")
    data.root.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=data.root, prefix=".") as place:
        loaded = _loaded(kind, Path(place), folder, text)
        if kind.model is ExperimentFile:
            for name in dict.fromkeys(
                (*loaded.file.buttons.values(), *loaded.file.surface.releases.values())
            ):
                _copy(data, (f"{source}/{name}", f"buttons/{name}"), Path(place) / folder / name)
        (Path(place) / folder).rename(path)
    return {"saved": folder}


def _copy(data: DataFolder, names: tuple[str, ...], to: Path) -> None:
    found = next((path for path in map(data.path, names) if path.is_file()), None)
    if found is None:
        raise ConfigurationError(
            f"There is no {' nor '.join(names)}: make the digital button on its page, or name another file."
        )
    to.parent.mkdir(parents=True, exist_ok=True)
    with new_file(to) as part:
        shutil.copyfile(found, part)


def _experiment(loaded: Any) -> dict[str, Any]:
    """The blocks of the first participant's first day, and the first trial as the participant sees it."""
    file: ExperimentFile = loaded.file
    multiple = balance_of(file, []).multiple_of
    said = [f"A multiple of {multiple} participants is balanced."] if multiple > 1 else []
    trial = next(one for one in first_steps(file) if not one.by_hand)
    shown = {"block": trial.block, "number": 1, "of": 0 if trial.kind == "staircase" else trial.of}
    ask = question(file, trial, "preview")
    return {
        "shown": contents_json(Contents("", [], [steps_grid(file)], said)),
        "trial": {"step": shown, "ask": ask},
    }


def _study(file: StudyFile) -> dict[str, Any]:
    """The order of the buttons and the presses of each participant."""
    rows = [
        (who, ", ".join(file.order_for(who)), str(sum(map(file.presses_of, file.buttons))))
        for who in file.participants
    ]
    grid = Grid("Sessions", ("Participant", "Order of the buttons", "Presses"), rows, words=2)
    return {"shown": contents_json(Contents("", [], [grid], []))}


_KINDS = {
    "experiment": _Kind("experiment.toml", ExperimentFile, load_experiment, _experiment),
    "study": _Kind("study.toml", StudyFile, load_study_file, _study),
}


# A form's values as TOML, with what its model says of each key as a comment.

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
    return name if _BARE.fullmatch(name) else _quoted(name)


def _quoted(value: str) -> str:
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _value(value: Any, depth: int = 0) -> str:
    if depth > _DEEPEST:
        raise RecursionError
    match value:
        case str():
            return _quoted(value)
        case bool():
            return "true" if value else "false"
        case list():
            return f"[{', '.join(_value(one, depth + 1) for one in value)}]"
        case dict():
            some = (f"{_key(k)} = {_value(v, depth + 1)}" for k, v in value.items() if v is not None)
            return f"{{ {', '.join(some)} }}"
        case _:
            return repr(value)
