"""Find, start and talk to a worker, whose address a file of the rig's state folder holds."""

from __future__ import annotations

import hashlib
import http.client
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass
from itertools import count
from pathlib import Path
from typing import Any
from urllib.parse import quote

from ...base.clock import RealClock
from ...base.errors import ConfigurationError, InstrumentError
from ...base.marks import is_marked, marked
from ...instruments import RigFile
from ...instruments.driver import Mode
from ...instruments.safety import state_folder
from ..data_folder import DataFolder

# The worker's address file: port and tokens, readable by its owner only, in the rig's state folder.


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


_START = 60.0
"""s for a worker to start: importing alone takes seconds on a slow disk."""
_ANSWER = 30.0
"""s for an answer: longer than the snapshot's long poll and the safe state take."""
_MOST_SERVERS = 16
_HANGS = 5.0
"""s after which a living worker that has not answered hangs: it answers a first question at once."""


class WorkerLink:
    """A worker that was found. Each call is one request, and raises InstrumentError when it has gone."""

    def __init__(self, address: Address) -> None:
        self.address = address

    def state(self, after: int = 0, deadline: float = _ANSWER) -> dict[str, Any]:
        """Return the snapshot, once its version is above `after` or after a second."""
        body = self._ask("GET", "/state", b"", {"X-After": str(after)}, deadline)[1]
        found: dict[str, Any] = json.loads(body)
        return found

    def command(self, name: str, values: Mapping[str, Any]) -> tuple[int, dict[str, Any]]:
        """Send a command; return its status (200, 400 or 409) and answer."""
        status, body = self._ask("POST", f"/command/{quote(name, safe='')}", json.dumps(values).encode(), {})
        found: dict[str, Any] = json.loads(body)
        return status, found

    def allow(self, origins: list[str]) -> None:
        """Let pages of these origins send STOP."""
        self._ask("POST", "/origins", json.dumps(origins).encode(), {})

    def stop(self, deadline: float = _ANSWER) -> dict[str, Any]:
        """Reach the safe state; return what came of it."""
        body = self._ask("POST", "/stop", self.address.stop_token.encode(), {}, deadline)[1]
        found: dict[str, Any] = json.loads(body)
        return found

    def end(self) -> None:
        """Reach the safe state and end the worker; nothing when it has gone."""
        with suppress(InstrumentError, ValueError):
            self.command("end", {})

    def _ask(
        self, method: str, path: str, body: bytes, headers: Mapping[str, str], deadline: float = _ANSWER
    ) -> tuple[int, bytes]:
        connection = http.client.HTTPConnection("127.0.0.1", self.address.port, timeout=deadline)
        try:
            token = {"Authorization": f"Bearer {self.address.token}"}
            connection.request(method, path, body, {**token, **headers})
            answer = connection.getresponse()
            return answer.status, answer.read()
        except (OSError, http.client.HTTPException) as error:
            raise InstrumentError(
                f"The console's worker (process {self.address.pid}) does not answer ({error}): if it has "
                "died, a relay box opens by itself; in doubt or without one, switch the amplifier off."
            ) from None
        finally:
            connection.close()


class WorkerHangsError(InstrumentError):
    """A worker lives, and does not answer."""

    def __init__(self, link: WorkerLink) -> None:
        super().__init__(
            f"The console's process {link.address.pid} hangs: switch the amplifier off, and then end that "
            "process."
        )
        self.link = link


def find_worker(file: RigFile, simulate: Mode | None) -> WorkerLink | None:
    """Return the running worker of a rig; None when there is none. Raises WorkerHangsError.

    A worker lives as long as its address file is marked: the operating system releases the mark of one that
    has died, and of no other.
    """
    path, clock, link = address_path(file, simulate), RealClock(), None
    until = clock.now() + _HANGS
    while is_marked(path):
        # Read anew each time: a worker that begins writes its address just behind the mark.
        address = Address.read(path)
        if address is not None:
            link = WorkerLink(address)
            with suppress(InstrumentError, ValueError):
                link.state(deadline=_HANGS)
                return link
        if link is not None and clock.now() > until:
            raise WorkerHangsError(link)
        if clock.now() > until:
            raise InstrumentError(
                f"The console's worker has no address in {path}: switch the amplifier off, and then end its "
                "process (python -m haploop.console.worker)."
            )
        clock.sleep(0.1)  # one that ends answers no more, and dies soon
    return None


