"""Redirection of other programs' instrument libraries to simulated devices."""

from __future__ import annotations

import json
import os
from collections.abc import Collection, Mapping
from pathlib import Path

from . import sitecustomize
from .sitecustomize import CREATED, FOLDER, IGNORED, IN_CALLBACK

__all__ = ["CREATED", "FOLDER", "IGNORED", "IN_CALLBACK", "environment", "sitecustomize"]


def environment(
    ni: str | None = None,
    serial: Mapping[str, str] | None = None,
    visa: Mapping[str, str] | None = None,
    allowed: Collection[str] | None = None,
    served: Collection[int] = (),
) -> dict[str, str]:
    """The environment for a program whose libraries are to find simulated devices.

    `ni` is the address of a device server; `serial` and `visa` map names of ports and resources. With
    `allowed`, nothing else is opened but what it names: no other port, resource, sound device or address of a
    network; `served` are the TCP ports of what is simulated.
    """
    folder = str(Path(sitecustomize.__file__).parent)
    others = [folder, *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))]
    told = {sitecustomize.NI: ni or (sitecustomize.NO_CARDS if allowed is not None else None)}
    only = allowed is not None
    told |= {sitecustomize.SERIAL: json.dumps(dict(serial or {})) if serial or only else None}
    told |= {sitecustomize.VISA: json.dumps(dict(visa or {})) if visa or only else None}
    told |= {sitecustomize.ALLOWED: json.dumps(list(allowed or ())) if only else None}
    told |= {sitecustomize.SERVED: json.dumps(list(served)) if only else None}
    return {
        **os.environ,
        **{name: value for name, value in told.items() if value},
        "PYTHONPATH": os.pathsep.join(others),
    }
