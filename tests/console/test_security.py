"""Nothing without the token, nothing from elsewhere, no file of another folder, nothing from outside."""

import os
import re
import socket
from pathlib import Path

import pytest
from starlette.routing import Route
from starlette.testclient import TestClient
from starlette.websockets import WebSocketDisconnect

from haploop.console.data_folder import DataFolder
from haploop.console.server import Access, application
from haploop.console.server.follower import Follower
from haploop.console.worker import Address

STATIC = Path(__file__).parents[2] / "console" / "server" / "static"
SNAPSHOT = {
    "version": 1, "rig": "<script>alert(1)</script>", "simulated": True, "paused": False, "live": None,
    "run": {"doing": "record"},
    "session": {
        "participant": "P07",
        "verdicts": [{"number": 1, "attempt": 1, "accepted": True, "force": 3}],
    },
    "request": {"number": 4, "kind": "Press", "text": "Press.", "participant": "P07", "press": 2, "of": 3},
}  # fmt: skip


class Link:
    """A worker in words: keeps the commands that it was sent."""

    address = Address(1, 4711, "worker's", "stop", "data", "calibrations")

    def __init__(self) -> None:
        self.commands: list[tuple[str, object]] = []
        self.stops = 0
        self.origins: list[str] = []

    def state(self, after=0):
        return SNAPSHOT

    def command(self, name, values):
        self.commands.append((name, values))
        return 200, {"done": True}

    def allow(self, origins):
        self.origins = origins

    def stop(self):
        self.stops += 1
        return {"state": "safe", "sentence": "Safe.", "number": 1}


class Scope:
    """No live blocks."""

    def follow(self, address):
        pass

    def close(self):
        pass

    def about(self):
        return {"rows": []}

    def frame(self, generation, since):
        return generation, since, b""


@pytest.fixture
def link():
    return Link()


@pytest.fixture
def access():
    return Access("127.0.0.1", 8735)


def served(access, link, folder):
    """The application of a console whose worker is `link`, and has told one snapshot."""
    follower = Follower(link, lambda: link, Scope())
    follower.snapshot, follower.count = SNAPSHOT, 1
    return application(access, follower, Scope(), DataFolder(folder / "data", folder / "history"))


@pytest.fixture
def app(link, access, tmp_path):
    return served(access, link, tmp_path)


@pytest.fixture
def page(app, access):
    """A browser on one of the console's pages, with the token."""
    headers = {"X-Haploop-Token": access.token, "Origin": access.origins[0]}
    # Without entering it, the application's lifespan does not run, and nothing follows a worker.
    return TestClient(app, base_url="http://127.0.0.1:8735", headers=headers)


def api(app):
    """Every route that is not a page: method and path."""
    paths = [route for route in app.routes if isinstance(route, Route) and route.path.startswith("/api/")]
    return [(method, route.path.replace("{name}", "start")) for route in paths for method in route.methods]


def test_every_route_but_pages_is_under_api(app):
    pages = {route.path for route in app.routes if isinstance(route, Route)} - {path for _, path in api(app)}
    pages = {path for path in pages if not path.startswith("/api/")}
    assert pages == {"/", "/record", "/study", "/preflight", "/table", "/buttons", "/experiment",
        "/catalogue", "/file", "/design", "/static/glance.css", "/participant"}  # fmt: skip
    assert len(api(app)) > 12


@pytest.mark.parametrize("token", ["", "wrong", "é"])
def test_nothing_is_told_or_done_without_the_token(app, page, access, link, token):
    for method, path in api(app):
        answer = page.request(method, path, headers={"X-Haploop-Token": token.encode()})
        assert answer.status_code == 403, (method, path)
        assert method == "HEAD" or "token" in answer.json()["error"]
    elsewhere = {"X-Haploop-Token": token.encode(), "Cookie": f"token={access.token}"}
    assert page.post(f"/api/stop?token={access.token}", headers=elsewhere).status_code == 403
    assert (link.commands, link.stops) == ([], 0)


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://127.0.0.1:8736", "http://localhost"]
)
def test_another_page_is_refused_even_with_the_token(app, page, link, origin):
    for method, path in [*api(app), ("GET", "/"), ("GET", "/static/console.js")]:
        assert page.request(method, path, headers={"Origin": origin}).status_code == 403, (method, path)
    assert (link.commands, link.stops) == ([], 0)


@pytest.mark.parametrize(
    "host", ["evil.example:8735", "127.0.0.1", "127.0.0.1:80", "127.0.0.1.evil.example:8735"]
)
def test_another_host_is_refused_even_with_the_token(page, host):
    assert page.get("/", headers={"Host": host}).status_code == 403
    assert page.post("/api/stop", headers={"Host": host}).status_code == 403


