"""The history of a rig's calibrations: generations that are never edited, and one of them active.

A generation is a folder of files and a manifest (`generation.json`) with why it was made and the
SHA-256 of each file. It is written under another name, flushed to disk, and renamed. The last line of
`activations.jsonl`, an append-only file, names the active generation and the SHA-256 of its manifest: so
after a kill at any moment exactly one generation is active, and damage to it is detected.
`looks.jsonl` has a line for each test of the active calibration.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from importlib import metadata
from pathlib import Path
from typing import Any, Protocol

from haploop.instruments import DataError
from haploop.instruments.files import os_error_text, sync_folder
from haploop.instruments.safety import hold

__all__ = ["Activation", "Generation", "History"]

FORMAT = 1
_MANIFEST, _ACTIVATIONS, _LOOKS = "generation.json", "activations.jsonl", "looks.jsonl"
_NAME = re.compile(r"(\d{4,})-\d{8}T\d{6}Z")


class Saved(Protocol):
    """An object that can save itself to a new file."""

    def save(self, path: str | Path) -> None:
        """Write to a new file, whole or not at all."""


@dataclass(frozen=True)
class Generation:
    """One calibration of everything: `files` are relative names with slashes, and their SHA-256."""

    folder: Path
    created: str
    """ISO 8601, UTC."""
    parent: str
    """Name of the generation that it was made from; empty for the first."""
    reason: str
    """Reason for making it, as a sentence."""
    details: Mapping[str, Any]
    """The numbers behind the reason."""
    files: Mapping[str, str]
    digest: str
    """SHA-256 of the manifest, and so of everything."""

    @classmethod
    def open(cls, folder: Path) -> Generation:
        """Read a generation's manifest. Raises DataError when there is none, or none that can be read."""
        try:
            raw = (folder / _MANIFEST).read_bytes()
        except OSError as error:
            said = os_error_text(error)
            raise DataError(f"The calibration {folder.name} cannot be read: {said}.") from None
        try:
            values = json.loads(raw)
            if values["format"] != FORMAT:
                raise DataError(
                    f"{folder / _MANIFEST} has format {values['format']} and this version reads {FORMAT}: "
                    f"it was written by {values['software']}."
                )
            return cls(
                folder=folder,
                created=str(values["created"]),
                parent=str(values["parent"]),
                reason=str(values["reason"]),
                details=dict(values["details"]),
                files={str(name): str(content) for name, content in values["files"].items()},
                digest=hashlib.sha256(raw).hexdigest(),
            )
        except (ValueError, KeyError, TypeError, AttributeError):
            raise DataError(f"{folder / _MANIFEST} is damaged: it cannot be read.") from None

    @property
    def name(self) -> str:
        """Its number and when it was made, as in `0003-20260731T021500Z`."""
        return self.folder.name

    def paths(self, kind: str) -> tuple[Path, ...]:
        """Its files of a kind: what lies in the subfolder of that name."""
        return tuple(self.folder / name for name in sorted(self.files) if name.startswith(kind + "/"))

    def verify(self) -> None:
        """Raises DataError, which names the file, unless every file is there as it was written."""
        for name, content in self.files.items():
            try:
                whole = _sha256(self.folder / name) == content
            except OSError as error:
                raise DataError(
                    f"{name} of the calibration {self.name} is not there: {os_error_text(error)}."
                ) from None
            if not whole:
                raise DataError(f"{name} of the calibration {self.name} is not what was written: damaged.")


@dataclass(frozen=True)
class Activation:
    """The activation of a generation: time (ISO 8601, UTC), actor, and reason."""

    generation: str
    manifest: str
    """SHA-256 of the generation's manifest."""
    when: str
    actor: str
    """Command and account of the activation."""
    reason: str


