"""Points nidaqmx, pyserial and PyVISA at simulated devices, in a program that knows nothing of it.

`haploop twin ... -- python script.py` puts this folder first on the program's PYTHONPATH: Python imports
`sitecustomize` at its start. The libraries are imported by the program only. It needs no haploop.
"""

from __future__ import annotations

import importlib.util
import json
import os
import socket
import sys
from collections.abc import Callable, Collection, Mapping
from importlib.machinery import ModuleSpec, PathFinder
from typing import Any

NI, SERIAL, VISA = "HAPLOOP_NI_TWIN", "HAPLOOP_SERIAL_TWIN", "HAPLOOP_VISA_TWIN"
HOSTS = "HAPLOOP_HOSTS_TWIN"
"""Environment variables: the address of NI's server; JSON objects of the names of serial ports, of VISA
resources and of addresses of a network ("host:port"), and what stands for each."""
ALLOWED, SERVED = "HAPLOOP_ALLOWED", "HAPLOOP_SERVED_PORTS"
"""Environment variables: JSON lists of what may be opened though it is not simulated, and of the TCP ports at
which something is simulated."""
NO_CARDS = "none"
"""In place of the address of NI's server: no card is simulated."""

CREATED, FOLDER = "haploop-created-bin", "haploop-folder-bin"
IGNORED, IN_CALLBACK, PROCESS = "haploop-ignored-bin", "haploop-in-callback", "haploop-process"
"""Metadata between `driver` and haploop's server: the names of new channels, the folder from which a
program names its files, properties without effect, that a callback makes the call, and which process."""
LIVES = "/haploop.Process/Lives"
"""Stream that a process opens and does not read: at its end its tasks are cleared, as by the driver."""

_KEYS = {
    "created": CREATED, "folder": FOLDER, "ignored": IGNORED, "in_callback": IN_CALLBACK, "process": PROCESS,
}  # fmt: skip


def redirect(
    utils: Any,
    options: Callable[[], Any],
    known: Callable[[Any], object] = lambda _: None,
    lives: str | None = None,
) -> Callable[[], None]:
    """Make tasks and systems without gRPC options use `options()`; return what undoes it.

    `utils` is the module in which nidaqmx chooses between the driver and a server. `known` is called with
    gRPC options of the program's own. `lives` is `LIVES` where the server is another process.
    """
    from nidaqmx._lib import lib_importer  # noqa: PLC0415

    before, encoding = utils._select_interpreter, lib_importer._encoding
    made: dict[int, Any] = {}

    def select(grpc_options: Any = None, interpreter: Any = None) -> Any:
        if grpc_options:
            known(grpc_options)
        if grpc_options or interpreter:
            return before(grpc_options, interpreter)
        own = options()
        if id(own) not in made:  # one for all tasks: to make its 451 calls takes longer than to read
            made[id(own)] = driver().DriverInterpreter(own, _KEYS, lives)
        return made[id(own)]

    def undo() -> None:
        utils._select_interpreter, lib_importer._encoding = before, encoding

    utils._select_interpreter = select
    # Who asks nidaqmx for the encoding of texts (as NI's tests do) makes it look for the driver's library.
    lib_importer._encoding = "utf-8"
    return undo


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


def options_for(channel: Any) -> Any:
    """Return nidaqmx's gRPC options for a channel."""
    from nidaqmx import GrpcSessionOptions, SessionInitializationBehavior  # noqa: PLC0415

    # As the driver: a second task of a name is refused (-200089), and not the first one again.
    new = SessionInitializationBehavior.INITIALIZE_SERVER_SESSION
    return GrpcSessionOptions(channel, "", initialization_behavior=new)


def options_of_each_process(address: str) -> Callable[[], Any]:
    """Return a function that gives nidaqmx's options for a server on this computer; a forked child, its own.

    A child has none of its parent's threads: a call on the parent's channel fails or never returns.
    """
    made: dict[int, Any] = {}

    def options() -> Any:
        import grpc  # noqa: PLC0415

        process = os.getpid()
        if process not in made:
            limits = [("grpc.max_receive_message_length", -1), ("grpc.max_send_message_length", -1)]
            # A proxy that the environment names would catch even 127.0.0.1.
            channel = grpc.insecure_channel(address, options=[*limits, ("grpc.enable_http_proxy", 0)])
            made[process] = options_for(channel)
        return made[process]

    return options


