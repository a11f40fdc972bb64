"""The clocks of a program under test, in virtual time.

Virtual: `time.sleep`, `time.time`, `time.monotonic` and `time.perf_counter` with their `_ns` forms, called by
these names (`import time`) in the program, its packages and its tests. Real: a function that was imported by
name (`from time import sleep`), the same functions called in the standard library (threading, queue,
asyncio), in pytest, gRPC, this package and nidaqmx, in a forked child, and `datetime.now`. No virtual clock
moves by itself: a wait moves it, a look at a task's progress by 0.3 ms, a look at the clock by 10 us.
So the number of samples between two lines of a program does not depend on how busy the machine is.
"""

from __future__ import annotations

import os
import sys
import sysconfig
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

_LOOK = 10e-6
"""Time that a look at a clock takes (s), so that a program that waits by looking comes to an end."""
_REAL = (
    __name__.partition(".")[0],
    "nidaqmx", "grpc", "google", "pytest", "_pytest", "pluggy", "xdist", "coverage",
)  # fmt: skip
"""Packages that see real time, besides the standard library."""


@contextmanager
def virtual_time(sleep: Callable[[float], None], now: Callable[[], float]) -> Iterator[None]:
    """Let the program's clocks be those of a twin: `sleep` lets time pass, `now` is the time passed (s)."""
    process = os.getpid()
    before = {name: getattr(time, name) for name in ("sleep", *_CLOCKS)}
    began = {name: before[name]() for name in _CLOCKS}

    def real(module: dict[str, Any]) -> bool:
        return os.getpid() != process or _sees_real_time(module)

    def nap(duration: float) -> None:
        (before["sleep"] if real(sys._getframe(1).f_globals) else sleep)(duration)

    def clock(name: str) -> Callable[[], Any]:
        per_second = 1e9 if name.endswith("_ns") else None

        def look() -> Any:
            if real(sys._getframe(1).f_globals):
                return before[name]()
            sleep(_LOOK)
            return began[name] + (now() if per_second is None else round(now() * per_second))

        return look

    try:
        time.sleep = nap  # type: ignore[assignment]  # a number is all that a twin knows
        for name in _CLOCKS:
            setattr(time, name, clock(name))
        yield
    finally:
        for name, function in before.items():
            setattr(time, name, function)


_CLOCKS = ("time", "monotonic", "perf_counter", "time_ns", "monotonic_ns", "perf_counter_ns")
_STDLIB = sysconfig.get_path("stdlib")


def _sees_real_time(module: dict[str, Any]) -> bool:
    """True for a module of the standard library, and of packages that must not wait for a twin."""
    name, file = str(module.get("__name__", "")), str(module.get("__file__", ""))
    in_library = file.startswith(_STDLIB) and "-packages" not in file
    return in_library or name.partition(".")[0] in _REAL
