"""The history of a rig's calibrations: generations that are never edited, and one of them active.

A generation is a folder of files and a manifest (`generation.json`) with why it was made and the
SHA-256 of each file. It is written under another name, flushed to disk, and renamed. The last entry of
`activations.json` names the active generation and the content hash of its manifest: so after a kill at any
moment exactly one generation is active, and damage to it is detected. `looks.json` has an entry for each
test of the active calibration. Both are only ever added to.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Protocol, Self

from pydantic import TypeAdapter, ValidationError

from ...base.errors import DataError
from ...base.files import Room, beside, os_error_text, room
from ...base.json_files import append_json, changing, json_hash, read_json, write_json
from ...base.notebook import InNotebook
from ...base.publishing import sync_folder
from ...instruments.safety import hold

_MANIFEST, _ACTIVATIONS, _LOOKS = "generation.json", "activations.json", "looks.json"
_FIRST = "make one with `haploop calibrations adopt`"
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
    """Content hash of the manifest, and so of everything."""

    @classmethod
    def open(cls, folder: Path) -> Generation:
        """Read a generation's manifest. Raises DataError when there is none, or none that can be read."""
        manifest = folder / _MANIFEST
        values = read_json(manifest, "calibration generation", dict)
        try:
            return cls(
                folder=folder,
                created=str(values["created"]),
                parent=str(values["parent"]),
                reason=str(values["reason"]),
                details=dict(values["details"]),
                files={str(name): str(content) for name, content in values["files"].items()},
                digest=json_hash(manifest),
            )
        except (ValueError, KeyError, TypeError, AttributeError):
            raise DataError(f"{manifest} holds no calibration: it was not written by haploop.") from None

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
            path = beside(self.folder, name, f"The calibration {self.name}", DataError)
            try:
                whole = _sha256(path) == content
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
    """Content hash of the generation's manifest."""
    when: str
    actor: str
    """Command and account of the activation."""
    reason: str


_ACTIVATED = TypeAdapter(Activation)


