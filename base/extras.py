"""Packages of optional extras, loaded where they are needed."""

from __future__ import annotations

import importlib
from typing import Any

from .errors import ConfigurationError


def optional(module: str, extra: str, user: str) -> Any:
    """Import `module` for `user`, the subject of the error's sentence.

    Raises ConfigurationError, which names the package and the extra to install.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        raise ConfigurationError(
            f'{user} needs {package}, which does not load ({error}): pip install "haploop[{extra}]".'
        ) from None
