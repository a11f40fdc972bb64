"""Simulated NI cards for code that uses nidaqmx and knows nothing of haploop, and its clocks.

Under `with NiTwin(...)`, `nidaqmx.Task()` and `System.local()` use simulated cards, unchanged. What an input
reads is set, what an output did can be asked for, and cards can fail.
"""

from __future__ import annotations

import os
import sys
import sysconfig
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Literal, Self

from nidaqmx import GrpcSessionOptions, utils
from nidaqmx.errors import DaqNotFoundError

from ..base.arrays import FloatArray
from ..base.clock import RealClock, VirtualClock
from ..base.errors import ConfigurationError
from ..base.wording import did_you_mean
from .devices import Inventory
from .errors import DaqmxError, DAQmxErrors
from .redirect import environment, sitecustomize
from .server import Around, NiServer
from .signals import Put, Signal, Signals, Wire, signal_of
from .standalone import inventory_from_file, inventory_of

Time = Literal["virtual", "real"]
Failure = Literal["overflow", "overrun", "removed", "reserved"]

_CALL = 0.3e-3
"""Time that a look at a task's progress takes on the virtual clock (s): a bare call on loopback, measured."""
_FAILURES = {
    "overflow": DAQmxErrors.INPUT_FIFO_OVERFLOW,
    "overrun": DAQmxErrors.SAMPLES_NO_LONGER_AVAILABLE,
    "removed": DAQmxErrors.DEV_CANNOT_BE_ACCESSED,
    "reserved": DAQmxErrors.PAL_RESOURCE_RESERVED,
}
_ONCE = ("overflow", "overrun")
_CHILD = (
    "A forked child has no NI cards, because they are simulated in its parent: start the child by "
    "spawn, after os.environ.update(twin.environment()), or the whole program by python -m nidaqmx_twin."
)