class History(InNotebook):
    """The folder of a rig's calibrations; see the module. Nothing is made before `add`.

    Reading needs no lock, and sees one state or the next. A writer takes the lock (`hold`) before it
    reads the state that it changes: two concurrent writers would undo each other's changes.

    For example:

        >>> history = haploop.History("lab-calibrations")
        >>> len(history.generations)
        0
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self._room: Room | None = None

    @classmethod
    def of_rig(cls, rig: str | Path, here: str | Path = "") -> Self:
        """The history of a rig: the folder RIG-calibrations beside its file, or in `here` for a shipped rig.

        Commands and the console find it by this alone.
        """
        path = Path(rig)
        return cls((path.parent if path.is_file() else Path(here)) / f"{path.stem}-calibrations")

    @contextlib.contextmanager
    def hold(self, size: int = 0) -> Iterator[None]:
        """Keep every other writer off this folder, and hold `size` bytes of its disk for `add` and `note`.

        Raises InstrumentError, which names the holder, and ConfigurationError without that much room.
        """
        with contextlib.ExitStack() as stack:
            name = os.path.normcase(self.folder.resolve())
            stack.enter_context(hold({name}, "The history of calibrations"))
            self._room = stack.enter_context(room(self.folder, size)) if size else None
            stack.callback(setattr, self, "_room", None)
            yield

    @property
    def generations(self) -> tuple[Generation, ...]:
        """All that were ever published, oldest first. Raises DataError for one that cannot be read."""
        return tuple(Generation.open(self.folder / name) for name in self._names())

    @property
    def activations(self) -> tuple[Activation, ...]:
        """Oldest first; the last one holds. Raises DataError when the file is damaged."""
        path = self.folder / _ACTIVATIONS
        try:
            return tuple(_ACTIVATED.validate_python(entry) for entry in _entries(path, "activations"))
        except ValidationError:
            raise DataError(f"{path} holds something else than activations: restore a copy.") from None

    @property
    def looks(self) -> tuple[dict[str, Any], ...]:
        """Entries added by `note`, oldest first. Raises DataError when the file is damaged."""
        return tuple(_entries(self.folder / _LOOKS, "looks"))

    def active(self) -> Generation:
        """The one generation that is active, verified to be whole.

        Raises DataError when none is yet, or when it is not what was activated.
        """
        activations = self.activations
        if not activations:
            raise DataError(f"{self.folder} holds no active calibration: {_FIRST}.")
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
            f"{self.folder} holds no calibration {name!r}; "
            + (f"it has {', '.join(names)}." if (names := self._names()) else f"it has none yet: {_FIRST}.")
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
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise DataError(f"{self.folder} cannot be written: {os_error_text(error)}.") from None
        self._use_room()
        with changing(self.folder / "generations"):
            for left in self.folder.glob(".*.part"):
                # Left by a killed writer: it was never renamed, so nobody can have used it.
                shutil.rmtree(left, ignore_errors=True)
            number = max((int(name.partition("-")[0]) for name in self._names()), default=0) + 1
            destination = self.folder / f"{number:04d}-{when:%Y%m%dT%H%M%SZ}"
            manifest = {
                "created": when.isoformat(timespec="seconds"),
                "parent": parent,
                "reason": reason,
                "details": dict(details),
            }
            _write_generation(destination, parts, manifest)
        return Generation.open(destination)

    def activate(self, generation: Generation, *, when: datetime, actor: str, reason: str) -> Activation:
        """Make a generation the active one: an entry, whole or not at all.

        Raises DataError when it is not whole, and when the entry cannot be written.
        """
        generation.verify()
        time = when.isoformat(timespec="seconds")
        entry = Activation(generation.name, generation.digest, time, actor, reason)
        append_json(self.folder / _ACTIVATIONS, "activations", [vars(entry)])
        return entry

    def report(self, when: str | datetime, outcome: str) -> Path:
        """Where the report of a look is, if one was written: its time (ISO 8601, UTC) and its outcome."""
        time = datetime.fromisoformat(when) if isinstance(when, str) else when
        return self.folder / "reports" / f"{time:%Y%m%dT%H%M%SZ}-{outcome.replace(' ', '-')}.html"

    def note(self, look: Mapping[str, Any]) -> None:
        """Keep what a look found: one entry. Raises DataError when it cannot be written."""
        self._use_room()
        append_json(self.folder / _LOOKS, "looks", [look])

    def _use_room(self) -> None:
        if self._room is not None:
            self._room.free()

    def _names(self) -> Sequence[str]:
        if not self.folder.is_dir():
            return ()
        found = (entry.name for entry in self.folder.iterdir() if _NAME.fullmatch(entry.name))
        return sorted(found, key=lambda name: int(name.partition("-")[0]))


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _entries(path: Path, kind: str) -> tuple[dict[str, Any], ...]:
    """The entries of a file; none if there is no file."""
    return tuple(read_json(path, kind, list)) if path.exists() else ()


def _write_generation(destination: Path, parts: Mapping[str, Saved], manifest: Mapping[str, Any]) -> None:
    """Write a folder under another name, and rename it. Raises DataError, and leaves nothing."""
    part = destination.with_name(f".{destination.name}.part")
    try:
        for name, value in parts.items():
            (part / name).parent.mkdir(parents=True, exist_ok=True)
            value.save(part / name)
        files = {name: _sha256(part / name) for name in parts}
        write_json(part / _MANIFEST, "calibration generation", {**manifest, "files": files})
        for folder in {part, *((part / name).parent for name in parts)}:
            sync_folder(folder)
        part.rename(destination)
        sync_folder(destination.parent)
    except OSError as error:
        said = os_error_text(error)
        raise DataError(f"The calibration {destination.name} cannot be written: {said}.") from None
    finally:
        shutil.rmtree(part, ignore_errors=True)
