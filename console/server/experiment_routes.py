"""Routes of an experiment's pages: the operator conducts, the participant answers."""

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
from .security import ANSWER


def experiment_routes(conductor: Conductor, follower: Follower) -> list[Route]:
    """Return the routes; after each request all pages are told."""

    def route(path: str, act: Callable[[Mapping[str, Any]], None]) -> Route:
        async def answer(request: Request) -> Response:
            try:
                values = await json_object(request)
                await asyncio.to_thread(act, values)
            except HaploopError as error:
                return JSONResponse({"error": str(error)}, 409)
            await follower.tell()
            return JSONResponse({"done": True})

        return Route(path, answer, methods=["POST"])

    def begin(values: Mapping[str, Any]) -> None:
        now = follower.snapshot
        conductor.begin(values, {"rig": now.get("rig"), "rig_simulated": bool(now.get("simulated"))})

    return [
        route("/api/experiment/begin", begin),
        route("/api/experiment/present", conductor.present),
        route("/api/experiment/done", conductor.done),
        route("/api/experiment/pause", lambda values: conductor.pause(values.get("on") is True)),
        route("/api/experiment/end", lambda _: conductor.end()),
        route(ANSWER, conductor.answer),
    ]
