"""Read a damaged file in a process of its own: a library may crash on it, hang or exhaust the memory."""

from __future__ import annotations

import subprocess
import sys
from contextlib import suppress
from pathlib import Path

if sys.platform == "linux":
    import resource

_PATIENCE = 60.0
"""Seconds for a file, and as many again for each `pace` bytes."""
_SPARE = 200 << 20
"""Bytes of memory beside what the file needs."""


def answer_of(module: str, *paths: Path, pace: int) -> bytes:
    """What `_in_child()` of a module writes to standard output, with these paths as its arguments.

    It has a minute, and as long again for each `pace` bytes of the first file. The answer is empty or cut off
    when it crashes or takes longer. Raises OSError where no process can be started.
    """
    patience = _PATIENCE * (1 + paths[0].stat().st_size / pace)
    code = f"import importlib; importlib.import_module({module!r})._in_child()"
    command = [sys.executable, "-c", code, *(str(path.absolute()) for path in paths)]
    with suppress(subprocess.TimeoutExpired):
        return subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, timeout=patience, check=False
        ).stdout
    return b""


def allow_memory(count: int) -> None:
    """Limit this process to what it has, `count` bytes and some to spare; nothing on Windows and macOS."""
    if sys.platform == "linux":
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        limit = pages * resource.getpagesize() + count + _SPARE
        resource.setrlimit(resource.RLIMIT_AS, (limit, resource.getrlimit(resource.RLIMIT_AS)[1]))