class NiTwin:
    """Simulated cards, and a context manager under which nidaqmx finds them.

    `devices` names a product for each device, {"Dev1": "PCIe-6363"}, or is a text export of NI MAX. In
    virtual time, a wait for samples, and `time.sleep`, take no real time; which clocks are virtual says
    `virtual_time`. Calls of this program pass gRPC by. Others are served at `port`, or at a free one as soon
    as `address` is asked for; `around` sees every call. A forked child cannot use it. Raises
    ConfigurationError for an unknown product and in a forked child, and RuntimeError for a port in use.
    """

    def __init__(
        self,
        devices: Mapping[str, str] | str | Path,
        *,
        time: Time = "virtual",
        seed: int = 0,
        port: int = 0,
        around: Around | None = None,
    ) -> None:
        if time not in ("virtual", "real"):
            raise ConfigurationError(f'The twin\'s time is "virtual" or "real", not {time!r}.')
        listed = isinstance(devices, Mapping)
        inventory: Inventory = inventory_of(devices) if listed else inventory_from_file(Path(devices))  # type: ignore[arg-type]
        self.left_out = inventory.left_out
        """Sentences about devices of an export that are not simulated."""
        self._process = os.getpid()
        self._clock = VirtualClock() if time == "virtual" else RealClock()
        self._began = self._clock.now()
        self._signals = Signals(self._clock)
        self._serves = NiServer(
            inventory,
            self._signals,
            clock=self._clock,
            rtsi=True,
            seed=seed,
            port=port or None,
            around=around,
            call_time=_CALL if time == "virtual" else 0.0,
            handled=sitecustomize.driver().handled if time == "virtual" else None,
        )
        for name, output in self._server.outputs.items():
            output.watch()
            self._signals.drive(name, output)
        self._stack = ExitStack()

    @property
    def _server(self) -> NiServer:
        """What serves the cards; a forked child's copy may be locked for ever. Raises ConfigurationError."""
        if os.getpid() != self._process:
            raise ConfigurationError(_CHILD)
        return self._serves

    @property
    def address(self) -> str:
        """Address of the server, for programs that give nidaqmx gRPC options."""
        return self._server.address

    @property
    def devices(self) -> list[str]:
        """Names of the devices, with a chassis that was added to its modules."""
        return self._server.devices

    @property
    def port(self) -> int:
        """TCP port of the server."""
        return self._server.port

    @property
    def unserved(self) -> Mapping[str, int]:
        """How often programs asked for each call or property that is not served."""
        return self._server.unserved

    @property
    def now(self) -> float:
        """Time since the twin was made (s), on its clock."""
        return self._clock.now() - self._began

    def set(
        self,
        terminal: str,
        value: float | Sequence[float] | FloatArray | Signal | str | Path,
        *,
        rate_hz: float | None = None,
        repeat: bool = False,
    ) -> None:
        """Let an input read `value` from now on: a number, samples at `rate_hz`, a function of time, a file.

        `terminal` is "Dev1/ai0" or "Dev1/ai0:3" (V), or "Dev1/port0/line0" (0 and 1). A function takes times
        (samples,) in s since the twin was made and returns values (samples,). Samples begin now; the last is
        held unless they `repeat`. A file is a .npy, a .csv of one number in a line, or a .wav (its full scale
        is 1 V). Raises ConfigurationError.
        """
        signal = signal_of(value, rate_hz, repeat, self.now)
        self._connect(terminal, lambda times: signal(times - self._began))

    def wire(self, output: str, terminal: str, **wire: Any) -> None:
        """Connect an output to an input.

        In its way can be a `gain`, an `offset` (V), a `delay` (s), a low-pass (`low_pass_hz`) and `noise`
        (V rms). Raises ConfigurationError.
        """
        output = self._known_output(output)
        self._connect(terminal, None)
        self._signals.wire(output, terminal, Wire(**wire))

    def put(self, output: str) -> Put:
        """Return what "Dev1/ao0" (V), "Dev1/port0/line0", "Dev1/ctr0" or "Dev1/PFI12" (0 and 1) has put out.

        Raises ConfigurationError for an unknown output.
        """
        self._server.notice()
        tail = output.partition("/")[2].lower()
        if tail.startswith(("ctr", "_ctr", "pfi")):
            try:
                times, levels = self._server.pulses(output)
            except DaqmxError as error:
                raise ConfigurationError(str(error).partition("\n")[0]) from None
            return Put(times - self._began, levels)
        put = self._signals.put(self._known_output(output))
        return Put(put.times - self._began, put.values)

    def fail(self, device: str, how: Failure | None) -> None:
        """Let a device fail; None mends it.

        "overflow" and "overrun" end the next read (-200010, -200279), once. "removed" refuses every use
        (-201003), and "reserved" is another program's task on it (-50103). Raises ConfigurationError.
        """
        if how is not None and how not in _FAILURES:
            raise ConfigurationError(f"A card fails by {', '.join(_FAILURES)}, not by {how!r}.")
        try:
            if how in _ONCE:
                self._server.inject(device, _FAILURES[how])
            else:
                self._server.fail(device, None if how is None else _FAILURES[how])
        except DaqmxError as error:
            raise ConfigurationError(str(error)) from None

    def sleep(self, duration: float) -> None:
        """Let `duration` (s) pass on the twin's clock; a virtual one stops at each event of the program."""
        if isinstance(self._clock, VirtualClock):
            self._server.advance(self._clock.now() + max(0.0, duration), sitecustomize.driver().in_callback())
        else:
            self._clock.sleep(duration)

    def environment(self) -> dict[str, str]:
        """Return the environment for another program, whose nidaqmx will find these cards."""
        return environment(ni=self.address)

    def close(self) -> None:
        """Stop serving; nidaqmx is as it was before. In a forked child, the twin is its parent's."""
        if os.getpid() != self._process:
            return
        self._stack.close()
        self._serves.close()

    def __enter__(self) -> Self:
        own = sitecustomize.options_for(self._server.direct())

        def options() -> GrpcSessionOptions:
            if os.getpid() != self._process:
                raise DaqNotFoundError(_CHILD)
            return own

        self._stack.callback(sitecustomize.redirect(utils, options))
        if isinstance(self._clock, VirtualClock):
            self._stack.enter_context(virtual_time(self.sleep, lambda: self.now))
            driver = sitecustomize.driver()
            driver.settle = self._server.settle
            self._stack.callback(setattr, driver, "settle", None)
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def inputs(self, terminal: str) -> list[str]:
        """Return the names of the inputs that `terminal` lists ("Dev1/ai0:3"). Raises ConfigurationError."""
        try:
            return self._server.inputs(terminal)
        except DaqmxError as error:
            raise ConfigurationError(str(error).partition("\n")[0]) from None

    def _connect(self, terminal: str, signal: Signal | None) -> None:
        self.inputs(terminal)
        if signal is not None:
            self._signals.set(terminal, signal)
        self._server.connect(terminal, terminal)

    def _known_output(self, output: str) -> str:
        """Return the name of an output as it is, whatever its case."""
        names = {name.lower(): name for name in self._server.outputs}
        found = names.get(output.strip().lstrip("/").lower())
        if found is None:
            hint = did_you_mean(output, self._server.outputs, "there are")
            raise ConfigurationError(f"There is no output {output!r}; {hint}")
        return found


# The clocks of a program under test, in virtual time.
#
# Virtual: `time.sleep`, `time.time`, `time.monotonic` and `time.perf_counter` with their `_ns` forms, called
# by these names (`import time`) in the program, its packages and its tests. Real: a function that was
# imported by name (`from time import sleep`), the same functions called in the standard library (threading,
# queue, asyncio), in pytest, gRPC, this package and nidaqmx, in a forked child, and `datetime.now`. No
# virtual clock moves by itself: a wait moves it, a look at a task's progress by 0.3 ms, a look at the clock
# by 10 us. So the number of samples between two lines of a program does not depend on how busy the machine
# is.

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
