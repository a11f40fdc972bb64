"""The console as a program: its ASGI application, whose routes each group of pages brings, and its server.

It runs worker, application and socket until Ctrl-C; connections that send nothing are closed.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import BaseRoute, Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect
from uvicorn.protocols.http.h11_impl import H11Protocol

from ...base.errors import ConfigurationError, HaploopError, InstrumentError
from ...instruments import RigFile
from ...instruments.driver import Mode
from ...reports.html import GLANCE_STYLE
from ...terminal.progress import note
from ..data_folder import DataFolder
from ..worker import WorkerLink, free_tape, serving, start_worker
from .conductor import Conductor
from .data_routes import data_routes
from .design_routes import design_routes
from .follower import Follower, LiveScope
from .run_queue import RunQueue, experiment_routes, queue_routes
from .security import LARGEST, PARTICIPANT, PATIENCE, Access, Guard, json_object

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


class ImpatientProtocol(H11Protocol):
    """HTTP that closes a connection on which no request was made for up to twice `PATIENCE`.

    uvicorn itself limits only the time between an answer and the next request's first byte.
    """

    _looked_at: Any = None
    _look: asyncio.TimerHandle | None = None

    def connection_made(self, transport: Any) -> None:
        """See `asyncio.Protocol`."""
        super().connection_made(transport)
        self._look = self.loop.call_later(PATIENCE, self._close_if_silent)

    def connection_lost(self, exc: Exception | None) -> None:
        """See `asyncio.Protocol`."""
        if self._look is not None:
            self._look.cancel()
        super().connection_lost(exc)

    def _close_if_silent(self) -> None:
        if self.transport.is_closing() or self.transport.get_protocol() is not self:
            return  # a WebSocket's now, which has a deadline of its own
        cycle = self.cycle
        answered = cycle is None or cycle.response_complete
        if answered and (cycle is None or cycle is self._looked_at):
            self.transport.close()
            return
        self._looked_at = cycle if answered else None
        self._look = self.loop.call_later(PATIENCE, self._close_if_silent)


def serve_console(
    rig: str,
    file: RigFile,
    simulate: Mode | None,
    data: DataFolder,
    address: str,
    port: int,
    ready: Callable[[Access], object],
    virtual_time: bool = False,
    tape: Path | None = None,
) -> None:
    """Serve the console of a rig until a stop signal, and call `ready` when its address can be opened.

    A stop signal reaches the safe state and ends the worker; beside another server of the rig, it stops what
    was begun here only. A server that is killed leaves the worker running, and the next one takes it over.
    The worker's sessions are recorded on `tape`, those of one that follows it on a numbered tape beside it.
    Raises ConfigurationError for an address or port that cannot be used, and what `serving` and
    `start_worker` raise.
    """

    def worker() -> WorkerLink:
        return start_worker(rig, file, simulate, data, virtual_time, free_tape(tape))

    with _bound(address, port) as listener, ExitStack() as stack:
        access = Access(address, listener.getsockname()[1])
        # Before the worker is found, so that no other server ends it in between.
        elsewhere = stack.enter_context(serving(file, simulate))
        scope = LiveScope(file, simulate)
        follower = Follower(worker(), worker, scope)
        try:
            config = uvicorn.Config(
                application(access, follower, scope, data),
                log_level="error",
                access_log=False,
                http=ImpatientProtocol,
                ws="websockets-sansio",
                ws_max_size=LARGEST,
                timeout_graceful_shutdown=1,
            )
            logging.getLogger("uvicorn.error").addFilter(_of_a_fault)
            ready(access)
            uvicorn.Server(config).run(sockets=[listener])
        finally:
            # Not marked any more: of two that end at once, one at least sees no other.
            stack.close()
            if follower.leave(elsewhere()):
                note(
                    "The console's worker goes on, because another `haploop serve` of this rig runs. "
                    "`haploop serve --stop` ends it."
                )


def _of_a_fault(record: logging.LogRecord) -> bool:
    """Whether a line of the log is one of a fault: not of pages that a stop leaves without their answer."""
    cut = record.exc_info is not None and isinstance(record.exc_info[1], asyncio.CancelledError)
    return not cut and "graceful shutdown exceeded" not in record.getMessage()


def _bound(address: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    try:
        return socket.create_server((address, port), family=family)
    except OSError as error:
        raise ConfigurationError(
            f"The console cannot listen on {address}, port {port} ({error.strerror or error}): choose "
            "another with --port, or 0 for a free one."
        ) from None
