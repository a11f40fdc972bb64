"""Parse a TOML file, and find the line numbers of its keys, which Python's parser does not give."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .errors import ConfigurationError
from .files import os_error_text

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
