"""Redirection of other programs' instrument libraries to simulated devices."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path

from . import sitecustomize
from .sitecustomize import CREATED, FOLDER, IGNORED, IN_CALLBACK

__all__ = ["CREATED", "FOLDER", "IGNORED", "IN_CALLBACK", "environment", "sitecustomize"]


def environment(
    ni: str | None = None,
    serial: Mapping[str, str] | None = None,
    visa: Mapping[str, str] | None = None,
) -> dict[str, str]:
    """The environment for a program whose libraries are to find simulated devices.

    `ni` is the address of a device server; `serial` and `visa` map names of ports and resources.
    """
    folder = str(Path(sitecustomize.__file__).parent)
    others = [folder, *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))]
    told = {sitecustomize.NI: ni}
    told |= {sitecustomize.SERIAL: json.dumps(dict(serial)) if serial else None}
    told |= {sitecustomize.VISA: json.dumps(dict(visa)) if visa else None}
    return {
        **os.environ,
        **{name: value for name, value in told.items() if value},
        "PYTHONPATH": os.pathsep.join(others),
    }