class Names:
    """What stands for each name of an instrument, and which others may be opened as they are."""

    def __init__(
        self, meant: Mapping[str, str], allowed: Collection[str], like: Callable[[str], str]
    ) -> None:
        """`like` is the same text for all ways to write a name."""
        self._like = like
        self.names = tuple(meant)
        self._meant = {like(name): other for name, other in meant.items()}
        self._as_it_is = {like(name) for name in (*allowed, *meant.values())}

    def of(self, name: str) -> str | None:
        """What is opened for a name; None for one that is not to be opened."""
        own = self._like(name)
        return self._meant.get(own, name if own in self._as_it_is else None)

    def refusal(self, name: str) -> str:
        """Why a name is not opened."""
        known = ", ".join(self.names) or "none"
        return (
            f"{name} is not opened, because it is no simulated instrument of this rig ({known}) and may be "
            f"a real one: correct the name, or run haploop twin with --allow {name}."
        )


def like_a_port(name: str) -> str:
    """The same text for all ways to write a serial port: COM3 and com3; a link and its device."""
    short = name[4:] if name.startswith("\\\\.\\") else name
    if short.upper().startswith("COM"):
        return short.upper()
    return short if "://" in short else os.path.realpath(short)


def redirect_serial(serial: Any, ports: Names) -> None:
    """Let the module `serial` open what stands for a port, a device or the URL of a socket, and no other."""
    own, by_url = serial.Serial, serial.serial_for_url

    def meant(port: Any) -> Any:
        if port is None or str(port).startswith("loop://"):
            return port
        other = ports.of(str(port))
        if other is None:
            raise serial.SerialException(ports.refusal(str(port)))
        return other

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

    opened = own.open

    def open_meant(self: Any) -> None:
        other = meant(self.port)  # pyserial's own class, which a program imported before or from its module
        if "://" not in str(other):
            own.port.fset(self, other)
        elif not hasattr(self, "_socket"):
            raise serial.SerialException(f"Open {self.port} by serial.Serial: it is a socket here.")
        opened(self)

    own.open = open_meant
    serial.Serial = Serial
    serial.serial_for_url = lambda url, *how, **more: by_url(meant(url), *how, **more)


def redirect_visa(
    highlevel: Any, resources: Mapping[str, str], allowed: Collection[str] = (), ports: Names | None = None
) -> None:
    """Let PyVISA's resource managers list and open what stands for a resource, by pyvisa-py, and no other.

    Names are compared as PyVISA itself writes them. A serial port is found as ASRL3::INSTR (COM3) too.
    """
    from pyvisa import constants, errors, rname  # noqa: PLC0415

    def like(name: str) -> str:
        try:
            return str(rname.to_canonical_name(name.upper()))
        except Exception:  # none, or with the name of a device file
            return name

    known = Names(resources, allowed, like)
    listed = [like(name) for name in resources]
    for name in ports.names if ports else ():
        digits = name.upper().removeprefix("COM")
        listed.append(f"ASRL{digits if digits.isdecimal() else name}::INSTR")

    class Refused(errors.VisaIOError):
        def __init__(self, sentence: str) -> None:
            super().__init__(constants.StatusCode.error_resource_not_found)
            self.description = sentence

        def __str__(self) -> str:
            return str(self.description)

    def meant(name: str) -> str:
        other = known.of(name)
        if other is None and ports is not None and name.upper().startswith("ASRL"):
            board = name[4:].rpartition("::")[0] if name.upper().endswith("::INSTR") else name[4:]
            device = ports.of(f"COM{board}" if board.isdecimal() else board)
            if device is not None and "://" in device:
                host, _, port = device.partition("://")[2].partition(":")
                other = f"TCPIP::{host}::{port}::SOCKET"
            elif device is not None:
                other = f"ASRL{device}::INSTR"
        if other is None:
            raise Refused(known.refusal(name))
        return other

    manager = highlevel.ResourceManager
    new, opened, bare = manager.__new__, manager.open_resource, manager.open_bare_resource
    going: set[str] = set()

    def open_resource(self: Any, resource_name: str, *how: Any, **more: Any) -> Any:
        other = meant(resource_name)
        going.add(other)
        # A socket has no end of a message of its own, as USB and VXI-11 have.
        ended = {"read_termination": "\n", "write_termination": "\n"}
        stands_in = other.upper().endswith("SOCKET") and resource_name.upper().endswith("INSTR")
        return opened(self, other, *how, **{**(ended if stands_in else {}), **more})

    def open_bare(self: Any, resource_name: str, *how: Any, **more: Any) -> Any:
        return bare(self, resource_name if resource_name in going else meant(resource_name), *how, **more)

    manager.__new__ = staticmethod(lambda cls, visa_library="": new(cls, "@py"))
    manager.list_resources = lambda self, query="?*::INSTR": rname.filter(listed, query)
    manager.open_resource, manager.open_bare_resource = open_resource, open_bare


