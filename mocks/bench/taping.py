"""The calls that reach a server, on a tape: what a program asked of its cards, and what it was answered."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.message import Message

from ...instruments.tape import Call, Failure, Recorder
from ..daq.ni import DaqmxError, Handle

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
