"""End the command at once at a stop signal, from its first import until it runs: no rig is open by then.

An exception during an import can be swallowed, or print a traceback and exit with 1: "out of tolerance". What
this module imports itself is loaded by then, or loads at once.
"""

from __future__ import annotations

import os
import signal
import sys

TYPE_CHECKING = False  # of `typing`, which takes its time
if TYPE_CHECKING:
    from collections.abc import Mapping
    from types import FrameType
    from typing import Any

_before: dict[int, Any] = {}


def end_at_once() -> Mapping[int, Any]:
    """Handle stop signals from now on; return the handlers before. May be called again."""
    if not _before:
        for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK"):
            kind = getattr(signal, name, None)
            # Whoever started the command may have it ignore some: `nohup`, a job in the background.
            if kind is not None and signal.getsignal(kind) != signal.SIG_IGN:
                _before[kind] = signal.signal(kind, _stop)
    return _before


def _stop(number: int, _frame: FrameType | None) -> None:
    os.write(2, b"Error: Stopped.\n")
    os._exit(128 + number)


def is_the_command() -> bool:
    """True in the process of `haploop`, or of `python -m haploop`; False in a user's own program."""
    called = sys.argv[0] if getattr(sys, "argv", None) else ""
    if called == "-m":  # while Python looks for the module
        return "haploop" in sys.orig_argv[sys.orig_argv.index("-m") + 1 :][:1]
    return os.path.basename(called) in ("haploop", "haploop.exe", "haploop-script.py")  # noqa: PTH119
