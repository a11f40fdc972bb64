"""The worker's listener: STOP and looks over a socket, for those who have a token."""

import http.client
import json
import socket
import threading
from contextlib import suppress

import pytest

from haploop.base.errors import InstrumentError
from haploop.console.worker import Address, WorkerLink
from haploop.console.worker.listener import Listener
from tests.console.test_worker import DEADLINE, made, until
from tests.raising import raises


@pytest.fixture
def listener(tmp_path):
    found = Listener(made(tmp_path), "token", "stop-token")
    found.worker.stop = lambda: {"state": "safe", "sentence": "Safe.", "number": 1}
    threading.Thread(target=found.serve_forever, args=(0.01,), daemon=True).start()
    yield found
    found.shutdown()
    found.server_close()


def ask(listener, method, path, body=b"", **headers):
    connection = http.client.HTTPConnection("127.0.0.1", listener.port, timeout=10)
    connection.request(method, path, body, {name.replace("_", "-"): value for name, value in headers.items()})
    answer = connection.getresponse()
    found = answer.status, answer.read(), answer.headers
    connection.close()
    return found


def test_the_listener_opens_for_its_tokens_only(listener):
    assert ask(listener, "GET", "/state")[0] == 403
    assert ask(listener, "GET", "/state", Authorization="Bearer stop-token")[0] == 403
    assert json.loads(ask(listener, "GET", "/state", Authorization="Bearer token")[1])["rig"] == "simulated"
    assert ask(listener, "POST", "/command/override", b'{"reason": "none"}')[0] == 403
    assert ask(listener, "POST", "/stop", b"token")[0] == 403
    assert ask(listener, "POST", "/stop", b"")[0] == 403
    assert json.loads(ask(listener, "POST", "/stop", b"stop-token")[1])["state"] == "safe"
    assert ask(listener, "POST", "/command/override", b"[]", Authorization="Bearer token")[0] == 400
    assert ask(listener, "POST", "/command/override", b"{", Authorization="Bearer token")[0] == 400
    assert ask(listener, "POST", "/command/explode", b"{}", Authorization="Bearer token")[0] == 409


def test_the_listener_answers_the_consoles_pages_and_no_others(listener):
    page = "http://127.0.0.1:8735"
    status, body, headers = ask(listener, "GET", "/")
    assert status == 200 and b"STOP" in body and b"stop.js" in body
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert b"fetch" in ask(listener, "GET", "/stop.js")[1]
    assert ask(listener, "POST", "/stop", b"stop-token", Origin=page)[0] == 403
    link = WorkerLink(Address(1, listener.port, "token", "stop-token", "data", "calibrations"))
    for name in ("origins", "stop", "../origins", "/origins", "origins?", "state", "é\r\n"):
        status, answer = link.command(name, ["http://evil.example"])
        assert status == 409 and "no command" in answer["error"], name
    assert not listener.origins
    link.allow([page])
    status, _, headers = ask(listener, "POST", "/stop", b"stop-token", Origin=page)
    assert (status, headers["Access-Control-Allow-Origin"]) == (200, page)
    assert ask(listener, "POST", "/stop", b"stop-token", Origin="http://evil.example")[0] == 403
    assert ask(listener, "POST", "/stop", b"stop-token", Host="evil.example")[0] == 403
    assert ask(listener, "GET", "/state", Authorization="Bearer token", Host="evil.example")[0] == 403
    gone = WorkerLink(Address(1, 9, "token", "stop-token", "data", "calibrations"))
    raises(InstrumentError, "does not answer", gone.state)
    gone.end()


def test_silent_connections_hold_nothing_up(listener, monkeypatch):
    """As many as a program may open, and more: the oldest are closed, and STOP is answered."""
    monkeypatch.setattr("haploop.console.worker.listener._MOST_SILENT", 8)
    silent = []
    for _ in range(40):
        silent.append(socket.create_connection(("127.0.0.1", listener.port)))
    status, _, _ = ask(listener, "POST", "/stop", b"stop-token")
    assert status == 200
    until(lambda: len(listener._silent) <= 8)
    silent[0].settimeout(DEADLINE)
    with suppress(ConnectionError):
        assert silent[0].recv(1) == b"", "the oldest one was closed"
    for one in silent:
        one.close()