class History:
    """The folder of a rig's calibrations; see the module. Nothing is made before `add`.

    Reading needs no lock, and sees one state or the next. A writer takes the lock (`hold`) before it
    reads the state that it changes: two concurrent writers would undo each other's changes.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)

    @contextlib.contextmanager
    def hold(self) -> Iterator[None]:
        """Keep every other writer off this folder. Raises InstrumentError, which names the holder."""
        with hold({os.path.normcase(self.folder.resolve())}, "The history of calibrations"):
            for left in self.folder.glob(".*.part"):
                # Left by a killed writer: it was never renamed, so nobody can have used it.
                shutil.rmtree(left, ignore_errors=True)
            yield

    @property
    def generations(self) -> tuple[Generation, ...]:
        """All that were ever published, oldest first. Raises DataError for one that cannot be read."""
        return tuple(Generation.open(self.folder / name) for name in self._names())

    @property
    def activations(self) -> tuple[Activation, ...]:
        """Oldest first; the last one holds. Raises DataError when a line is damaged."""
        path = self.folder / _ACTIVATIONS
        try:
            return tuple(Activation(**line) for line in _lines(path))
        except TypeError:
            raise DataError(f"{path} is damaged: a line says something else than an activation.") from None

    @property
    def looks(self) -> tuple[dict[str, Any], ...]:
        """Entries added by `note`, oldest first. Raises DataError when a line is damaged."""
        return tuple(_lines(self.folder / _LOOKS))

    def active(self) -> Generation:
        """The one generation that is active, verified to be whole.

        Raises DataError when none is yet, or when it is not what was activated.
        """
        activations = self.activations
        if not activations:
            raise DataError(
                f"{self.folder} holds no active calibration: make one with `haploop calibrations adopt`."
            )
        last = activations[-1]
        try:
            generation = Generation.open(self.folder / last.generation)
            if generation.digest != last.manifest:
                raise DataError(
                    f"{_MANIFEST} of the calibration {last.generation} is not what was activated."
                )
            generation.verify()
        except DataError as error:
            raise DataError(
                f"{error} It is the active one: activate another with `haploop calibrations activate`."
            ) from None
        return generation

    def find(self, name: str) -> Generation:
        """The generation of a name, a number, or "active". Raises DataError when there is none."""
        if name == "active":
            return self.active()
        for known in self._names():
            number = known.partition("-")[0]
            if name == known or (name.isdecimal() and int(name) == int(number)):
                return Generation.open(self.folder / known)
        raise DataError(
            f"{self.folder} holds no calibration {name!r}; it has {', '.join(self._names()) or 'none'}."
        )

    def add(
        self,
        parts: Mapping[str, Saved],
        *,
        when: datetime,
        reason: str,
        details: Mapping[str, Any],
        parent: str = "",
    ) -> Generation:
        """Publish a generation, which `activate` may then make the active one.

        `parts` maps relative names with slashes to what writes itself there. Raises DataError, and
        leaves nothing behind, when it cannot be written.
        """
        number = max((int(name.partition("-")[0]) for name in self._names()), default=0) + 1
        destination = self.folder / f"{number:04d}-{when:%Y%m%dT%H%M%SZ}"
        part = self.folder / f".{destination.name}.part"
        try:
            for name, value in parts.items():
                (part / name).parent.mkdir(parents=True, exist_ok=True)
                value.save(part / name)
            manifest = {
                "format": FORMAT,
                "software": f"haploop {metadata.version('haploop')}",
                "created": when.isoformat(timespec="seconds"),
                "parent": parent,
                "reason": reason,
                "details": dict(details),
                "files": {name: _sha256(part / name) for name in parts},
            }
            with (part / _MANIFEST).open("x", encoding="utf-8", newline="\n") as file:
                file.write(json.dumps(manifest, indent=1, allow_nan=False) + "\n")
                file.flush()
                os.fsync(file.fileno())
            for folder in {part, *((part / name).parent for name in parts)}:
                sync_folder(folder)
            part.rename(destination)
            sync_folder(self.folder)
        except OSError as error:
            said = os_error_text(error)
            raise DataError(f"The calibration {destination.name} cannot be written: {said}.") from None
        finally:
            shutil.rmtree(part, ignore_errors=True)
        return Generation.open(destination)

    def activate(self, generation: Generation, *, when: datetime, actor: str, reason: str) -> Activation:
        """Make a generation the active one: a line, whole or not at all.

        Raises DataError when it is not whole, and when the line cannot be written.
        """
        generation.verify()
        time = when.isoformat(timespec="seconds")
        line = Activation(generation.name, generation.digest, time, actor, reason)
        _append(self.folder / _ACTIVATIONS, vars(line))
        return line

    def note(self, look: Mapping[str, Any]) -> None:
        """Keep what a look found: one line. Raises DataError when it cannot be written."""
        _append(self.folder / _LOOKS, look)

    def _names(self) -> Sequence[str]:
        if not self.folder.is_dir():
            return ()
        found = (entry.name for entry in self.folder.iterdir() if _NAME.fullmatch(entry.name))
        return sorted(found, key=lambda name: int(name.partition("-")[0]))


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _lines(path: Path) -> Iterator[dict[str, Any]]:
    """The lines of a file of JSON lines; none if there is no file.

    An incomplete last line is ignored: its writer was killed before it was complete.
    """
    try:
        *lines, _ = path.read_bytes().split(b"\n")
    except FileNotFoundError:
        return
    except OSError as error:
        raise DataError(f"{path} cannot be read: {os_error_text(error)}.") from None
    for number, line in enumerate(lines, 1):
        try:
            yield dict(json.loads(line))
        except (ValueError, TypeError):
            raise DataError(f"{path}, line {number} is damaged: it cannot be read.") from None


def _append(path: Path, values: Mapping[str, Any]) -> None:
    try:
        line = json.dumps(values, allow_nan=False).encode() + b"\n"
    except ValueError:
        raise DataError(f"Nothing was added to {path}: a value is NaN or infinite. Measure again.") from None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("a+b") as file:
            file.seek(0)
            file.truncate(file.read().rfind(b"\n") + 1)
            file.write(line)
            file.flush()
            os.fsync(file.fileno())
        sync_folder(path.parent)
    except OSError as error:
        raise DataError(f"{path} cannot be written: {os_error_text(error)}.") from None
