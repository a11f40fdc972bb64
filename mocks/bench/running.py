"""A bench while it runs: served to other programs, in real time."""

from __future__ import annotations

import threading
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

from ...base.errors import ConfigurationError, InstrumentError
from ...base.flag import Flag
from ...instruments.tape import Recorder
from ..daq.ni import Failure, NiTwin
from ..redirect import environment
from ..tabled import Served, serving
from .file import Bench, Fault
from .taping import on_tape


@dataclass(frozen=True)
class Running:
    """What runs, as long as the context lasts."""

    twin: NiTwin | None
    """The cards, if the bench has any."""
    tabled: Served

    def environment(self, allowed: Collection[str] = ()) -> dict[str, str]:
        """The environment of a program that finds what runs in place of its instruments.

        On a bench with instruments, no other port, resource or address is opened but what is `allowed`.
        """
        found, twin = self.tabled, self.twin
        if not found.wires:
            return environment(ni=twin.address if twin else None)
        served = [*found.ports, *([twin.port] if twin else [])]
        return environment(
            twin.address if twin else None, found.serial, found.visa, allowed, served, found.hosts
        )


@contextmanager
def running(
    devices: Mapping[str, str] | Path, bench: Bench | None, *, port: int = 0, tape: Recorder | None = None
) -> Iterator[Running]:
    """Serve `devices`, which a bench's are among, with the bench's inputs, wires, faults and instruments.

    Raises ConfigurationError for what the bench cannot have, and InstrumentError for a port in use.
    """
    with ExitStack() as stack:
        twin = None
        if devices:
            try:
                twin = NiTwin(
                    devices, time="real", port=port, around=None if tape is None else partial(on_tape, tape)
                )
            except RuntimeError as error:
                raise InstrumentError(f"The NI wire cannot listen on port {port}: {error}.") from None
            stack.callback(twin.close)
        if bench is not None:
            _set_up(twin, bench)
            if twin is not None:
                stack.enter_context(_failing(twin, bench.faults))
        found = stack.enter_context(serving(bench.instruments if bench is not None else {}))
        yield Running(twin, found)


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
