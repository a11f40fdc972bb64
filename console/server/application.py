"""The console's ASGI application. Each group of pages brings its routes; this file joins them."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import BaseRoute, Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

from ...base.errors import ConfigurationError, HaploopError, InstrumentError
from ...reports.html import GLANCE_STYLE
from ..data_folder import DataFolder
from .conductor import Conductor
from .data_routes import data_routes
from .design_routes import design_routes
from .follower import Follower, LiveScope
from .run_queue import RunQueue, experiment_routes, queue_routes
from .security import PARTICIPANT, Access, Guard, json_object

_STATIC = Path(__file__).parent / "static"
PAGES = (
    "record",
    "study",
    "preflight",
    "table",
    "buttons",
    "experiment",
    "catalogue",
    "file",
    "design",
    "participant",
)
"""Pages beside the first one: PAGE.html in the folder of static files."""
_PERIOD = 0.02
"""s between two looks for new buckets; the console records a block every 40 ms, and each is a frame."""
_LOOK = 1.0
"""s between two looks whether another program has changed what is lined up, or the active calibration."""
_TOKEN_DEADLINE = 5.0


def application(access: Access, follower: Follower, scope: LiveScope, data: DataFolder) -> Starlette:
    """Return the application."""
    conductor = Conductor(data, follower.command)
    queue = RunQueue(data, follower.command)

    def heard(snapshot: dict[str, Any]) -> None:
        conductor.heard(snapshot)
        with contextlib.suppress(HaploopError):  # the page says what is wrong with the list
            queue.heard(snapshot)

    follower.heard, conductor.completed = heard, queue.completed
    shown = {
        True: lambda: {
            **follower.snapshot,
            "experiment": conductor.operator,
            "queue": queue.shown,
            "calibrations": data.calibrations,
        },
        False: lambda: {**_for_participant(follower.snapshot), "experiment": conductor.participant},
    }

    def page(name: str) -> Route:
        async def answer(_: Request) -> Response:
            return FileResponse(_STATIC / f"{name}.html")

        return Route("/" if name == "index" else f"/{name}", answer)

    async def glance_style(_: Request) -> Response:
        return FileResponse(GLANCE_STYLE)

    async def command(request: Request) -> Response:
        try:
            values = await json_object(request)
            name = request.path_params["name"]
            status, answer = await asyncio.to_thread(follower.command, name, values)
        except InstrumentError as error:
            return JSONResponse({"error": str(error)}, 503)
        except ConfigurationError as error:
            return JSONResponse({"error": str(error)}, 400)
        return JSONResponse(answer, status)

    async def stop(_: Request) -> Response:
        try:
            return JSONResponse(await asyncio.to_thread(follower.link.stop))
        except InstrumentError as error:
            return JSONResponse({"error": str(error)}, 503)

    async def hello(_: Request) -> Response:
        link = follower.link.address
        return JSONResponse(
            {
                "stop": {"url": f"http://127.0.0.1:{link.port}/stop", "token": link.stop_token},
                "stop_page": f"http://127.0.0.1:{link.port}/#{link.stop_token}",
                "participant": f"/participant#{access.participant}",
                "exposed": access.exposed,
            }
        )

    async def participant(_: Request) -> Response:
        return JSONResponse(shown[False]())

    async def socket(websocket: WebSocket) -> None:
        await websocket.accept()
        with contextlib.suppress(WebSocketDisconnect, TimeoutError, RuntimeError):
            async with asyncio.timeout(_TOKEN_DEADLINE):
                token = (await websocket.receive()).get("text") or ""  # of a binary message, too
            if access.opens(token, "/socket"):
                await _serve(websocket, follower, scope, shown[True], frames=True)
            elif access.opens(token, PARTICIPANT):
                await _serve(websocket, follower, scope, shown[False], frames=False)
            else:
                await websocket.close(4401)

    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        running = (follower.run([*access.origins]), _watch(queue, data, follower))
        tasks = [asyncio.create_task(one) for one in running]
        yield
        for task in tasks:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError, HaploopError):
                await task
        scope.close()
        await asyncio.to_thread(conductor.end)

    routes: list[BaseRoute] = [
        *(page(name) for name in ("index", *PAGES)),
        Route("/api/hello", hello),
        Route("/api/stop", stop, methods=["POST"]),
        Route("/api/command/{name}", command, methods=["POST"]),
        Route(PARTICIPANT, participant),
        *data_routes(data),
        *design_routes(data),
        *experiment_routes(conductor, follower),
        *queue_routes(queue, follower),
        WebSocketRoute("/socket", socket),
        Route("/static/glance.css", glance_style),
        Mount("/static", StaticFiles(directory=_STATIC)),
    ]
    app = Starlette(routes=routes, lifespan=lifespan)
    app.add_middleware(
        Guard, access=access, stop_origin=lambda: f"http://127.0.0.1:{follower.link.address.port}"
    )
    return app


async def _watch(queue: RunQueue, data: DataFolder, follower: Follower) -> None:
    """Have the pages told when another program has changed what is lined up, or the history."""
    known = data.calibrations
    while True:
        await asyncio.sleep(_LOOK)
        before, known = known, await asyncio.to_thread(lambda: data.calibrations)
        if known != before or await asyncio.to_thread(lambda: queue.changed):
            await follower.tell()


async def _serve(
    websocket: WebSocket,
    follower: Follower,
    scope: LiveScope,
    shown: Callable[[], dict[str, Any]],
    frames: bool,
) -> None:
    """Send snapshots, counts of samples and frames, until the page has gone.

    A frame holds all buckets since the last one, so a page that lags misses none, up to 20 s.
    """
    gone = asyncio.create_task(_until_gone(websocket))
    count, generation, since, told, ticks = 0, -1, 0, -1, 0
    try:
        while not gone.done():
            if follower.count > count:
                count = follower.count
                await websocket.send_text(json.dumps({"state": shown()}))
            if not frames:
                await follower.newer(count, 0.5)  # and see whether the page has gone
                continue
            number, following, frame = scope.frame(generation, since)
            if number != told or ticks % 20 == 0:
                told = number
                about = await asyncio.to_thread(scope.about)
                await websocket.send_text(json.dumps({"scope": about}))
            generation, since = number, following
            if frame:
                await websocket.send_bytes(frame)
            ticks += 1
            await asyncio.sleep(_PERIOD)
    finally:
        gone.cancel()


async def _until_gone(websocket: WebSocket) -> None:
    with contextlib.suppress(WebSocketDisconnect, RuntimeError):
        while True:
            await websocket.receive()


def _for_participant(snapshot: dict[str, Any]) -> dict[str, Any]:
    """What a participant may see: the prompt, and whether it waits."""
    request = snapshot.get("request")
    shown = None
    if request is not None and request["kind"] in ("Press", "Touch", "Rest"):
        keys = ("number", "kind", "text", "press", "of", "attempt", "duration", "patience")
        shown = {key: request[key] for key in keys if key in request}
    session = snapshot.get("session")
    last = session["verdicts"][-1] if session and session["verdicts"] else None
    return {
        "request": shown,
        "paused": bool(snapshot.get("paused")),
        "simulated": bool(snapshot.get("simulated")),
        "last": None if last is None else {key: last[key] for key in ("number", "attempt", "accepted")},
        "running": bool((snapshot.get("run") or {}).get("doing") == "record"),
    }
