"""The worker's address file: port and tokens, readable by its owner only, in the rig's state folder."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path

from ...instruments import RigFile
from ...instruments.driver import Mode
from ...instruments.safety import state_folder


@dataclass(frozen=True)
class Address:
    """Where a worker listens, and the words that open it."""

    pid: int
    port: int
    token: str
    """For every command and the snapshot."""
    stop_token: str
    """For STOP alone; the pages have it."""
    data: str
    """The worker's data folder."""
    calibrations: str
    """Folder of the worker's history of calibrations."""

    @classmethod
    def read(cls, path: Path) -> Address | None:
        """Read an address file; None when there is none, or it is no such file."""
        try:
            values = json.loads(path.read_text(encoding="utf-8"))
            found = cls(**values)
        except (OSError, ValueError, TypeError, RecursionError):
            return None
        numbers = isinstance(found.pid, int) and isinstance(found.port, int) and 0 < found.port < 65536
        texts = (found.token, found.stop_token, found.data, found.calibrations)
        words = all(isinstance(word, str) and word for word in texts)
        return found if numbers and words else None


def address_path(file: RigFile, simulate: Mode | None) -> Path:
    """Path of the address file of a rig's worker: one for each rig file and mode."""
    mode = simulate or file.simulate
    name = hashlib.sha256(f"{file.name}, {file.digest}, {mode}".encode()).hexdigest()[:16]
    return state_folder(file, mode is not None) / f"console-{name}.json"


@contextmanager
def written(path: Path, address: Address) -> Iterator[None]:
    """Keep an address file while the context lasts."""
    draft = path.with_suffix(f".{address.pid}.new")
    descriptor = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    try:
        os.write(descriptor, json.dumps(asdict(address)).encode())
    finally:
        os.close(descriptor)
    draft.replace(path)
    try:
        yield
    finally:
        if Address.read(path) == address:
            with suppress(OSError):
                path.unlink()
