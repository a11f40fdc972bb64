"""A new rig file from answers: one part of the rig after the other, then the whole is validated.

What an answer leaves open is written as a key with a comment. The file appears whole or not at all.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from pathlib import Path

from ..config import RigFile, load_rig_file
from ..errors import ConfigurationError
from ..files import check_destination, new_file
from .found import Found
from .interview import Ask, Interview
from .parts import Parts, daq, driven, sensors

_TRIES = 5


def new_rig(path: str | Path, ask: Ask, found: Found, tell: Callable[[str], object]) -> RigFile:
    """Ask for a rig's parts, and write them into the new rig file `path`; return it as it is read.

    `ask(question, default)` asks a person, `found` is what is offered, `tell` says what is wrong: then all is
    asked again, with the answers as defaults. Raises ConfigurationError when the file exists, cannot be
    written, or is not right after five times.
    """
    path = Path(path)
    check_destination(path)
    for sentence in found.missing:
        tell(sentence)
    interview = Interview(ask, tell)
    for _ in range(_TRIES):
        text = _text(path.stem, interview, found)
        try:
            file = _read(text)
        except ConfigurationError as error:
            tell(f"That is no rig yet. {error}")
            continue
        with new_file(path) as part:
            part.write_text(text, encoding="utf-8")
        return file
    raise ConfigurationError(
        f"{path} was not written: see docs/how-to/describe-your-rig.md, and write it by hand."
    )


def new_rig_on(path: str | Path, base: str, name: str = "") -> RigFile:
    """Write the new rig file `path` on a base (a rig file, or a shipped rig's name); return it as it is read.

    `name` is the rig's, by default the file's. Raises ConfigurationError when the base is not valid, and when
    the file exists or cannot be written.
    """
    path = Path(path)
    check_destination(path)
    load_rig_file(base)
    found = str(Path(base).resolve()) if Path(base).is_file() else base
    with new_file(path) as part:
        part.write_text(
            f"base = {json.dumps(found)}\nname = {json.dumps(name or path.stem)}\n", encoding="utf-8"
        )
    return load_rig_file(path)


def _read(text: str) -> RigFile:
    with tempfile.TemporaryDirectory() as folder:
        draft = Path(folder) / "rig.toml"
        draft.write_text(text, encoding="utf-8")
        try:
            return load_rig_file(draft)
        except ConfigurationError as error:
            raise ConfigurationError(str(error).replace(f"{draft}: ", "").replace(f"{draft}, ", "")) from None


def _text(name: str, interview: Interview, found: Found) -> str:
    parts = Parts(interview, found)
    daq(parts)
    sensors(parts)
    driven(parts)
    lines = [f"name = {json.dumps(name)}"]
    lines += [f"{key} = {value}" for key, value in parts.top.items()]
    for table, keys in parts.tables.items():
        if keys:
            lines += ["", f"[{table}]", *(f"{key} = {value}" for key, value in keys.items())]
    return "\n".join(lines) + "\n"
