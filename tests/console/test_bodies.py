"""What is sent to the console without end, without sense or not at all takes nothing from anybody."""

import asyncio
import contextlib
import socket
import threading
import time

import pytest
import uvicorn
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

from haploop.console.server import Access, security, serving
from haploop.console.server.serving import ImpatientProtocol
from tests.console.test_security import Link, served


@pytest.fixture
def page(tmp_path):
    access, link = Access("127.0.0.1", 8735), Link()
    headers = {"X-Haploop-Token": access.token}
    found = TestClient(served(access, link, tmp_path), base_url="http://127.0.0.1:8735", headers=headers)
    found.link = link
    return found


@pytest.mark.parametrize("body", [b"[" * 200_000, b"[" * 60_000, b"\xff", b"[]", b"1", b'{"a": ' * 9_000])
def test_a_body_that_is_no_object_is_refused_in_a_sentence(page, body):
    for path in ("/api/command/start", "/api/experiment/begin", "/api/participant/answer"):
        answer = page.post(path, content=body)
        assert answer.status_code in (400, 409) and "The request is" in answer.json()["error"]
    assert not page.link.commands


def test_no_more_of_a_body_is_read_than_a_request_may_have(page):
    read = 0

    def endless():
        nonlocal read
        for _ in range(10_000):
            read += 1 << 16
            yield b" " * (1 << 16)

    async def receive():
        return {"type": "http.request", "body": next(pieces), "more_body": True}

    from starlette.requests import Request

    pieces = endless()
    with pytest.raises(Exception, match="longer than 65536 bytes"):
        asyncio.run(security.json_object(Request({"type": "http", "method": "POST"}, receive)))
    assert read <= 3 << 16


def test_a_body_that_stops_coming_is_not_waited_for(monkeypatch):
    async def receive():
        await asyncio.sleep(60)

    from starlette.requests import Request

    monkeypatch.setattr(security, "PATIENCE", 0.05)
    with pytest.raises(Exception, match=r"not sent within 0\.05 s"):
        asyncio.run(security.json_object(Request({"type": "http", "method": "POST"}, receive)))


@pytest.mark.parametrize("first", [b"\x00\xff", b""])
def test_a_binary_first_message_is_no_token(page, first):
    with page.websocket_connect("ws://127.0.0.1:8735/socket") as socket:
        socket.send_bytes(first)
        with pytest.raises(WebSocketDisconnect) as closed:
            socket.receive_text()
    assert closed.value.code == 4401


async def app(scope, receive, send):
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.accept"})
        await receive()
        return
    if scope["path"] == "/slow":
        await asyncio.sleep(1.5)
    await send({"type": "http.response.start", "status": 200, "headers": [(b"content-length", b"2")]})
    await send({"type": "http.response.body", "body": b"ok"})


@pytest.fixture
def port(monkeypatch):
    monkeypatch.setattr(serving, "PATIENCE", 0.4)
    options = {"log_level": "error", "lifespan": "off", "http": ImpatientProtocol, "ws": "websockets-sansio"}
    server = uvicorn.Server(uvicorn.Config(app, **options, timeout_keep_alive=30))
    with contextlib.closing(socket.create_server(("127.0.0.1", 0))) as listener:
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
        thread.start()
        yield listener.getsockname()[1]
        server.should_exit = True
        thread.join()


GET = b"GET /%s HTTP/1.1\r\nHost: x\r\n\r\n"


def test_half_open_connections_are_closed_and_others_answered(port):
    opened = [socket.create_connection(("127.0.0.1", port)) for _ in range(100)]
    for number, one in enumerate(opened):
        one.settimeout(10)
        match number % 4:
            case 1:
                one.sendall(b"GET / HT")
            case 2:
                one.sendall(GET % b"")
            case 3:  # a second request that never ends
                one.sendall(GET % b"" + b"GET / HT")
    slow = socket.create_connection(("127.0.0.1", port))
    slow.sendall(GET % b"slow")
    slow.settimeout(10)
    for one in opened:
        while one.recv(4096):
            pass  # until the server closes it
        one.close()
    assert b"200 OK" in slow.recv(4096), "a request that is being answered is waited for"
    slow.close()


def test_a_socket_that_is_silent_is_a_websockets_own_matter(port):
    one = socket.create_connection(("127.0.0.1", port))
    one.sendall(
        b"GET / HTTP/1.1\r\nHost: x\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
    )
    one.settimeout(10)
    assert b"101 Switching" in one.recv(4096)
    one.settimeout(0.1)
    until = time.monotonic() + 1.5
    while time.monotonic() < until:
        with pytest.raises(TimeoutError):
            one.recv(4096)
    one.close()
