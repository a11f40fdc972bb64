"""The index of the catalogue: an SQLite file in the user's cache, which may be deleted at any time.

It is never a second truth: an entry holds while size and time of its file, and of the rejections beside a
recording, are what they were when it was read. Every question looks at the folders first, and reads what is
new or changed.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import sqlite3
import stat
from collections.abc import Iterator, Sequence
from contextlib import closing
from dataclasses import astuple, fields
from pathlib import Path

from platformdirs import user_cache_path

from ...base.errors import ConfigurationError
from ...base.files import paths_of
from ...base.progress import Progress, silent
from ...base.workers import worker_pool
from .entry import KINDS, Entry, entry_of

_NAMES = [field.name for field in fields(Entry)]
_SHAPE = re.compile(r"\s*(\w+)\s*(!=|>=|<=|=)\s*(.*?)\s*")
_SQL = {"=": "GLOB", "!=": "NOT GLOB", ">=": ">=", "<=": "<="}


def condition(where: Sequence[str]) -> tuple[str, list[str]]:
    """SQL of conditions that must all hold, and its parameters.

    A condition is NAME=VALUE or NAME!=VALUE, where `*` in VALUE stands for anything, or NAME>=VALUE or
    NAME<=VALUE, which compare as text: dates, say, of which the beginning is enough. Raises
    ConfigurationError.
    """
    terms, values = ["1"], []
    for one in where:
        match = _SHAPE.fullmatch(one)
        if match is None or match[1] not in _NAMES:
            raise ConfigurationError(
                f"{one!r} is no condition: write NAME=VALUE, NAME!=VALUE, NAME>=VALUE or NAME<=VALUE with a "
                f"name of {', '.join(_NAMES)}."
            )
        name, operator, value = match.groups()
        if name == "kind" and "*" not in value and value not in KINDS and operator in ("=", "!="):
            raise ConfigurationError(f"There is no kind {value!r}: the kinds are {', '.join(KINDS)}.")
        # `date<=2026-11` includes that month, as `date=2026-11*` does.
        column = f"substr({name}, 1, {len(value)})" if operator == "<=" else name
        terms.append(f"{column} {_SQL[operator]} ?")
        # A bracket is a bracket: GLOB would take it for a set of characters.
        values.append(value.replace("[", "[[]") if operator in ("=", "!=") else value)
    return " AND ".join(terms), values


_VERSION = 4
"""Part of the index's name: to be raised when `Entry` changes."""
_NAMED = ("map.json", "study.toml", "experiment.toml")
_REJECTIONS = "rejections.json"
_KEPT = 500
"""Files after which what was read is kept: an interruption then loses no more, and others wait no longer."""
_ALONE = 400
"""Files up to which one process reads them: starting others takes seconds."""
_NAMES = [field.name for field in fields(Entry)]


def list_files(
    folders: str | Path | Sequence[str | Path] = ".",
    where: str | Sequence[str] = (),
    *,
    rebuild: bool = False,
    index: str | Path | None = None,
    progress: Progress = silent,
) -> tuple[Entry, ...]:
    """The files of haploop in folders and their subfolders that meet all conditions, by path.

    `where` is conditions such as "participant=P01", "kind=recording" and "date>=2026-11" (`where.condition`).
    `rebuild` reads every file again. `index` is the index's file, by default in the user's cache. `progress`
    is called as files are read. Files that haploop did not write are not listed; damaged ones are.

    Raises ConfigurationError for a folder that is not there, or an impossible condition.

    For example:

        >>> [entry.button for entry in haploop.list_files("data", "participant=P01")]
        ['latch']
    """
    sql, values = condition([where] if isinstance(where, str) else where)
    seen: dict[str, str] = {}
    for folder in paths_of(folders):
        path = folder.resolve()
        if not path.is_dir():
            raise ConfigurationError(f"There is no folder {folder}: check the name.")
        seen |= _look(path)
    path = Path(index) if index else user_cache_path("haploop") / f"catalogue-{_VERSION}.sqlite3"

    def asked(path: Path | None, anew: bool) -> tuple[Entry, ...]:
        with closing(_opened(path)) as database:
            _refresh(database, seen, anew, progress)
            return _found(database, seen, sql, values)

    try:
        return asked(path, rebuild)
    except (sqlite3.DatabaseError, ValueError, TypeError, OverflowError) as error:  # it may be damaged anyhow
        if isinstance(error, sqlite3.OperationalError):
            # The cache cannot be written, or another command is writing it: do without.
            return asked(None, True)
        try:
            path.unlink(missing_ok=True)
        except OSError:  # nor can it be removed
            return asked(None, True)
        return asked(path, True)


