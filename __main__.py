"""The `haploop` command; `python -m haploop` works without the scripts folder on the path."""

from __future__ import annotations

import atexit
import gc
import os
import signal
import sys

from .base import at_once

_ALLOCATIONS = 20_000
"""New objects after which Python looks for garbage; its own default is 700."""


def main() -> None:
    """Run the command line; a stop signal before or after it exits at once, as no rig is open then."""
    before = at_once.end_at_once()
    # Matrices are small here, and threads of BLAS wait for one another: a sixth of a demo's processor time.
    for library in ("OMP", "OPENBLAS"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    # What a command loads lives until its end: looking through it for garbage again and again, and once more
    # at the exit, took a tenth of a command's processor time.
    gc.set_threshold(_ALLOCATIONS)
    atexit.register(gc.freeze)
    from .commands.cli import main as run  # noqa: PLC0415

    if signal.SIGINT in before:
        signal.signal(signal.SIGINT, before[signal.SIGINT])
    try:
        run()
    except KeyboardInterrupt:
        # A second Ctrl-C arrived while the first one was handled; the clean-up has finished.
        sys.exit(130)
    finally:
        # A Ctrl-C during interpreter shutdown would print a traceback.
        signal.signal(signal.SIGINT, signal.SIG_IGN)


if __name__ == "__main__":
    main()
