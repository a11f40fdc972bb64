"""Routes of an experiment's pages: the operator conducts, the participant answers."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Mapping
from typing import Any

from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from ...instruments import ConfigurationError, HaploopError
from .conductor import Conductor
from .follower import Follower
from .security import ANSWER

__all__ = ["experiment_routes"]

_LARGEST = 1 << 16
"""Bytes of a request: the participant's page is the least trusted one."""


def experiment_routes(conductor: Conductor, follower: Follower) -> list[Route]:
    """Return the routes; after each request all pages are told."""

    def route(path: str, act: Callable[[Mapping[str, Any]], None]) -> Route:
        async def answer(request: Request) -> Response:
            try:
                values = await _values(request)
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


async def _values(request: Request) -> Mapping[str, Any]:
    """The JSON object of a request. Raises ConfigurationError when there is none."""
    content = b""
    async for piece in request.stream():
        content += piece
        if len(content) > _LARGEST:
            raise ConfigurationError(f"The request is longer than {_LARGEST} bytes.")
    try:
        values = json.loads(content or b"{}")
    except (ValueError, RecursionError):
        values = None
    if not isinstance(values, Mapping):
        raise ConfigurationError("The request is no JSON object.")
    return values
