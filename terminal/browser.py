"""Show a page to the person who runs a command."""

from __future__ import annotations

import os
import sys
import webbrowser
from pathlib import Path


def open_page(page: Path) -> bool:
    """Open a page in the person's browser; False where nobody watches, or there is no screen.

    Nobody watches when standard output is no terminal, or in continuous integration (CI is set).
    """
    if not sys.stdout.isatty() or os.environ.get("CI"):
        return False
    # Without a screen a text browser would take the terminal over.
    screen = sys.platform in ("win32", "darwin") or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))
    return screen and webbrowser.open(page.resolve().as_uri())
