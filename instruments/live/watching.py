"""Watch a rig that another program runs: find it, connect, and take its blocks from a tap."""

from __future__ import annotations

import json
import os
import secrets
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ...base.errors import ConfigurationError, DataError
from ...base.files import new_file, private_files
from ..config import RigFile, load_rig_file
from ..driver import Mode
from ..safety import state_folder
from .publisher import ADDRESS_FILES, PREFIX, TOKEN, WAITING_FILES, header_of, lengths_of, volts_of
from .tap import LiveBlock, Tap

ByteArray = npt.NDArray[np.uint8]

_CONNECT_DEADLINE = 2.0
"""Time for a program on the same computer to accept a connection (s)."""


def watch_live(
    rig: str | Path | RigFile,
    simulate: Mode | None = None,
    capacity: int = 16,
    address: str | Path | None = None,
) -> Tap:
    """Return a tap on the blocks of a rig that another program of the same user is running.

    `rig` and `simulate` are as in `open_rig`. `address` names an address file, for the case of several
    programs with rigs of one name; without it the newest is taken.
    The tap is closed when that program closes the rig.
    Its `dropped` counts blocks that were dropped in either program.

    Raises ConfigurationError when no program publishes the rig. Taking a block raises DataError for
    invalid data.

    For example:

        >>> with rig.publish_live(), haploop.watch_live(rig.file) as tap:
        ...     recording = haploop.record(rig, "push", "P01", 1, "watched")
        ...     block = tap.latest()
        >>> block.run.doing, block.volts.shape[0] == len(recording.channels)
        ('record', True)
    """
    file = rig if isinstance(rig, RigFile) else load_rig_file(rig)
    folder = state_folder(file, (simulate or file.simulate) is not None)
    foreign = False
    paths = [Path(address)] if address else _newest(folder)
    for path in paths:
        try:
            found = _read(path)
        except PermissionError:
            foreign = True
            continue
        if found is None or (not address and found.rig != file.name):
            continue
        link = _connected(found)
        if link is not None:
            tap = Tap(capacity, on_close=partial(_shut, link))
            threading.Thread(
                target=_receive, args=(link, tap), name="haploop-live-reader", daemon=True
            ).start()
            return tap
        if found.dead:
            # Left by a killed program: its port has no listener.
            with suppress(OSError):
                path.unlink()
    where = f"at {address}" if address else f"in {folder}"
    hint = " One that another user runs was found, and only they can watch it." if foreign else ""
    raise ConfigurationError(
        f"No running program publishes the rig {file.name!r} {where}: start one (haploop record, say), and "
        f"name the same rig file and --simulate here.{hint}"
    )


@contextmanager
def waiting_for(rig: RigFile, simulate: Mode | None) -> Iterator[None]:
    """Let a program that publishes a rig meanwhile wait for this viewer (`Publisher.greet`)."""
    folder = state_folder(rig, (simulate or rig.simulate) is not None)
    path = folder / WAITING_FILES.replace("*", f"{os.getpid()}-{secrets.token_hex(4)}")
    with suppress(OSError), private_files(), new_file(path) as part:
        part.write_text(rig.name, encoding="utf-8")
    try:
        yield
    finally:
        with suppress(OSError):
            path.unlink(missing_ok=True)


@dataclass
class _Address:
    rig: str
    port: int
    token: bytes
    dead: bool = False


def _newest(folder: Path) -> list[Path]:
    dated = []
    for path in folder.glob(ADDRESS_FILES):
        with suppress(OSError):
            dated.append((path.stat().st_mtime_ns, path))
    return [path for _, path in sorted(dated, reverse=True)]


def _read(path: Path) -> _Address | None:
    """Read an address file; None when it is gone or invalid. Raises PermissionError."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        found = _Address(str(content["rig"]), int(content["port"]), str(content["token"]).encode("ascii"))
    except PermissionError:
        raise
    except (OSError, ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return None
    return found if len(found.token) == TOKEN and 0 < found.port < 65536 else None


def _connected(address: _Address) -> socket.socket | None:
    try:
        link = socket.create_connection(("127.0.0.1", address.port), timeout=_CONNECT_DEADLINE)
    except ConnectionRefusedError:
        address.dead = True
        return None
    except OSError:
        return None
    try:
        link.sendall(address.token)
        link.settimeout(None)
    except OSError:
        link.close()
        return None
    return link


def _receive(link: socket.socket, tap: Tap) -> None:
    """Put every frame into the tap until the connection ends."""
    error: Exception | None = None
    try:
        for block, dropped in _blocks(link):
            tap.offer(block, dropped)
            if tap.closed:
                break
    except DataError as wrong:
        error = wrong
    except OSError:
        pass  # the publisher was killed, or the tap closed: nothing more comes
    finally:
        tap.close(error)
        link.close()


def _blocks(link: socket.socket) -> Iterator[tuple[LiveBlock, int]]:
    while (prefix := _exactly(link, PREFIX)) is not None:
        header_length, volts_length = lengths_of(prefix.tobytes())
        text = _exactly(link, header_length)
        if text is None:
            return
        header, run = header_of(text.tobytes())
        volts = _exactly(link, volts_length)
        if volts is None:
            return
        yield volts_of(header, run, volts), int(header["dropped"])


def _exactly(link: socket.socket, count: int) -> ByteArray | None:
    """Receive `count` bytes; None when the connection ends first."""
    buffer = np.empty(count, dtype=np.uint8)
    view, have = buffer.data, 0
    while have < count:
        got = link.recv_into(view[have:])
        if not got:
            return None
        have += got
    return buffer


def _shut(link: socket.socket) -> None:
    with suppress(OSError):
        link.shutdown(socket.SHUT_RDWR)
