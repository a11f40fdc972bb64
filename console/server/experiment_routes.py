"""Routes of what the server itself keeps: the session of an experiment, and the recordings lined up."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping
from typing import Any

from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from ...base.errors import HaploopError
from .bodies import json_object
from .conductor import Conductor
from .follower import Follower
from .run_queue import RunQueue
from .security import ANSWER

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
    acts: dict[str, Act] = {
        "add": queue.add,
        "move": queue.move,
        "drop": queue.drop,
        "start": queue.start,
    }
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
