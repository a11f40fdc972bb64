"""What listens, listens on this computer only; and nothing that arrives is ever run."""

import ast
import socket
from pathlib import Path

import grpc
import pytest

ROOMS = ("instruments", "acquisition", "calibration", "haploop", "mocks")
RUNS = {"eval", "exec", "compile", "__import__"}
UNPICKLES = {"pickle", "marshal", "shelve", "dill", "joblib", "cloudpickle"}


def test_listeners_are_on_loopback_only(monkeypatch):
    """Every wire of the rigs that haploop ships, and the addresses that they asked the system for."""
    from haploop.base.clock import RealClock
    from haploop.base.validation import validate
    from haploop.instruments import load_rig_file
    from haploop.mocks.simulation import Simulation
    from haploop.mocks.transport import Loopback

    bound: list[str] = []
    bind, serve = socket.socket.bind, grpc.server

    def noted(self, address):
        bound.append(address[0])
        bind(self, address)

    def watched(*args, **more):
        server = serve(*args, **more)
        add = server.add_insecure_port

        def add_noted(address):
            bound.append(address.rsplit(":", 1)[0])
            return int(add(address))

        server.add_insecure_port = add_noted
        return server

    monkeypatch.setattr(socket.socket, "bind", noted)
    monkeypatch.setattr(grpc, "server", watched)
    file = load_rig_file("bench")
    simulation = Simulation(file, RealClock())
    try:
        from importlib import metadata

        drivers = {entry.name: entry for entry in metadata.entry_points(group="haploop.drivers")}
        for role in ("daq", "relay", "vibrometer", "generator"):
            device = getattr(file, role)
            settings = validate(drivers[device.driver].load().Settings, device.settings, role)
            simulation.serve(device.driver, settings)
        with Loopback(lambda _link: None):
            pass
    finally:
        simulation.close()
    assert len(bound) >= 4
    assert set(bound) == {"127.0.0.1"}


@pytest.mark.long
@pytest.mark.parametrize("room", ROOMS)
def test_nothing_is_unpickled_or_evaluated(room):
    for path in (Path(__file__).parents[1] / room).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            match node:
                case ast.Call(func=ast.Name(id=name)):
                    assert name not in RUNS, f"{path}:{node.lineno} calls {name}"
                case ast.Call(keywords=words):
                    assert not any(word.arg == "allow_pickle" for word in words), f"{path}:{node.lineno}"
                case ast.Import(names=names):
                    assert not UNPICKLES & {name.name.split(".")[0] for name in names}, path
                case ast.ImportFrom(module=str(module)):
                    assert module.split(".")[0] not in UNPICKLES, path
