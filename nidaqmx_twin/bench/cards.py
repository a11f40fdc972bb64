"""The cards of a bench while they are served to other programs, in real time."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from pathlib import Path

from ...base.errors import ConfigurationError, InstrumentError
from ...base.threads import Flag
from ..server import Around
from ..twin import Failure, NiTwin
from .file import Bench, Fault


@contextmanager
def cards(
    devices: Mapping[str, str] | Path, bench: Bench | None, *, port: int = 0, around: Around | None = None
) -> Iterator[NiTwin | None]:
    """Serve `devices`, which a bench's are among, with the bench's inputs, wires and faults; None without.

    Raises ConfigurationError for what the bench cannot have, and InstrumentError for a port in use.
    """
    with ExitStack() as stack:
        twin = None
        if devices:
            try:
                twin = NiTwin(devices, time="real", port=port, around=around)
            except RuntimeError as error:
                why = str(error).rstrip(".")
                raise InstrumentError(f"The NI wire cannot listen on port {port}: {why}.") from None
            stack.callback(twin.close)
        if bench is not None:
            _set_up(twin, bench)
            if twin is not None:
                stack.enter_context(_failing(twin, bench.faults))
        yield twin


def _set_up(twin: NiTwin | None, bench: Bench) -> None:
    bench.check_devices(twin.devices if twin is not None else [])
    if twin is None:
        return
    driven: dict[str, str] = {}
    for name, signal_at in bench.inputs.items():
        with _placed(f"{bench.where(('inputs', name))}: {name}"):
            terminals = twin.inputs(name)
            _claim(driven, terminals, f"[inputs] sets {name}")
            for terminal in terminals:
                twin.set(terminal, signal_at(terminal))
    for number, wire in enumerate(bench.wires):
        with _placed(bench.where(("wires", number))):
            _claim(driven, twin.inputs(wire.input_), f"a wire goes from {wire.output} to {wire.input_}")
            twin.wire(wire.output, wire.input_, **asdict(wire.wire()))


def _claim(driven: dict[str, str], names: list[str], how: str) -> None:
    """Raise ConfigurationError where two things drive one input."""
    for name in names:
        if name in driven:
            raise ConfigurationError(f"{driven[name]}, and {how}: leave one of them out.")
        driven[name] = how


@contextmanager
def _placed(place: str) -> Iterator[None]:
    """Let an error say where it is in the file."""
    try:
        yield
    except ConfigurationError as error:
        raise ConfigurationError(f"{place}: {error}") from None


@contextmanager
def _failing(twin: NiTwin, faults: list[Fault]) -> Iterator[None]:
    """Let cards fail when their times have come; those of the start fail already."""
    steps: list[tuple[float, str, Failure | None]] = [(f.at_s, f.device, f.kind) for f in faults]
    steps += [(fault.until_s, fault.device, None) for fault in faults if fault.until_s is not None]
    due = sorted(steps, key=lambda step: step[0])
    while due and due[0][0] == 0:
        twin.fail(*due.pop(0)[1:])
    stopped = Flag()

    def wait() -> None:
        for at, device, kind in due:
            if stopped.wait(max(0.0, at - twin.now)):
                return
            twin.fail(device, kind)

    thread = threading.Thread(target=wait, name="bench faults", daemon=True)
    thread.start()
    try:
        yield
    finally:
        stopped.set()
        thread.join()