def start_worker(
    rig: str,
    file: RigFile,
    simulate: Mode | None,
    data: DataFolder,
    virtual_time: bool = False,
    tape: Path | None = None,
) -> WorkerLink:
    """Return the running worker of a rig, or start one that outlives this program.

    One that is started records its sessions on `tape`. Its errors go to `console-worker.log` in the rig's
    state folder. Raises ConfigurationError when the
    running one has other folders, WorkerHangsError, and InstrumentError when none comes up.
    """
    path = address_path(file, simulate)
    with _alone(path.with_suffix(".start")):
        found = find_worker(file, simulate)
        if found is None:
            command = ["--rig", rig, "--data", str(data.root), "--calibrations", str(data.history.folder)]
            command += ["--simulate", simulate] if simulate else []
            command += ["--virtual-time"] if virtual_time else []
            command += ["--tape", str(tape.absolute())] if tape else []
            return _started(file, simulate, command)
    for option, what, has, wanted in (
        ("--data", "data folder", found.address.data, data.root),
        ("--calibrations", "history of calibrations", found.address.calibrations, data.history.folder),
    ):
        if Path(has) != wanted:
            raise ConfigurationError(
                f"A console of the rig {file.name!r} runs already, with the {what} {has}: name that one with "
                f"{option}, or end it with `haploop serve --stop`."
            )
    return found


@contextmanager
def serving(file: RigFile, simulate: Mode | None) -> Iterator[Callable[[], bool]]:
    """Mark this program as a server of a rig's console; gives whether there is another one just now.

    The operating system releases the mark of one that was killed. Raises InstrumentError when there are
    `_MOST_SERVERS`.
    """
    path = address_path(file, simulate)
    marks = [path.with_suffix(f".server-{number}") for number in range(_MOST_SERVERS)]
    with ExitStack() as stack:
        for own in marks:
            with suppress(InstrumentError):
                stack.enter_context(marked(own))
                break
        else:
            raise InstrumentError(f"{_MOST_SERVERS} consoles of the rig {file.name!r} run: end one of them.")
        yield lambda: any(is_marked(mark) for mark in marks if mark != own)


@contextmanager
def _alone(start: Path) -> Iterator[None]:
    """Wait while another program finds or starts the worker, and keep others waiting within the context."""
    clock = RealClock()
    until = clock.now() + _START + _ANSWER
    with ExitStack() as stack:
        while True:
            try:
                stack.enter_context(marked(start))
                break
            except InstrumentError:
                if clock.now() > until:
                    raise
                clock.sleep(0.1)
        yield


def free_tape(tape: Path | None) -> Path | None:
    """Return `tape`, or the first of its numbered successors ("day-2.tape") that does not exist."""
    names = (tape.with_stem(f"{tape.stem}-{number}") for number in count(2)) if tape else ()
    return tape if tape is None or not tape.exists() else next(name for name in names if not name.exists())


def _started(file: RigFile, simulate: Mode | None, options: list[str]) -> WorkerLink:
    path = address_path(file, simulate)
    command = [sys.executable, "-m", "haploop.console.worker", *options]
    log = path.with_name("console-worker.log")
    with log.open("ab") as errors:
        begin = errors.tell()
        # In a session of its own: Ctrl-C at the terminal is the server's, which then ends the worker.
        apart: dict[str, Any] = (
            {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}  # type: ignore[attr-defined,unused-ignore]
            if os.name == "nt"
            else {"start_new_session": True}
        )
        process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=errors, **apart
        )
    clock = RealClock()
    until = clock.now() + _START
    try:
        while clock.now() < until:
            found = find_worker(file, simulate)
            if found is not None:
                return found
            if process.poll() is not None:
                break
            clock.sleep(0.1)
    except KeyboardInterrupt:
        # Nobody would end it: the next `serve` would find a worker with another one's folders.
        process.terminate()
        raise
    said = log.read_bytes()[begin:].decode(errors="replace").strip().splitlines()
    raise InstrumentError(f"The console's worker did not start: {said[-1] if said else f'see {log}'}")
