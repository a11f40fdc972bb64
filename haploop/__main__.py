"""The `haploop` command, and `python -m haploop`: also where no script folder is on the path."""

from __future__ import annotations

import sys

__all__ = ["main"]


def main() -> None:
    """Run the command line. Nothing has been opened while it is still being loaded."""
    try:
        from haploop.cli import main as run  # noqa: PLC0415
    except KeyboardInterrupt:
        print("Error: Stopped.", file=sys.stderr)
        sys.exit(130)
    run()


if __name__ == "__main__":
    main()