def test_with_the_token_a_page_commands_and_stops(page, link):
    assert page.post("/api/command/pause", json={"on": True}).json() == {"done": True}
    assert page.post("/api/stop").json()["state"] == "safe"
    assert (link.commands, link.stops) == ([("pause", {"on": True})], 1)
    assert page.post("/api/command/pause", content=b"{").status_code == 400


def test_the_participants_token_opens_their_prompt_only(app, access):
    page = TestClient(app, base_url="http://127.0.0.1:8735", headers={"X-Haploop-Token": access.participant})
    for method, path in api(app):
        expected = {"/api/participant": 200, "/api/participant/answer": 409}.get(path, 403)
        assert page.request(method, path).status_code == expected, (method, path)
    prompt = page.get("/api/participant")
    assert "P07" not in prompt.text, "they read nothing about anybody"
    assert prompt.json()["request"]["text"] == "Press."
    assert prompt.headers["content-type"] == "application/json" and "alert(1)" not in page.get("/").text


def test_the_socket_says_nothing_before_the_token(page, access):
    with page.websocket_connect("ws://127.0.0.1:8735/socket") as socket:
        socket.send_text("wrong")
        with pytest.raises(WebSocketDisconnect) as closed:
            socket.receive_text()
    assert closed.value.code == 4401
    with page.websocket_connect("ws://127.0.0.1:8735/socket") as socket:
        socket.send_text(access.token)
        assert socket.receive_json()["state"]["rig"] == SNAPSHOT["rig"]
    with page.websocket_connect("ws://127.0.0.1:8735/socket") as socket:
        socket.send_text(access.participant)
        assert set(socket.receive_json()["state"]) == {"request", "paused", "simulated", "last", "running",
            "experiment"}  # fmt: skip


@pytest.mark.parametrize("wrong", [{"Origin": "http://evil.example"}, {"Host": "evil.example:8735"}])
def test_the_socket_of_another_page_is_refused(page, wrong):
    with (
        pytest.raises(WebSocketDisconnect) as closed,
        page.websocket_connect("ws://127.0.0.1:8735/socket", headers=wrong),
    ):
        pass
    assert closed.value.code == 4403


@pytest.mark.parametrize(
    "path",
    [
        "/static/../application.py",
        "/static/%2e%2e/application.py",
        "/static/..%2fapplication.py",
        "/../etc/passwd",
    ],
)
def test_no_file_beside_the_pages_is_served(page, path):
    assert page.get(path).status_code == 404


@pytest.mark.parametrize("name", ["../secret.h5", "/etc/passwd", "..%2fsecret.h5"])
def test_no_file_outside_the_data_folder_is_read_and_none_is_one_sentence(page, tmp_path, name):
    (tmp_path / "secret.h5").write_text("secret")
    for route in ("presses?file", "study?study", "calibration?file", "map?map", "button?file", "shown?file"):
        answer = page.get(f"/api/{route}={name}")
        assert answer.status_code == 409
        assert "secret\n" not in answer.text and "data folder" in answer.json()["error"]
    for route in ("presses?file=recordings/no.h5", "study?study=no", "map?map=maps/no", "figure?history=1"):
        answer = page.get(f"/api/{route}")
        assert answer.status_code in (404, 409), route
        assert "Traceback" not in answer.text and len(answer.json()["error"]) > 10


def test_of_nights_only_their_reports_are_read(page, tmp_path):
    (tmp_path / "history" / "reports").mkdir(parents=True)
    (tmp_path / "history" / "reports" / "one.html").write_text("told")
    (tmp_path / "history" / "secret.html").write_text("secret")
    assert page.get("/api/night?report=one.html").text == "told"
    for name in ("../secret.html", "..%2fsecret.html", "secret.html", ""):
        answer = page.get(f"/api/night?report={name}")
        assert answer.status_code == 409 and "no report" in answer.json()["error"]


def test_every_answer_has_the_policy(page):
    for path in ("/", "/record", "/static/console.js", "/api/files", "/nothing"):
        answer = page.get(path)
        policy = dict(
            part.strip().partition(" ")[::2] for part in answer.headers["Content-Security-Policy"].split(";")
        )
        assert policy["default-src"] == policy["frame-ancestors"] == policy["base-uri"] == "'none'"
        assert policy["script-src"] == policy["style-src"] == "'self'"
        assert policy["require-trusted-types-for"] == "'script'"
        assert "http://127.0.0.1:4711" in policy["connect-src"], "STOP goes to the worker"
        assert answer.headers["X-Content-Type-Options"] == "nosniff"
        assert answer.headers["Referrer-Policy"] == "no-referrer"
        assert answer.headers["Cache-Control"] == "no-store"


