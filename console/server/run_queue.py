"""Recordings and sessions of experiments that the operator has lined up, and the routes to them.

The list is a file of the data folder, which several servers may change: each reads it anew. It begins
nothing by itself: a person starts each, one at a time. What was not completed stays in the list. A recording
that runs is known by its worker, because another one, of another rig, counts its jobs from 1 as well.
"""

from __future__ import annotations

import asyncio
import secrets
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from ...acquisition import file_name
from ...base.errors import ConfigurationError, DataError, HaploopError
from ...base.files import private_files, stamp, whole_file
from ...base.json_files import as_file, changing, read_json
from ...base.marks import is_marked
from ..data_folder import DataFolder, clean, store_of, whole
from .conductor import Conductor
from .follower import Follower
from .security import ANSWER, json_object

_KIND = "run queue"
_MOST = 200
_ENDED = ("done", "stopped", "failed", "unconfirmed")
_KEYS = {"id", "participant", "experiment", "button", "name", "presses", "notes", "job", "said"}
_NOT_KNOWN = "How it ended is not known: see Files."
Item = dict[str, Any]
"""A recording or, with the name of an `experiment`, a session; `job` names the worker that records it."""


class RunQueue:
    """The list, in order. `worker` sends a command of a page; for any thread. Methods raise HaploopError."""

    def __init__(self, data: DataFolder, worker: Callable[[str, Mapping[str, Any]], Any]) -> None:
        self._data, self._path = data, data.root / "run-queue.json"
        self._worker = worker
        self._changing = threading.Lock()
        self._read: tuple[tuple[int, ...], list[Item], str] = ((), [], "")
        """State of the file as it was read, the list in it, and why it cannot be read, as a sentence."""

    @property
    def items(self) -> list[Item]:
        """The list as the file has it now; empty while it cannot be read."""
        return self._newest()[1]

    @property
    def shown(self) -> dict[str, Any]:
        """What pages show of it."""
        _, items, problem = self._newest()
        return {"items": items, "problem": problem}

    @property
    def changed(self) -> bool:
        """Whether the file is another one than was read last, as another server has changed it."""
        return stamp(self._path) != self._read[0]

    def add(self, values: Mapping[str, Any]) -> None:
        """Put one at the end: participant, button, presses, and, where given, name and notes; or participant
        and experiment.
        """
        one = {name: str(values.get(name) or "") for name in ("participant", "experiment", "button", "name")}
        presses = 0
        if one["experiment"]:
            store_of(self._data, one["experiment"])  # refuses what is no experiment
            file_name(one["participant"], "x")  # and what is no pseudonym
            one |= {"button": "", "name": ""}
        else:
            file_name(one["participant"], one["button"], one["name"])
            presses = whole(values.get("presses", 10), "The number of presses", 1, 200)
        item = {
            **one,
            "id": secrets.token_hex(8),
            "presses": presses,
            "notes": clean(values.get("notes") or "", "The notes"),
            "job": None,
            "said": "",
        }

        def put(items: list[Item]) -> list[Item]:
            if any(_title(other) == _title(item) for other in items):
                raise ConfigurationError(
                    f"{_title(item)} is lined up already"
                    f"{'' if one['experiment'] else ': give this recording another name'}."
                )
            if len(items) >= _MOST:
                raise ConfigurationError(f"{_MOST} are lined up: do some of them first.")
            return [*items, item]

        self._change(put)

    def move(self, values: Mapping[str, Any]) -> None:
        """Move one to another place, which is counted from 0."""
        to = whole(values.get("to"), "The place", 0, _MOST)

        def moved(items: list[Item]) -> list[Item]:
            one = _named(items, values)
            others = [item for item in items if item is not one]
            return [*others[:to], one, *others[to:]]

        self._change(moved)

    def drop(self, values: Mapping[str, Any]) -> None:
        """Take one off the list. What is being recorded goes on."""

        def without(items: list[Item]) -> list[Item]:
            one = _named(items, values)
            return [item for item in items if item is not one]

        self._change(without)

    def start(self, values: Mapping[str, Any]) -> None:
        """Start a recording, because a person asks for it. It leaves the list when it is complete.

        No other server changes the list until the worker has answered, so that none starts it too.
        """

        def started(items: list[Item]) -> list[Item]:
            one = _named(items, values)
            if one["job"]:
                raise ConfigurationError("That recording runs already.")
            if one["experiment"]:
                raise ConfigurationError("A session begins on the page Experiment.")
            wanted = {name: one[name] for name in ("participant", "button", "name", "presses", "notes")}
            status, answer = self._worker("start", {"kind": "record", "parameters": wanted})
            if status != 200:
                raise ConfigurationError(str(answer.get("error", "The worker refused.")))
            job = {"number": answer["job"], **answer["worker"]}
            return _with(items, one["id"], job=job, said="")

        self._change(started)

    def heard(self, snapshot: Mapping[str, Any]) -> None:
        """Note what became of the recordings that were started."""
        ended = {item["id"]: _ended(item["job"], snapshot) for item in self.items if item["job"]}
        if not any(ended.values()):
            return

        def noted(items: list[Item]) -> list[Item]:
            left = [item for item in items if not (item["job"] and ended.get(item["id"]) == "done")]
            for own, said in ended.items():
                left = _with(left, own, job=None, said=said) if said else left
            return left

        self._change(noted)

    def completed(self, experiment: str, participant: str) -> None:
        """Take the session that is complete off the list."""
        own = (experiment, participant)
        if any((item["experiment"], item["participant"]) == own for item in self.items):
            self._change(lambda items: [i for i in items if (i["experiment"], i["participant"]) != own])

    def _change(self, change: Callable[[list[Item]], list[Item]]) -> None:
        """Change the file's list, also beside another server of this data folder."""
        self._path.parent.mkdir(parents=True, exist_ok=True)
        with self._changing, private_files(), changing(self._path):
            _, items, problem = self._newest()
            if problem:
                raise DataError(problem)
            text, _ = as_file(_KIND, change(items))
            with whole_file(self._path, replace=True) as part:
                part.write_text(text, encoding="utf-8", newline="\n")

    def _newest(self) -> tuple[tuple[int, ...], list[Item], str]:
        """`_read`, anew where the file has changed."""
        now = stamp(self._path)
        if now != self._read[0]:
            try:
                items = read_json(self._path, _KIND, list) if now else []
                if any(not isinstance(one, dict) or one.keys() != _KEYS for one in items):
                    raise DataError(f"{self._path} was not written by this version of haploop.")
                self._read = (now, items, "")
            except DataError as error:
                self._read = (now, [], f"{error} Remove it to line up recordings anew.")
        return self._read