def redirect_hosts(hosts: Mapping[str, str]) -> None:
    """Let sockets connect to what stands for a host and port ("192.0.2.20:80")."""
    ask, connect = socket.getaddrinfo, socket.socket.connect

    def meant(host: Any, port: Any) -> tuple[Any, Any]:
        name = host.decode() if isinstance(host, bytes) else host
        other = hosts.get(f"{name}:{port}".lower())
        return (other.rpartition(":")[0], int(other.rpartition(":")[2])) if other else (host, port)

    def getaddrinfo(host: Any, port: Any, *how: Any, **more: Any) -> Any:
        return ask(*meant(host, port), *how, **more)

    def connect_meant(self: Any, address: Any) -> None:
        connect(self, meant(*address) if isinstance(address, tuple) and len(address) == 2 else address)

    socket.getaddrinfo = getaddrinfo
    socket.socket.connect = connect_meant  # type: ignore[method-assign]


def refuse_sound(module: Any, allowed: Collection[str]) -> None:
    """Let `sounddevice` open no device: a sound card is an instrument, and has no wire to be simulated by."""
    if "sound" in allowed:
        return

    def refuse(*_: Any, **__: Any) -> None:
        raise module.PortAudioError(
            "No sound device is opened, because the rig's is simulated and a real one may feed an amplifier: "
            "run haploop twin with --allow sound to open it."
        )

    module._StreamBase.__init__ = refuse


def refuse_network(allowed: Collection[str], served: Collection[int]) -> None:
    """Let a program connect to this computer only: hubs and instruments of a network are real.

    On this computer, nor to a Yoctopuce hub's port, unless it is one of `served`.
    """

    def watch(event: str, told: tuple[Any, ...]) -> None:
        if event not in ("socket.connect", "socket.sendto") or not isinstance(told[1], tuple):
            return
        host, port = str(told[1][0]), told[1][1]
        own = host in ("localhost", "::1", "") or host.startswith("127.")
        if {host, f"{host}:{port}"} & set(allowed) or (own and (port != _HUB or port in served)):
            return
        raise ConnectionRefusedError(
            f"{host}:{port} is not connected to, because it may be a real instrument: run haploop twin with "
            f"--allow {host} to reach it."
        )

    sys.addaudithook(watch)


_HUB = 4444
"""Port of a Yoctopuce VirtualHub."""


def _nidaqmx(utils: Any, address: str) -> None:
    from nidaqmx.errors import DaqNotFoundError  # noqa: PLC0415

    own = options_of_each_process(address)

    def options() -> Any:
        if address == NO_CARDS:
            raise DaqNotFoundError("No NI card is opened, because this rig has no simulated one.")
        return own()

    def known(grpc_options: Any) -> None:
        if ALLOWED not in os.environ:
            return
        target = grpc_options.grpc_channel._channel.target().decode().rpartition("/")[2]
        if target not in (address, address.replace("127.0.0.1", "localhost"), *_told(ALLOWED)):
            raise DaqNotFoundError(
                f"The NI device server at {target} is not used, because it may have real cards: run haploop "
                f"twin with --allow {target}."
            )

    redirect(utils, options, known, LIVES)


def _told(variable: str) -> Any:
    return json.loads(os.environ.get(variable) or "{}")


def _ports() -> Names:
    return Names(_told(SERIAL), _told(ALLOWED), like_a_port)


_AFTER: dict[str, tuple[str, Callable[[Any, str], None]]] = {
    "nidaqmx.utils": (NI, _nidaqmx),
    "serial": (SERIAL, lambda module, _: redirect_serial(module, _ports())),
    "pyvisa.highlevel": (
        VISA,
        lambda module, _: redirect_visa(module, _told(VISA), _told(ALLOWED), _ports()),
    ),
    "sounddevice": (ALLOWED, lambda module, _: refuse_sound(module, _told(ALLOWED))),
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
    if HOSTS in os.environ:
        redirect_hosts(_told(HOSTS))
    if ALLOWED in os.environ:
        refuse_network(_told(ALLOWED), _told(SERVED))
    # The environment's own, which this file stands before.
    spec = PathFinder.find_spec("sitecustomize")
    if spec is not None and spec.loader is not None:
        spec.loader.exec_module(importlib.util.module_from_spec(spec))


if __name__ == "sitecustomize" and {NI, SERIAL, VISA, HOSTS} & os.environ.keys():
    _start()
