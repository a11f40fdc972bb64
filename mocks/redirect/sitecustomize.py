"""Points nidaqmx, pyserial and PyVISA at simulated devices, in a program that knows nothing of it.

`haploop twin ... -- python script.py` puts this folder first on the program's PYTHONPATH: Python imports
`sitecustomize` at its start. The libraries are imported by the program only. It needs no haploop.
"""

from __future__ import annotations

import importlib.util
import json
import os
import sys
from collections.abc import Callable, Mapping
from importlib.machinery import ModuleSpec, PathFinder
from typing import Any

NI, SERIAL, VISA = "HAPLOOP_NI_TWIN", "HAPLOOP_SERIAL_TWIN", "HAPLOOP_VISA_TWIN"
"""Environment variables: the address of NI's server; JSON objects of the names of serial ports and VISA
resources, and what stands for each."""

CREATED, FOLDER = "haploop-created-bin", "haploop-folder-bin"
IGNORED, IN_CALLBACK = "haploop-ignored-bin", "haploop-in-callback"
"""Metadata between `driver` and haploop's server: the names of new channels, the folder from which a
program names its files, properties without effect, and that a callback makes the call."""

_KEYS = {"created": CREATED, "folder": FOLDER, "ignored": IGNORED, "in_callback": IN_CALLBACK}


def redirect(utils: Any, options: Callable[[], Any]) -> Callable[[], None]:
    """Make tasks and systems without gRPC options use `options()`; return what undoes it.

    `utils` is the module in which nidaqmx chooses between the driver and a server.
    """
    before = utils._select_interpreter

    def select(grpc_options: Any = None, interpreter: Any = None) -> Any:
        if grpc_options or interpreter:
            return before(grpc_options, interpreter)
        return driver().DriverInterpreter(options(), _KEYS)

    utils._select_interpreter = select
    return lambda: setattr(utils, "_select_interpreter", before)


def driver() -> Any:
    """The module `driver` beside this file, which is no package where this is another program's."""
    name = "haploop_redirected_driver"
    if name not in sys.modules:
        beside = os.path.join(os.path.dirname(os.path.abspath(__file__)), "driver.py")  # noqa: PTH100, PTH118, PTH120
        spec = importlib.util.spec_from_file_location(name, beside)
        assert spec is not None and spec.loader is not None, beside
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        sys.modules[name] = module
    return sys.modules[name]


def options_for(address: str) -> Any:
    """Return nidaqmx's gRPC options for a server on this computer."""
    import grpc  # noqa: PLC0415
    from nidaqmx import GrpcSessionOptions, SessionInitializationBehavior  # noqa: PLC0415

    limits = [("grpc.max_receive_message_length", -1), ("grpc.max_send_message_length", -1)]
    # A proxy that the environment names would catch even 127.0.0.1.
    channel = grpc.insecure_channel(address, options=[*limits, ("grpc.enable_http_proxy", 0)])
    # As the driver: a second task of a name is refused (-200089), and not the first one again.
    new = SessionInitializationBehavior.INITIALIZE_SERVER_SESSION
    return GrpcSessionOptions(channel, "", initialization_behavior=new)


def redirect_serial(serial: Any, ports: Mapping[str, str]) -> None:
    """Let the module `serial` open what stands for a port: a device, or the URL of a socket."""
    own, by_url = serial.Serial, serial.serial_for_url

    def meant(port: Any) -> Any:
        return ports.get(port, port)

    class Serial(own):  # type: ignore[misc, valid-type]
        """See pyserial's."""

        def __new__(cls, port: Any = None, *how: Any, **more: Any) -> Any:
            if "://" in str(meant(port)):
                return by_url(meant(port), *how, **more)
            return super().__new__(cls)

        @property
        def port(self) -> Any:
            """See pyserial's."""
            return own.port.fget(self)

        @port.setter
        def port(self, port: Any) -> None:
            own.port.fset(self, meant(port))

    serial.Serial = Serial
    serial.serial_for_url = lambda url, *how, **more: by_url(meant(url), *how, **more)


def redirect_visa(highlevel: Any, resources: Mapping[str, str]) -> None:
    """Let PyVISA's resource managers list and open what stands for a resource, by pyvisa-py."""
    manager = highlevel.ResourceManager
    new, opened = manager.__new__, manager.open_resource
    meant = {name.upper(): other for name, other in resources.items()}

    def open_resource(self: Any, resource_name: str, *how: Any, **more: Any) -> Any:
        other = meant.get(resource_name.upper())
        if other is None:
            return opened(self, resource_name, *how, **more)
        # A socket has no end of a message of its own, as USB and VXI-11 have.
        return opened(self, other, *how, **{"read_termination": "\n", "write_termination": "\n", **more})

    manager.__new__ = staticmethod(lambda cls, visa_library="": new(cls, "@py"))
    manager.list_resources = lambda self, query="?*::INSTR": tuple(resources)
    manager.open_resource = open_resource


def _nidaqmx(utils: Any, address: str) -> None:
    made: list[Any] = []

    def options() -> Any:
        if not made:
            made.append(options_for(address))
        return made[0]

    redirect(utils, options)


_AFTER: dict[str, tuple[str, Callable[[Any, str], None]]] = {
    "nidaqmx.utils": (NI, _nidaqmx),
    "serial": (SERIAL, lambda module, told: redirect_serial(module, json.loads(told))),
    "pyvisa.highlevel": (VISA, lambda module, told: redirect_visa(module, json.loads(told))),
}
"""What is done after a module was imported, with the value of an environment variable."""


class _Redirects:
    """Finder of imports that lets modules load as they are, and then redirects them."""

    def __init__(self) -> None:
        self._left = {name: step for name, step in _AFTER.items() if step[0] in os.environ}

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        if name not in self._left:
            return None
        variable, step = self._left.pop(name)
        spec = importlib.util.find_spec(name)
        if spec is not None and spec.loader is not None:
            load = spec.loader.exec_module

            def exec_module(module: Any) -> None:
                load(module)
                step(module, os.environ[variable])

            spec.loader.exec_module = exec_module  # type: ignore[method-assign]
        return spec


def _start() -> None:
    here = os.path.dirname(os.path.abspath(__file__))  # noqa: PTH100, PTH120
    sys.path[:] = [folder for folder in sys.path if os.path.abspath(folder or ".") != here]  # noqa: PTH100
    sys.meta_path.insert(0, _Redirects())
    # The environment's own, which this file stands before.
    spec = PathFinder.find_spec("sitecustomize")
    if spec is not None and spec.loader is not None:
        spec.loader.exec_module(importlib.util.module_from_spec(spec))


if __name__ == "sitecustomize" and {NI, SERIAL, VISA} & os.environ.keys():
    _start()
