"""The `haploop` command; `python -m haploop` works without the scripts folder on the path."""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType

__all__ = ["main"]


def main() -> None:
    """Run the command line; Ctrl-C during loading or after the end exits at once, as no rig is open then."""
    before = signal.signal(signal.SIGINT, _stop)
    from haploop.cli import main as run  # noqa: PLC0415

    signal.signal(signal.SIGINT, before)
    try:
        run()
    except KeyboardInterrupt:
        # A second Ctrl-C arrived while the first one was handled; the clean-up has finished.
        sys.exit(130)
    finally:
        # A Ctrl-C during interpreter shutdown would print a traceback.
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def _stop(_number: int, _frame: FrameType | None) -> None:
    # Exit directly: an exception during an import can be swallowed, or print a traceback.
    os.write(2, b"Error: Stopped.\n")
    os._exit(130)


if __name__ == "__main__":
    main()
