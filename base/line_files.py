"""Logs of lines, durable line by line, of which nothing can be lost unnoticed: neither a line nor the end.

Each line is one JSON object with its `number`, its hash, and the hash of the line before (`previous`). The
hash shows that a line was not changed; the chain, that none is missing, exchanged, or of another log.
Neither shows that the log once went on. So the file `marks.json`, beside the log or its folder, says how many
lines each log has, and the hash of the last of them; it is replaced whole after each line that must not be
lost. A log may be longer than its mark (the program was killed in between), and never shorter. A log that has
an end says so in its last line (`sealed`), after which there is none.

A line that was cut off by a kill is left as it is, and the next one says so (`cut_off`). What cannot be
noticed: a log and its mark that are both put back to an earlier state, as by a backup of the whole folder.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from .errors import DataError
from .files import appended, beside, make_folder, os_error_text, private_files, whole_file
from .json_files import as_file, as_line, read_json, with_hash
from .publishing import sync_folder

_LARGEST = 1 << 28
"""Bytes of a log that are read."""
_MARKS = "marks.json"
_KIND = "marks of logs"


@dataclass(frozen=True)
class Line:
    """One line of a log."""

    values: Mapping[str, Any]
    """What was logged, with its `number` (from 1) and `previous`."""
    digest: str
    """Hash of the line."""


@dataclass(frozen=True)
class Mark:
    """How far a log had come."""

    lines: int
    digest: str
    """Hash of the last line."""

    @classmethod
    def of(cls, lines: Sequence[Line]) -> Mark:
        """Mark of a log of these lines, one at least."""
        return cls(len(lines), lines[-1].digest)


class LineFile:
    """Appends lines to a log, which only its owner can read.

    Raises DataError when the disk refuses; then nothing more is taken until the log is opened anew.
    """

    def __init__(self, path: Path, durable: bool = True) -> None:
        """Open a log, or begin one. Without `durable`, the operating system chooses when to write."""
        self._path, self._durable = path, durable
        self.lines = list(read_lines(path)) if path.exists() else []
        self.cut_off = False
        """Whether the last line that is there was cut off."""
        try:
            with private_files():
                make_folder(path.parent)
                self._file = appended(path)
            last = path.read_bytes().rpartition(b"\n")[2]
            if last and not self.lines:
                self._file.truncate(0)  # a first line that was cut off holds nothing
            elif last:
                self._write(b"\n")
                self.cut_off = _line(last) is None
            sync_folder(path.parent)
        except OSError as error:
            raise DataError(f"{path} cannot be written: {os_error_text(error)}.") from None

    def add(self, **values: Any) -> Line:
        """Append a line; when this returns, it is on the disk, if the log is durable."""
        previous = self.lines[-1].digest if self.lines else ""
        said = {"number": len(self.lines) + 1, "previous": previous, **values}
        try:
            text = as_line(said | ({"cut_off": True} if self.cut_off else {})).encode()
            self._write(text)
            if self._durable:
                os.fsync(self._file.fileno())
        except (OSError, ValueError) as error:
            self.close()  # of this line nobody knows how much is there: the next one begins by reading
            why = os_error_text(error) if isinstance(error, OSError) else str(error)
            raise DataError(f"{self._path} cannot be written: {why}.") from None
        line = Line(*with_hash(text))
        self.lines.append(line)
        self.cut_off = False
        return line

    def _write(self, text: bytes) -> None:
        while text:
            text = text[self._file.write(text) :]

    def close(self) -> None:
        """Close the file. May be called again."""
        self._file.close()


def read_lines(path: Path, only_first: bool = False) -> tuple[Line, ...]:
    """Read the lines of a log, or its first one.

    Left out are a last line that was cut off by a kill, and one that is followed by a line that says so.
    Raises DataError, with the number of the line, for a damaged log.
    """
    try:
        with path.open("rb") as file:
            *raw, last = (file.readline(_LARGEST) if only_first else file.read(_LARGEST)).split(b"\n")
    except OSError as error:
        raise DataError(f"{path} cannot be read: {os_error_text(error)}.") from None
    # A whole line whose end was changed is no line that was cut off.
    if _line(last) is not None or _line(last[:-1]) is not None:
        raw.append(last)
    lines: list[Line] = []
    broken = 0
    for number, text in enumerate(raw, start=1):
        line = _line(text)
        if (line is None and broken) or (line is not None and not _follows(line, lines, bool(broken))):
            raise DataError(_damaged(path, broken or number))
        if line is not None:
            lines.append(line)
        broken = number if line is None else 0
    if broken:
        raise DataError(_damaged(path, broken))
    return tuple(lines)


def line_problems(path: Path) -> tuple[str, ...]:
    """One sentence for a log that was to be sealed, and is not.

    Raises DataError for a damaged log, and for one that has lost its end or beginning.
    """
    lines = read_lines(path)
    check_mark(path, lines)
    if not lines:
        raise DataError(f"{path} has no line that was written completely.")
    if lines[0].values.get("sealed") is False and lines[-1].values.get("sealed") is not True:
        return (f"{path} is not sealed: it is going on, was interrupted, or its end is missing.",)
    return ()


def check_marked(path: Path) -> None:
    """Check all logs that a file of marks names. Raises DataError for one that is missing or damaged."""
    for name in read_marks(path.parent):
        log = beside(path.parent, name, str(path), DataError)
        check_mark(log, read_lines(log) if log.exists() else ())


def is_marks(path: Path) -> bool:
    """True for a path that can be a file of marks."""
    return path.name == _MARKS


def read_marks(folder: Path) -> dict[str, Mark]:
    """Marks of the logs in `folder` and its folders, by path within it. Raises DataError."""
    path = folder / _MARKS
    if not path.exists():
        return {}
    try:
        return {name: Mark(int(one["lines"]), str(one["digest"])) for name, one in _content(path).items()}
    except (LookupError, TypeError, ValueError, OverflowError):
        raise DataError(f"{path} has an entry that is no mark: restore it from a copy.") from None


def write_marks(folder: Path, marks: Mapping[str, Mark]) -> None:
    """Replace the marks of a folder. Raises DataError."""
    path = folder / _MARKS
    text, _ = as_file(_KIND, {name: asdict(one) for name, one in sorted(marks.items())})
    try:
        with private_files(), whole_file(path, replace=True) as part:
            part.write_text(text, encoding="utf-8", newline="\n")
    except OSError as error:
        raise DataError(f"{path} cannot be written: {os_error_text(error)}.") from None


def check_mark(path: Path, lines: Sequence[Line]) -> None:
    """Raise DataError when a log lacks lines that it had, by the marks beside it and beside its folder."""
    whole = path.absolute()
    for folder in whole.parents[:2]:
        mark = read_marks(folder).get(whole.relative_to(folder).as_posix())
        if mark is None:
            continue
        if len(lines) < mark.lines:
            lost = (
                f"has {len(lines)} of the {mark.lines} lines that it had" if path.exists() else "is missing"
            )
            raise DataError(f"{path} {lost}: restore the file from a copy.")
        if lines[mark.lines - 1].digest != mark.digest:
            raise DataError(f"{path} is another file than was written here: restore it from a copy.")


def _content(path: Path) -> dict[str, Any]:
    return dict(read_json(path, _KIND, dict))


def _follows(line: Line, before: Sequence[Line], after_cut_off: bool) -> bool:
    said, last = line.values, before[-1] if before else None
    return (
        said.get("number") == len(before) + 1
        and said.get("previous") == (last.digest if last else "")
        and (said.get("cut_off") is True) == after_cut_off
        and not (last and last.values.get("sealed") is True)
    )


def _line(text: bytes) -> Line | None:
    try:
        return Line(*with_hash(text))
    except ValueError:
        return None


def _damaged(path: Path, number: int) -> str:
    return f"{path}, line {number} is damaged, or a line before it is missing: restore the file from a copy."
