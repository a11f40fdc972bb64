"""Redirection of other programs' instrument libraries to simulated devices."""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from . import sitecustomize
from .sitecustomize import CREATED, FOLDER, IGNORED, IN_CALLBACK, LIVES, PROCESS

__all__ = [
    "CREATED", "FOLDER", "IGNORED", "IN_CALLBACK", "LIVES", "PROCESS",
    "environment", "redirected", "sitecustomize",
]  # fmt: skip


def environment(
    ni: str | None = None,
    serial: Mapping[str, str] | None = None,
    visa: Mapping[str, str] | None = None,
    allowed: Collection[str] | None = None,
    served: Collection[int] = (),
    hosts: Mapping[str, str] | None = None,
) -> dict[str, str]:
    """The environment for a program whose libraries are to find simulated devices.

    `ni` is the address of a device server; `serial`, `visa` and `hosts` map names of ports, resources and
    addresses ("host:port"). With `allowed`, nothing else is opened but what it names: no other port,
    resource, sound device or address of a network; `served` are the TCP ports of what is simulated.
    """
    folder = str(Path(sitecustomize.__file__).parent)
    others = [folder, *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))]
    told = {sitecustomize.NI: ni or (sitecustomize.NO_CARDS if allowed is not None else None)}
    only = allowed is not None
    told |= {sitecustomize.SERIAL: json.dumps(dict(serial or {})) if serial or only else None}
    told |= {sitecustomize.VISA: json.dumps(dict(visa or {})) if visa or only else None}
    told |= {sitecustomize.HOSTS: json.dumps(dict(hosts)) if hosts else None}
    told |= {sitecustomize.ALLOWED: json.dumps(list(allowed or ())) if only else None}
    told |= {sitecustomize.SERVED: json.dumps(list(served)) if only else None}
    return {
        **os.environ,
        **{name: value for name, value in told.items() if value},
        "PYTHONPATH": os.pathsep.join(others),
    }


@contextmanager
def redirected(
    serial: Mapping[str, str], visa: Mapping[str, str], hosts: Mapping[str, str]
) -> Iterator[None]:
    """Let this program's pyserial, PyVISA and sockets find what stands for each name, and open nothing else.

    Other addresses of a network are reached as before.
    """
    import serial as pyserial  # noqa: PLC0415
    from pyvisa import highlevel  # noqa: PLC0415

    ports = sitecustomize.Names(serial, (), sitecustomize.like_a_port)
    with ExitStack() as stack:
        for owner, name in (
            (pyserial.Serial, "open"),
            (pyserial, "Serial"),
            (pyserial, "serial_for_url"),
            *((highlevel.ResourceManager, name) for name in _OF_VISA),
            (socket, "getaddrinfo"),
            (socket.socket, "connect"),
        ):
            stack.callback(_as_before(owner, name))
        sitecustomize.redirect_serial(pyserial, ports)
        sitecustomize.redirect_visa(highlevel, visa, (), ports)
        sitecustomize.redirect_hosts(hosts)
        yield


_OF_VISA = ("__new__", "list_resources", "open_resource", "open_bare_resource")


def _as_before(owner: Any, name: str) -> Callable[[], None]:
    """Return what sets an attribute as it is now, also where a class has inherited it."""
    if name in vars(owner):
        return partial(setattr, owner, name, vars(owner)[name])
    return partial(delattr, owner, name)
