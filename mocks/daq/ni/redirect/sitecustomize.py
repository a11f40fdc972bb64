"""Points nidaqmx at a simulated NI system, in a program that knows nothing of it.

`haploop twin ni -- python script.py` puts this folder first on the program's PYTHONPATH: Python imports
`sitecustomize` at its start. nidaqmx itself is imported by the program only. It needs no haploop.
"""

from __future__ import annotations

import importlib.util
import os
import sys
from collections.abc import Callable
from importlib.machinery import ModuleSpec, PathFinder
from typing import Any

ADDRESS = "HAPLOOP_NI_TWIN"
"""Environment variable with the address of the server."""
_UTILS = "nidaqmx.utils"
"""Module in which nidaqmx chooses between the driver and a server."""


def redirect(utils: Any, options: Callable[[], Any]) -> Callable[[], None]:
    """Make tasks and systems without gRPC options use `options()`; return what undoes it."""
    before = utils._select_interpreter

    def select(grpc_options: Any = None, interpreter: Any = None) -> Any:
        return before(grpc_options or (None if interpreter else options()), interpreter)

    utils._select_interpreter = select
    return lambda: setattr(utils, "_select_interpreter", before)


def options_for(address: str) -> Any:
    """Return nidaqmx's gRPC options for a server on this computer."""
    import grpc  # noqa: PLC0415
    from nidaqmx import GrpcSessionOptions  # noqa: PLC0415

    limits = [("grpc.max_receive_message_length", -1), ("grpc.max_send_message_length", -1)]
    # A proxy that the environment names would catch even 127.0.0.1.
    channel = grpc.insecure_channel(address, options=[*limits, ("grpc.enable_http_proxy", 0)])
    return GrpcSessionOptions(channel, "")


class _Redirects:
    """Finder of imports that lets `nidaqmx.utils` load as it is, and then redirects it."""

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        if name != _UTILS:
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(name)
        if spec is not None and spec.loader is not None:
            load = spec.loader.exec_module
            made: list[Any] = []

            def options() -> Any:
                if not made:
                    made.append(options_for(os.environ[ADDRESS]))
                return made[0]

            def exec_module(module: Any) -> None:
                load(module)
                redirect(module, options)

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


if __name__ == "sitecustomize" and ADDRESS in os.environ:
    _start()