def _ended(own: Mapping[str, Any], snapshot: Mapping[str, Any]) -> str:
    """How a job ended, "done" or a sentence, by a worker's snapshot; "" while it may run."""
    told = snapshot.get("worker") or {"place": "", "begun": ""}
    if snapshot.get("gone") or told["place"] != own["place"]:
        return "" if is_marked(Path(own["place"])) else _NOT_KNOWN
    if told["begun"] != own["begun"]:  # an older worker's snapshot says nothing of this one
        return _NOT_KNOWN if told["begun"] > own["begun"] else ""
    job = snapshot.get("job") or {"number": 0}
    if job["number"] != own["number"]:
        return _NOT_KNOWN if job["number"] > own["number"] else ""
    if job["state"] not in _ENDED:
        return ""
    return "done" if job["state"] == "done" else job["sentence"] or "It was stopped."


def _title(item: Item) -> str:
    """What tells one from another."""
    if item["experiment"]:
        return f"{item['participant']}'s session of {item['experiment']}"
    return file_name(item["participant"], item["button"], item["name"])


def _named(items: list[Item], values: Mapping[str, Any]) -> Item:
    for item in items:
        if item["id"] == values.get("id"):
            return item
    raise ConfigurationError("That is not lined up any more.")


def _with(items: list[Item], own: str, **values: Any) -> list[Item]:
    return [{**item, **values} if item["id"] == own else item for item in items]


# Routes of what the server itself keeps: the session of an experiment, and the recordings lined up.

Act = Callable[[Mapping[str, Any]], None]


def experiment_routes(conductor: Conductor, follower: Follower) -> list[Route]:
    """Return the routes; after each request all pages are told."""

    def begin(values: Mapping[str, Any]) -> None:
        now = follower.snapshot
        conductor.begin(values, {"rig": now.get("rig"), "rig_simulated": bool(now.get("simulated"))})

    acts: dict[str, Act] = {
        "/api/experiment/begin": begin,
        "/api/experiment/present": conductor.present,
        "/api/experiment/done": conductor.done,
        "/api/experiment/pause": lambda values: conductor.pause(values.get("on") is True),
        "/api/experiment/end": lambda _: conductor.end(),
        ANSWER: conductor.answer,
    }
    return [_route(path, act, follower) for path, act in acts.items()]


def queue_routes(queue: RunQueue, follower: Follower) -> list[Route]:
    """Return the routes of the recordings that are lined up; after each request all pages are told."""
    acts: dict[str, Act] = {"add": queue.add, "move": queue.move, "drop": queue.drop, "start": queue.start}
    return [_route(f"/api/queue/{name}", act, follower) for name, act in acts.items()]


def _route(path: str, act: Act, follower: Follower) -> Route:
    async def answer(request: Request) -> Response:
        try:
            values = await json_object(request)
            await asyncio.to_thread(act, values)
        except HaploopError as error:
            return JSONResponse({"error": str(error)}, 409)
        await follower.tell()
        return JSONResponse({"done": True})

    return Route(path, answer, methods=["POST"])
