"""The public names of `haploop`, as a script has them: commands are clients of the package.

They are looked up when a command uses them, so that `haploop --help` loads none. `public.pyi` is what type
checkers and editors read.
"""

from __future__ import annotations

import importlib
from typing import Any

_PACKAGE = importlib.import_module("..", __package__)


def __getattr__(name: str) -> Any:
    return getattr(_PACKAGE, name)
