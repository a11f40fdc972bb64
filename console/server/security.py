"""Who may talk to the console, what a page may load, and what it sends: bounded in length and time."""

from __future__ import annotations

import asyncio
import hmac
import ipaddress
import json
import secrets
import socket
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ...base.errors import ConfigurationError

PARTICIPANT = "/api/participant"
"""What a participant may see."""
ANSWER = "/api/participant/answer"


def is_loopback(address: str) -> bool:
    """True for an address that no other computer can reach."""
    number = _address(address)
    return address == "localhost" if number is None else number.is_loopback


def _address(text: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    """The address that a text is; None for a name."""
    try:
        return ipaddress.ip_address(text)
    except ValueError:
        return None


@dataclass(frozen=True)
class Access:
    """Where the console is, and the tokens of this start."""

    address: str
    port: int
    token: str = field(default_factory=partial(secrets.token_urlsafe, 32))
    """Opens everything."""
    participant: str = field(default_factory=partial(secrets.token_urlsafe, 32))
    """Opens the participant's page only: what they are asked, and their answer; nothing about anybody."""

    @property
    def hosts(self) -> tuple[str, ...]:
        """Values of Host under which the console is asked: those that are known before somebody asks."""
        own = f"[{self.address}]" if ":" in self.address else self.address
        names = [own]
        if own in ("127.0.0.1", "localhost") or self._everywhere:
            names = ["127.0.0.1", "localhost"]
        if self.exposed:
            # Without a question to a name server; .local is what computers without one call each other.
            here = socket.gethostname().lower()
            names += [here, f"{here.removesuffix('.local')}.local"]
        return tuple(f"{name}:{self.port}" for name in dict.fromkeys(names))

    @property
    def origins(self) -> tuple[str, ...]:
        """Origins of the console's pages."""
        return tuple(f"http://{host}" for host in self.hosts)

    @property
    def _everywhere(self) -> bool:
        """Whether the console listens on every address of this computer."""
        return _address(self.address) in (ipaddress.IPv4Address(0), ipaddress.IPv6Address(0))

    def is_here(self, host: str) -> bool:
        """True when `host`, as a request names it, is the console.

        Another name that leads here is a foreign page that pretends to be on this host (DNS rebinding). It
        needs a name for that: a console on every address is asked under any number.
        """
        name, _, port = host.lower().rpartition(":")
        if host.lower() in self.hosts:
            return True
        number = _address(name.removeprefix("[").removesuffix("]"))
        return self._everywhere and number is not None and "%" not in name and port == str(self.port)

    @property
    def url(self) -> str:
        """Address to open, with the token. Behind #, it is sent to no server and stands in no log."""
        return f"http://{self.hosts[0]}/#{self.token}"

    @property
    def exposed(self) -> str:
        """Warning for every page when other computers can reach the console; "" otherwise."""
        if is_loopback(self.address):
            return ""
        where = "every address of this computer" if self._everywhere else self.address
        return (
            f"Other computers can reach this console at {where}, port {self.port}. It is not encrypted: "
            "whoever reads the network can read its token. On them, STOP goes by way of the server."
        )

    def opens(self, given: str, path: str) -> bool:
        """True when a token opens a path."""
        words = [self.token, *([self.participant] if path in (PARTICIPANT, ANSWER) else [])]
        return any(hmac.compare_digest(given.encode(), word.encode()) for word in words)


class Guard:
    """ASGI middleware in front of every route: refuses foreign requests, adds the headers of each answer.

    `stop_origin` gives the worker's origin, to which a page sends STOP.
    """

    def __init__(self, app: ASGIApp, access: Access, stop_origin: Callable[[], str]) -> None:
        self._app, self._access, self._stop_origin = app, access, stop_origin

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """See `Guard`."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers, access = Headers(scope=scope), self._access
        refusal, host = "", headers.get("host", "")
        if not access.is_here(host):
            refusal, host = "The console is not at this address.", access.hosts[0]
        elif headers.get("origin", f"http://{host}") != f"http://{host}":
            refusal = "Only the console's own pages may ask this."
        elif scope["path"].startswith("/api/") and not access.opens(
            headers.get("x-haploop-token", ""), scope["path"]
        ):
            refusal = "This needs the token of the address that `haploop serve` printed."
        if refusal and scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 4403, "reason": refusal})
        elif refusal:
            await self._refuse(refusal, partial(self._with_headers, host, send))
        else:
            await self._app(scope, receive, partial(self._with_headers, host, send))

    async def _refuse(self, sentence: str, send: Send) -> None:
        body = json.dumps({"error": sentence}).encode()
        start: Message = {
            "type": "http.response.start",
            "status": 403,
            "headers": [(b"content-type", b"application/json")],
        }
        await send(start)
        await send({"type": "http.response.body", "body": body})

    async def _with_headers(self, host: str, send: Send, message: Message) -> None:
        if message["type"] == "http.response.start":
            message.setdefault("headers", [])
            headers = MutableHeaders(scope=message)
            for name, value in self._headers(host).items():
                headers[name] = value
        await send(message)

    def _headers(self, host: str) -> dict[str, Any]:
        policy = {
            "default-src": "'none'",
            "script-src": "'self'",
            "style-src": "'self'",
            "img-src": "'self' blob:",
            "connect-src": f"'self' ws://{host} {self._stop_origin()}".rstrip(),
            "base-uri": "'none'",
            "form-action": "'none'",
            "frame-ancestors": "'none'",
            "require-trusted-types-for": "'script'",
        }
        return {
            "Content-Security-Policy": "; ".join(f"{name} {value}" for name, value in policy.items()),
            "Cross-Origin-Opener-Policy": "same-origin",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Referrer-Policy": "no-referrer",
            "X-Content-Type-Options": "nosniff",
            "Cache-Control": "no-store",
        }


# What a page sends: bounded in length and in time, before anything reads it.

LARGEST = 1 << 16
"""Bytes of a request, or of a message on a socket: the participant's page is the least trusted one."""
PATIENCE = 10.0
"""s for a client to send what it has begun to send."""


async def json_object(request: Request) -> Mapping[str, Any]:
    """The JSON object of a request; {} without a body. Raises ConfigurationError when there is none."""
    content = b""
    try:
        async with asyncio.timeout(PATIENCE):
            async for piece in request.stream():
                content += piece
                if len(content) > LARGEST:
                    raise ConfigurationError(f"The request is longer than {LARGEST} bytes.")
    except TimeoutError:
        raise ConfigurationError(f"The request was not sent within {PATIENCE:g} s.") from None
    try:
        values = json.loads(content or b"{}")
    except (ValueError, RecursionError):
        values = None
    if not isinstance(values, Mapping):
        raise ConfigurationError("The request is no JSON object.")
    return values
