"""A bench with the instruments beside its cards (`nidaqmx_twin.bench`), and on a tape.

`haploop twin ni --bench bench.toml -- COMMAND` runs a program on one.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.message import Message

from ..instruments.tape import Call, Failure, Recorder
from ..nidaqmx_twin import DaqmxError, Handle, NiTwin
from ..nidaqmx_twin.bench import Bench, cards
from ..nidaqmx_twin.redirect import environment
from .tabled import Instrument, Served, read_table, serving

# A bench while it runs: its cards and its instruments, served to other programs in real time.

_ROLE = "nidaqmx"
_NUMBERS = (FieldDescriptor.CPPTYPE_DOUBLE, FieldDescriptor.CPPTYPE_FLOAT)
_FAILURES = (Failure(DaqmxError, lambda error: (str(error), int(error.code))),)


def on_tape(tape: Recorder, name: str, run: Handle, reply: Any) -> Handle:
    """Return `run`, whose every call is written on a tape; calls are ordered by task.

    `reply` is the class of the answers, which `run` may give as bytes.
    """

    def taped(request: Any, alive: Callable[[], bool]) -> Any:
        task = request.task.name if hasattr(request, "task") else ""
        answers: list[Any] = []

        def make() -> Any:
            answers.append(run(request, alive))
            answer = reply.FromString(answers[0]) if isinstance(answers[0], bytes) else answers[0]
            return plain(answer)

        tape.pass_on(Call(_ROLE, name, (plain(request),), failures=_FAILURES, order=(_ROLE, task)), make)
        return answers[0]

    return taped


def plain(message: Message) -> dict[str, Any]:
    """A message's fields that are set; rows of numbers are arrays (samples,)."""
    told: dict[str, Any] = {}
    for field, value in message.ListFields():
        repeated = not isinstance(value, str | bytes | Message) and hasattr(value, "__len__")
        if field.cpp_type in _NUMBERS and repeated:
            told[field.name] = np.array(value)
        elif repeated:
            told[field.name] = [plain(one) if isinstance(one, Message) else one for one in value]
        else:
            told[field.name] = plain(value) if isinstance(value, Message) else value
    return told


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
    tables = bench.instruments if bench is not None else {}
    instruments = {name: Instrument(read_table(table)) for name, table in tables.items()}
    around = None if tape is None else partial(on_tape, tape)
    with cards(devices, bench, port=port, around=around) as twin, serving(instruments) as found:
        yield Running(twin, found)
