"""A bench in a file: cards, what their inputs read, wires and failures; and how it is served in real time."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from ..base.errors import ConfigurationError, InstrumentError
from ..base.threads import Flag
from ..base.validation import key_lines, parse_toml, place, read_text, validate
from ..base.wording import did_you_mean
from .bench_inputs import Number, Positive, input_of
from .server import Around
from .signals import Signal, Wire
from .twin import Failure, NiTwin

Location = tuple[str | int, ...]
Place = Callable[[Location], str]
"""The file and line of a key."""

_NotNegative = Annotated[Number, Field(ge=0)]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)


class WireTable(_Table):
    """See `signals.Wire`."""

    output: Annotated[str, Field(alias="from")]
    input_: Annotated[str, Field(alias="to")]
    gain: Number = 1.0
    offset: Number = 0.0
    delay_s: _NotNegative = 0.0
    low_pass_hz: Positive | None = None
    noise: _NotNegative = 0.0

    def wire(self) -> Wire:
        """What is in the way from the output to the input."""
        return Wire(self.gain, self.offset, self.delay_s, self.low_pass_hz, self.noise)


class Fault(_Table):
    """A card that fails `at_s` after the start: once in a read, or from then on `until_s`."""

    device: str
    kind: Literal["overflow", "overrun", "removed", "reserved"]
    at_s: _NotNegative = 0.0
    until_s: Positive | None = None

    @model_validator(mode="after")
    def _order(self) -> Fault:
        if self.until_s is not None and self.kind in ("overflow", "overrun"):
            raise ValueError(f"an {self.kind} ends one read: leave out until_s")
        if self.until_s is not None and self.until_s <= self.at_s:
            raise ValueError(f"until_s ({self.until_s:g}) comes after at_s ({self.at_s:g})")
        return self


class _File(_Table):
    devices: dict[str, str] = {}
    inputs: dict[str, Any] = {}
    wires: list[WireTable] = []
    faults: list[Fault] = []
    instruments: dict[str, str] = {}


class Bench:
    """What a bench file says, checked as far as the file alone allows."""

    def __init__(self, said: _File, where: Place, folder: Path) -> None:
        self.devices: Mapping[str, str] = said.devices
        """Product of each device."""
        self.inputs: Mapping[str, Callable[[str], Signal]] = {
            name: input_of(told, folder, where(("inputs", name)) + f": inputs.{name}")
            for name, told in said.inputs.items()
        }
        self.wires = said.wires
        self.faults = said.faults
        self.instruments: Mapping[str, Path] = {
            name: folder / table for name, table in said.instruments.items()
        }
        """File of the table that describes what stands for each port, resource and address."""
        self.where = where

    def check_devices(self, names: list[str]) -> None:
        """Raise ConfigurationError for a terminal or a fault of a device that is not among `names`."""
        asked: list[tuple[Location, str]] = [
            (("inputs", name), name.partition("/")[0]) for name in self.inputs
        ]
        for number, wire in enumerate(self.wires):
            asked += [
                (("wires", number, "from"), wire.output.partition("/")[0]),
                (("wires", number, "to"), wire.input_.partition("/")[0]),
            ]
        asked += [(("faults", number, "device"), fault.device) for number, fault in enumerate(self.faults)]
        known = [name.lower() for name in names]
        for key, device in asked:
            if device.lower() not in known:
                hint = did_you_mean(device, names, "there are")
                raise ConfigurationError(
                    f"{self.where(key)}: there is no device {device!r} on this bench; {hint}"
                )


def read_bench(path: Path) -> Bench:
    """Read a bench file. Raises ConfigurationError, which names the file, the line and the key."""
    text = read_text(path, f"There is no bench file {path}.")
    raw = parse_toml(text, path)
    where = partial(place, ((str(path), key_lines(text)),))
    return Bench(validate(_File, raw, where), where, path.absolute().parent)


# Which cards are asked for: by options, by an export of NI MAX, by a bench.


def devices_of(named: Sequence[str], export: Path | None, bench: Bench | None) -> Mapping[str, str] | Path:
    """Return the product of each device that `named` ("Dev1=PCIe-6363") and a bench name, or the export.

    Raises ConfigurationError for what names no product, for a device that is named twice, and where an export
    and others name devices.
    """
    pairs = [name.partition("=")[::2] for name in named]
    if not all(name and product for name, product in pairs):
        raise ConfigurationError("--device takes NAME=PRODUCT: --device Dev1=PCIe-6363.")
    names = [*(name for name, _ in pairs), *(bench.devices if bench is not None else ())]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise ConfigurationError(f"{twice} is in --device or in the bench twice: name each device once.")
    if export is not None and names:
        raise ConfigurationError(
            "--devices names all devices: leave out --device, and [devices] of the bench."
        )
    return export or {**(bench.devices if bench is not None else {}), **dict(pairs)}


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
