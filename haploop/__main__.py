"""The `haploop` command, and `python -m haploop`: also where no script folder is on the path."""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType

__all__ = ["main"]


def main() -> None:
    """Run the command line. Nothing has been opened while it is still being loaded, nor once it has ended."""
    before = signal.signal(signal.SIGINT, _stop)
    from haploop.cli import main as run  # noqa: PLC0415

    signal.signal(signal.SIGINT, before)
    try:
        run()
    except KeyboardInterrupt:
        # It came while the one before was being dealt with, and all is done.
        sys.exit(130)
    finally:
        # Whoever is impatient now would see a traceback of Python's own leaving.
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def _stop(_number: int, _frame: FrameType | None) -> None:
    # At once: an exception in the middle of an import can be swallowed, or come with a traceback.
    os.write(2, b"Error: Stopped.\n")
    os._exit(130)


if __name__ == "__main__":
    main()
