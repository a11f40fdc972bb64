"""Recordings that the operator has lined up: who presses what next.

The list is a file of the data folder, so that a page that is reloaded and a server that is started again show
the same. It begins nothing by itself: each recording is started by a person, one at a time. One that was not
completed stays in the list.
"""

from __future__ import annotations

import secrets
import threading
from collections.abc import Callable, Mapping
from typing import Any

from ...acquisition import file_name
from ...base.errors import ConfigurationError, DataError
from ...base.files import private_files, whole_file
from ...base.json_files import changing, read_json
from ...base.json_text import as_file
from ..data_folder import DataFolder
from ..fields import clean, whole

_KIND = "run queue"
_MOST = 200
_ENDED = ("done", "stopped", "failed", "unconfirmed")
Item = dict[str, Any]


class RunQueue:
    """The list, in order. `worker` sends a command of a page; for any thread. Methods raise HaploopError."""

    def __init__(self, data: DataFolder, worker: Callable[[str, Mapping[str, Any]], Any]) -> None:
        self._path = data.root / "run-queue.json"
        self._worker = worker
        self._lock = threading.Lock()
        self._unseen: set[str] = set()
        """Recordings that were started here, and that no snapshot of the worker has shown yet."""
        self.problem = ""
        """Why the list cannot be read, as a sentence."""
        self.items: list[Item] = []
        self._read()

    @property
    def shown(self) -> dict[str, Any]:
        """What pages show of it."""
        return {"items": self.items, "problem": self.problem}

    def add(self, values: Mapping[str, Any]) -> None:
        """Put a recording at the end: participant, button, presses, and, where given, name and notes."""
        one = {name: str(values.get(name) or "") for name in ("participant", "button", "name")}
        file = file_name(one["participant"], one["button"], one["name"])
        item = {
            **one,
            "id": secrets.token_hex(8),
            "presses": whole(values.get("presses", 10), "The number of presses", 1, 200),
            "notes": clean(values.get("notes") or "", "The notes"),
            "job": 0,
            "said": "",
        }

        def put(items: list[Item]) -> list[Item]:
            if any(file_name(i["participant"], i["button"], i["name"]) == file for i in items):
                raise ConfigurationError(f"{file} is lined up already: give this recording another name.")
            if len(items) >= _MOST:
                raise ConfigurationError(f"{_MOST} recordings are lined up: record some first.")
            return [*items, item]

        self._change(put)

    def move(self, values: Mapping[str, Any]) -> None:
        """Move a recording to another place, which is counted from 0."""
        to = whole(values.get("to"), "The place", 0, _MOST)

        def moved(items: list[Item]) -> list[Item]:
            one = _named(items, values)
            others = [item for item in items if item is not one]
            return [*others[:to], one, *others[to:]]

        self._change(moved)

    def drop(self, values: Mapping[str, Any]) -> None:
        """Take a recording off the list. What is being recorded goes on."""

        def without(items: list[Item]) -> list[Item]:
            one = _named(items, values)
            return [item for item in items if item is not one]

        self._change(without)

    def start(self, values: Mapping[str, Any]) -> None:
        """Start a recording, because a person asks for it. It leaves the list when it is complete."""
        with self._lock:
            one = _named(self.items, values)
            if one["job"]:
                raise ConfigurationError("That recording runs already.")
            wanted = {name: one[name] for name in ("participant", "button", "name", "presses", "notes")}
            status, answer = self._worker("start", {"kind": "record", "parameters": wanted})
            if status != 200:
                raise ConfigurationError(str(answer.get("error", "The worker refused.")))
            self._unseen.add(one["id"])
        self._change(lambda items: _with(items, one["id"], job=answer["job"], said=""))

    def heard(self, snapshot: Mapping[str, Any]) -> None:
        """Note what became of the recording that was started."""
        running = next((item for item in self.items if item["job"]), None)
        if running is None:
            return
        job, own = snapshot.get("job") or {}, running["id"]
        seen = not snapshot.get("gone") and job.get("number") == running["job"] and job["kind"] == "record"
        if seen:
            self._unseen.discard(own)
            if job["state"] not in _ENDED:
                return
            if job["state"] == "done":
                self._change(lambda items: [item for item in items if item["id"] != own])
                return
        elif own in self._unseen and not snapshot.get("gone"):
            return  # the worker's next snapshot shows it
        said = job["sentence"] or "It was stopped." if seen else "How it ended is not known: see Files."
        self._unseen.discard(own)
        self._change(lambda items: _with(items, own, job=0, said=said))

    def _change(self, change: Callable[[list[Item]], list[Item]]) -> None:
        """Change the file's list, also beside another server of this data folder."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        with self._lock, private_files(), changing(self._path):
            self._read()
            if self.problem:
                raise DataError(self.problem)
            items = change(self.items)
            text, _ = as_file(_KIND, items)
            with whole_file(self._path, replace=True) as part:
                part.write_text(text, encoding="utf-8", newline="\n")
            self.items = items

    def _read(self) -> None:
        try:
            self.items = read_json(self._path, _KIND, list) if self._path.exists() else []
            self.problem = ""
        except DataError as error:
            self.items, self.problem = [], f"{error} Remove it to line up recordings anew."


def _named(items: list[Item], values: Mapping[str, Any]) -> Item:
    for item in items:
        if item["id"] == values.get("id"):
            return item
    raise ConfigurationError("That recording is not lined up any more.")


def _with(items: list[Item], own: str, **values: Any) -> list[Item]:
    return [{**item, **values} if item["id"] == own else item for item in items]
