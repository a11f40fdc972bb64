"""The worker's HTTP listener on loopback: commands and snapshot for the server, STOP for the pages.

The standard library's server, with a thread for each request: STOP must not depend on the server's packages,
nor wait for another request.
"""

from __future__ import annotations

import hmac
import json
import socket
import threading
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from typing import Any
from urllib.parse import unquote

from ...base.errors import HaploopError
from .worker import Worker

_LARGEST = 1 << 20
_LONG_POLL = 1.0
"""s for which a question for the snapshot waits for a new one. A console that is stopped waits for the answer
before it ends the worker.
"""
_DEADLINE = 5.0
"""s for a client to send its request, so that a silent one keeps no thread."""
_MOST_SILENT = 64
"""Connections that have not sent their request yet; the oldest is closed for the next one."""


class Listener(ThreadingHTTPServer):
    """Listens on a free port of loopback. `token` opens everything, `stop_token` only STOP."""

    daemon_threads = True
    request_queue_size = 128
    # Otherwise a second worker could listen on the same port on Windows.
    allow_reuse_address = False

    def __init__(self, worker: Worker, token: str, stop_token: str, port: int = 0) -> None:
        self.worker, self.token, self.stop_token = worker, token, stop_token
        self.origins: set[str] = set()
        """Origins of the server's pages, which may send STOP."""
        self._silent: dict[socket.socket, None] = {}
        self._changing = threading.Lock()
        super().__init__(("127.0.0.1", port), _Handler)
        self.port: int = self.server_address[1]
        self.hosts = {f"127.0.0.1:{self.port}", f"localhost:{self.port}"}

    def service_actions(self) -> None:
        """See `socketserver.BaseServer`: called every half second."""
        self.worker.watch()

    def process_request(self, request: Any, client_address: Any) -> None:
        """See `socketserver.BaseServer`: silent connections must not use up what STOP needs."""
        with self._changing:
            self._silent[request] = None
            oldest = next(iter(self._silent)) if len(self._silent) > _MOST_SILENT else None
            if oldest is not None:
                del self._silent[oldest]
        if oldest is not None:
            with suppress(OSError):
                oldest.shutdown(socket.SHUT_RDWR)  # its thread's wait ends, and closes it
        super().process_request(request, client_address)

    def heard(self, request: socket.socket) -> None:
        """Note that a connection has sent its request, or has gone."""
        with self._changing:
            self._silent.pop(request, None)

    def shutdown_request(self, request: Any) -> None:
        """See `socketserver.BaseServer`."""
        self.heard(request)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Do nothing: a client that has gone is no error."""


class _Handler(BaseHTTPRequestHandler):
    server: Listener
    timeout = _DEADLINE
    server_version, sys_version = "haploop", ""

    def do_GET(self) -> None:
        """Answer the snapshot, or the page with nothing but STOP."""
        self.server.heard(self.connection)
        path = self.path.partition("?")[0]
        if not self._host():
            return self._say(403, {"error": "This address is not the worker's."})
        if path == "/state" and self._opens(self.server.token):
            self.server.worker.heard()
            try:
                after = int(self.headers.get("X-After", "0"))
            except ValueError:
                after = 0
            text = self.server.worker.board.snapshot(after, _LONG_POLL)
            self.server.worker.heard()
            return self._send(200, "application/json", text.encode())
        kinds = {"/": ("stop.html", "text/html"), "/stop.js": ("stop.js", "text/javascript")}
        if path in kinds:
            name, kind = kinds[path]
            return self._send(200, kind, resources.files(__package__).joinpath(name).read_bytes())
        return self._say(403, {"error": "This needs the worker's token."})

    def do_POST(self) -> None:
        """Do a command, or STOP."""
        origin = self.headers.get("Origin")
        own = {f"http://{host}" for host in self.server.hosts}
        if not self._host() or (origin is not None and origin not in self.server.origins | own):
            return self._say(403, {"error": "Commands come from the console's own pages only."})
        body = self._body()
        self.server.heard(self.connection)
        if self.path == "/stop":
            # In the body as plain text, so that a page of another port may send it without asking first.
            if not _same(body.decode("ascii", "replace"), self.server.stop_token):
                return self._say(403, {"error": "STOP needs its token."})
            return self._say(200, self.server.worker.stop())
        if not self._opens(self.server.token):
            return self._say(403, {"error": "This needs the worker's token."})
        self.server.worker.heard()
        return self._say(*self._done(body))

    def _done(self, body: bytes) -> tuple[int, dict[str, Any]]:
        """Do a command; return the status and the answer."""
        try:
            values = json.loads(body)
            if self.path == "/origins":
                self.server.origins |= {str(origin) for origin in values}  # those of an earlier server too
                return 200, {"done": True}
            # Apart from the rest, so that a page, which names a command, names nothing else.
            return 200, self.server.worker.command(unquote(self.path.removeprefix("/command/")), values)
        except HaploopError as error:
            return 409, {"error": str(error)}
        except (ValueError, TypeError, AttributeError, KeyError, RecursionError) as error:
            return 400, {"error": f"The command cannot be read ({type(error).__name__}: {error})."}

    def _host(self) -> bool:
        # Another name that leads here is a page's attempt to be on the same host (DNS rebinding).
        return self.headers.get("Host", "") in self.server.hosts

    def _opens(self, token: str) -> bool:
        return _same(self.headers.get("Authorization", ""), f"Bearer {token}")

    def _body(self) -> bytes:
        try:
            length = int(self.headers.get("Content-Length", "0"))
        except ValueError:
            length = 0
        return self.rfile.read(max(0, min(length, _LARGEST)))

    def _say(self, code: int, values: dict[str, Any]) -> None:
        self._send(code, "application/json", json.dumps(values).encode())

    def _send(self, code: int, kind: str, content: bytes) -> None:
        self.send_response(code)
        origin = self.headers.get("Origin")
        headers = {
            "Content-Type": f"{kind}; charset=utf-8",
            "Content-Length": str(len(content)),
            "Cache-Control": "no-store",
            "X-Content-Type-Options": "nosniff",
            "Content-Security-Policy": "default-src 'none'; script-src 'self'; connect-src 'self'; "
            "style-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
            "Connection": "close",
            **({"Access-Control-Allow-Origin": origin} if origin in self.server.origins else {}),
        }
        for name, value in headers.items():
            self.send_header(name, str(value))
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *args: Any) -> None:
        """Write nothing: the addresses hold no secret, and nobody reads them."""


def _same(given: str, wanted: str) -> bool:
    return hmac.compare_digest(given.encode(), wanted.encode())