def test_no_page_or_script_names_another_host_or_makes_markup():
    for path in STATIC.rglob("*.*"):
        text = path.read_text(encoding="utf-8")
        if "vendor" not in path.parts:
            assert not re.search(r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|eval\(", text), path
            assert not re.search(r" on[a-z]+=|<script>|<style|style=", text) or path.suffix == ".svg", path
        hosts = set(re.findall(r"(?:https?:)?//([a-z0-9.-]+\.[a-z]{2,})", text))
        assert hosts <= {"www.w3.org", "github.com"}, (path, hosts)
    assert "MIT" in (STATIC / "vendor" / "uPlot-LICENSE.txt").read_text(encoding="utf-8")


def test_another_address_is_said_on_every_page(app):
    assert Access("127.0.0.1", 1).exposed == Access("::1", 1).exposed == Access("localhost", 1).exposed == ""
    access = Access("192.168.7.5", 8735)
    assert "192.168.7.5, port 8735" in access.exposed
    assert access.hosts[0] == "192.168.7.5:8735"
    # Every page takes it from /api/hello in console.js.
    for name in ("index", "record", "study", "preflight", "table", "buttons", "experiment", "catalogue"):
        assert "console.js" in (STATIC / f"{name}.js").read_text(encoding="utf-8")


def test_on_every_address_the_console_is_asked_by_number_and_by_this_computers_name(link, tmp_path):
    access = Access("0.0.0.0", 8735)
    page = TestClient(served(access, link, tmp_path), headers={"X-Haploop-Token": access.token})
    name = socket.gethostname().lower()
    for host in ("192.168.7.5", "127.0.0.1", "localhost", "[fe80::1]", name, name.upper(), f"{name}.local"):
        answer = page.get("/api/hello", headers={"Host": f"{host}:8735"})
        assert answer.status_code == 200, host
        assert f"ws://{host}:8735" in answer.headers["Content-Security-Policy"]
        for origin, status in ((f"http://{host}:8735", 200), ("http://evil.example:8735", 403)):
            headers = {"Host": f"{host}:8735", "Origin": origin}
            assert page.get("/api/hello", headers=headers).status_code == status, (host, origin)
    for host in ("evil.example:8735", "192.168.7.5", "192.168.7.5:80", "[fe80::1%x; img-src *]:8735", ""):
        assert page.get("/api/hello", headers={"Host": host}).status_code == 403, host
    assert access.url.startswith("http://127.0.0.1:8735/#") and "every address" in access.exposed
    assert Access("127.0.0.1", 8735).is_here("192.168.7.5:8735") is False


def test_each_start_has_its_own_tokens():
    one, other = Access("127.0.0.1", 1), Access("127.0.0.1", 1)
    assert len({one.token, other.token, one.participant, other.participant}) == 4
    assert one.url.split("#")[1] == one.token and len(one.token) > 40


def test_a_link_that_leads_out_of_the_data_folder_is_not_listed_and_hides_no_file(page, tmp_path):
    recordings = tmp_path / "data" / "recordings"
    recordings.mkdir(parents=True)
    (recordings / "P01-latch.h5").write_bytes(b"")
    outside = tmp_path / "outside.h5"
    outside.write_bytes(b"")
    (recordings / "P02-latch.h5").symlink_to(outside)
    (recordings / "P03-latch.h5").symlink_to(outside / "nothing")
    answer = page.get("/api/files")
    assert answer.status_code == 200 and answer.json()["recordings"] == ["recordings/P01-latch.h5"]


@pytest.mark.skipif(os.name == "nt", reason="a link needs rights on Windows")
@pytest.mark.parametrize("linked", ["recordings", "recordings/P01-latch.h5", "study.toml"])
def test_a_study_that_leads_out_of_the_data_folder_is_refused_in_a_sentence(page, tmp_path, linked):
    inside, outside = tmp_path / "data" / "study", tmp_path / "outside"
    for folder in (inside, outside):
        (folder / "recordings").mkdir(parents=True)
        study = 'name = "Test"\nparticipants = ["P01"]\nbuttons = ["latch"]\npresses = 3\n'
        (folder / "study.toml").write_text(study)
    (outside / "recordings" / "P01-latch.h5").write_bytes(b"")
    if (inside / linked).is_dir():
        (inside / linked).rmdir()
    (inside / linked).unlink(missing_ok=True)
    (inside / linked).symlink_to(outside / linked)
    routes = ["study?study=study"]
    routes += ["presses?file=study/recordings/P01-latch.h5"] if linked != "study.toml" else []
    for route in routes:
        answer = page.get(f"/api/{route}")
        assert answer.status_code == 409 and "data folder" in answer.json()["error"], route


@pytest.mark.parametrize(
    ("address", "host"),
    [
        ("::1", "[::1]:80"),
        ("127.0.0.2", "127.0.0.2:80"),
        ("localhost", "127.0.0.1:80"),
        ("::", "127.0.0.1:80"),
    ],
)
def test_the_address_that_is_printed_is_the_one_that_is_listened_on(address, host):
    access = Access(address, 80)
    assert access.hosts[0] == host and access.url.startswith(f"http://{host}/#")