def _opened(path: Path | None) -> sqlite3.Connection:
    """The index in a file of its owner, or in memory without one."""
    if path is not None:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            # It says who pressed what: for its owner alone, and so are SQLite's files beside it.
            os.close(os.open(path, os.O_RDWR | os.O_CREAT, 0o600))
        except OSError:
            path = None
    return sqlite3.connect(path or ":memory:", timeout=10.0)


def _refresh(database: sqlite3.Connection, seen: dict[str, str], anew: bool, progress: Progress) -> None:
    """Read the files that are new or changed, or all of them `anew`."""
    columns = ", ".join(f"{name} TEXT NOT NULL" for name in _NAMES)
    made = [row[1] for row in database.execute("PRAGMA table_info(files)")]
    if made and made != ["source", "mark", "hash", *_NAMES]:
        database.execute("DROP TABLE files")  # of another version of haploop
    database.execute(
        f"CREATE TABLE IF NOT EXISTS files (source TEXT PRIMARY KEY, mark TEXT, hash TEXT, {columns})"
    )
    known = dict(database.execute("SELECT source, mark FROM files")) if not anew else {}
    stale = [source for source, mark in seen.items() if known.get(source) != mark]
    if not stale:
        return
    holes = ", ".join("?" for _ in range(len(_NAMES) + 3))
    with database:
        for count, (source, entry) in enumerate(_read(stale, progress), 1):
            # A file that is not ours is remembered too, without a kind.
            kept = entry or Entry(source, "")
            mark = seen[source] if kept.settled else ""
            row = (source, mark, *astuple(kept))
            database.execute(
                f"INSERT OR REPLACE INTO files VALUES ({holes})", (*row[:2], _hash(row), *row[2:])
            )
            if count % _KEPT == 0:
                database.commit()


def _found(
    database: sqlite3.Connection, seen: dict[str, str], sql: str, values: list[str]
) -> tuple[Entry, ...]:
    """The entries seen that meet a condition. Raises sqlite3.DatabaseError for a damaged index."""
    database.execute("CREATE TEMP TABLE here (source TEXT PRIMARY KEY)")
    database.executemany("INSERT INTO here VALUES (?)", ((source,) for source in seen))
    count = 0
    for source, mark, stated, *own in database.execute("SELECT * FROM files NATURAL JOIN here"):
        count += 1
        if stated != _hash((source, mark, *own)):
            raise sqlite3.DatabaseError("a row does not match its hash")
    if count != len(seen):
        raise sqlite3.DatabaseError("a row is missing")
    found = database.execute(
        f"SELECT {', '.join(_NAMES)} FROM files NATURAL JOIN here WHERE kind != '' AND {sql} ORDER BY file",
        values,
    )
    return tuple(Entry(*row) for row in found)


def _hash(row: tuple[object, ...]) -> str:
    """Of all of a row: no damaged index is taken for what the files say."""
    return hashlib.sha256(json.dumps(row).encode()).hexdigest()


def _look(folder: Path) -> dict[str, str]:
    """Path and mark of each file that may be one of haploop's, without opening any."""
    found: dict[str, str] = {}
    for inside, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        beside = os.path.join(inside, _REJECTIONS)  # noqa: PTH118
        rejections = (_REJECTIONS in names and _mark(beside)) or ""
        is_map = "map.json" in names
        if is_map:
            folders.clear()
        # The points of a map are parts of one thing.
        for name in ["map.json"] if is_map else names:
            if name in _NAMED or (name.endswith(".h5") and not name.startswith(".")):
                path = os.path.join(inside, name)  # noqa: PTH118
                mark = _mark(path)
                if mark is not None:
                    # SQLite takes no name that is not UTF-8.
                    found[path.encode(errors="backslashreplace").decode()] = mark + rejections
    return found


def _mark(path: str) -> str | None:
    """Size and time; empty for what cannot be looked at, None for no file: a pipe would block."""
    try:
        status = os.stat(path)  # noqa: PTH116
    except OSError:
        return ""
    if not stat.S_ISREG(status.st_mode):
        return None
    return f"{status.st_size}:{status.st_mtime_ns};"


def _read(sources: list[str], progress: Progress) -> Iterator[tuple[str, Entry | None]]:
    if len(sources) <= _ALONE:
        entries = map(entry_of, sources)
        yield from _counted(sources, entries, progress)
        return
    with worker_pool(None, __name__) as pool:
        yield from _counted(sources, pool.map(entry_of, sources, chunksize=50), progress)


def _counted(
    sources: list[str], entries: Iterator[Entry | None], progress: Progress
) -> Iterator[tuple[str, Entry | None]]:
    for count, (source, entry) in enumerate(zip(sources, entries, strict=True), 1):
        progress("Read files", count, len(sources), "files")
        yield source, entry
