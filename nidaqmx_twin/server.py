"""Simulated NI-DAQmx device server: NI's gRPC service for the real `nidaqmx` package.

`nidaqmx.Task(grpc_options=nidaqmx.GrpcSessionOptions(channel, ""))` and
`nidaqmx.system.System.remote(...)` work with it as with NI's own server.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, NoReturn

import grpc
import numpy as np
from google.protobuf import message_factory
from nidaqmx._stubs import nidaqmx_pb2 as pb

from ..base.arrays import FloatArray
from ..base.clock import Clock, RealClock
from ..base.threads import Closing, Flag
from . import attributes
from .calls import CALLS
from .devices import Inventory, NiDevice
from .errors import AlreadyExistsError, DaqmxError, DAQmxErrors
from .events import Events
from .nodes import Nodes
from .properties import ignored
from .redirect import CREATED, FOLDER, IGNORED, IN_CALLBACK, LIVES, PROCESS
from .storage import saved_in_export
from .system import NiSystem
from .terminals import OutputTerminal
from .threads import HOST, DirectChannel, Listener

Corrupt = Callable[[str, bytes], bytes]
"""Function from a call's name and reply to the bytes that are sent instead."""

Handle = Callable[[Any, Callable[[], bool]], Any]
"""What handles a call: its request, and a function that is False once the client has gone; it returns the
answer, or its bytes."""
Around = Callable[[str, Handle, Any], Handle]
"""Function from a call's name, what handles it and the class of its answers, to what handles it instead."""

_FIRST_SERIAL = 0x1000000
"""Seven hexadecimal digits, as of a card (estimate)."""
_SERVICE = pb.DESCRIPTOR.services_by_name["NiDAQmx"]
_SESSION_FILE = pb.CreateTaskResponse.DESCRIPTOR.fields_by_name["task"].message_type.file
_SESSIONS = _SESSION_FILE.services_by_name["SessionUtilities"]


class NiServer(Closing):
    """The server, and a context manager that stops it.

    It serves `devices`; `wiring` connects their terminals ("Dev2/ai4", "Dev2/ao0") to nodes of the plant
    `nodes`. An unwired analog input shows a sine within its range, an unwired digital input counts. Cards
    share a clock only with a declared RTSI cable (`rtsi`). It listens at `port`, a free one where that is 0;
    with None not before `address` or `port` is asked for. On a virtual clock a blocking read advances time
    until its samples exist; events fire when a wait advances time, and `handled` counts, by task and kind,
    those whose callbacks have returned. There a call that looks whether there is something new takes
    `call_time` (s), so that a program that polls comes to an end; other calls take no time. `around` sees
    each call.
    """

    def __init__(
        self,
        devices: Inventory | Iterable[NiDevice],
        nodes: Nodes | None = None,
        wiring: Mapping[str, str] | None = None,
        *,
        clock: Clock | None = None,
        port: int | None = 0,
        rtsi: bool = False,
        seed: int = 0,
        call_time: float = 0.0,
        handled: Callable[[str, str], int | None] | None = None,
        around: Around | None = None,
    ) -> None:
        self._listener = None if port is None else Listener(port)
        inventory = devices if isinstance(devices, Inventory) else Inventory.of(devices)
        # Other ones on another port, and the same again for a server that is started there again.
        inventory = inventory.numbered(_FIRST_SERIAL + ((self._listener.port if self._listener else 0) << 8))
        clock = clock or (nodes.clock if nodes is not None else RealClock())
        self._system = NiSystem(inventory, clock, nodes, wiring or {}, rtsi, seed)
        self._system.saved_tasks, self._system.saved_channels = saved_in_export(inventory.export, inventory)
        self._system.call_time = call_time
        self._events = Events(self._system, handled)
        if handled is not None:
            self._system.move = self._events.move
        self._service = _Service(self._system, self._events, around)
        if self._listener is not None:
            self._listener.start(self._service)

    @property
    def port(self) -> int:
        """TCP port at which it listens, from now on."""
        if self._listener is None:
            self._listener = Listener(0)
            self._listener.start(self._service)
        return self._listener.port

    @property
    def address(self) -> str:
        """Address at which it listens, from now on."""
        return f"{HOST}:{self.port}"

    @property
    def devices(self) -> list[str]:
        """Names of the devices."""
        return list(self._system.inventory.devices)

    @property
    def unserved(self) -> Counter[str]:
        """Counts of the calls and properties that clients requested and this wire does not serve."""
        return self._system.unserved

    def inject(self, device: str, code: DAQmxErrors) -> None:
        """Make the next read on `device` fail with `code`."""
        with self._system.lock:
            self._system.failures.inject(device, code)

    def fail(self, device: str, code: DAQmxErrors | None) -> None:
        """Make every use of `device` fail with `code` from now on; None ends that."""
        with self._system.lock:
            self._system.failures.fail(device, code)

    def connect(self, terminal: str, node: str) -> None:
        """Connect what `inputs` finds to a node of `nodes` from now on."""
        with self._system.lock:
            for name in self.inputs(terminal):
                self._system.wiring[name] = node

    def inputs(self, terminal: str) -> list[str]:
        """Return the names of an input, or of a list, a range or a port of them ("Dev1/ai0:3").

        Raises DaqmxError for an unknown terminal, and for one that is no input.
        """
        inventory = self._system.inventory
        device, _, tail = terminal.lstrip("/").partition("/")
        if tail.upper().startswith("PFI"):
            return [inventory.terminal(inventory.device(device), f"/{device}/{tail}").lstrip("/")]
        found: list[str] = []
        for card, name in inventory.resolve(terminal):
            if f"{card.name}/{name}" in (*card.ao, *card.counters):
                raise DaqmxError(
                    DAQmxErrors.INVALID_PHYS_CHAN_TYPE,
                    f"{card.name}/{name} is no input: name one, such as {card.name}/ai0 or {card.name}/PFI0.",
                )
            lines = [line for line in card.lines if line.startswith(f"{card.name}/{name}/")]
            found += lines or [f"{card.name}/{name}"]
        return found

    @property
    def outputs(self) -> Mapping[str, OutputTerminal]:
        """Every analog output and digital line, by name."""
        return self._system.outputs

    def pulses(self, name: str) -> tuple[FloatArray, FloatArray]:
        """Return what a counter has put out: times (changes,) s, and the levels after each, 0 and 1.

        `name` is a counter, "Dev1/ctr0", or a terminal to which it puts out, "Dev1/PFI12". Raises DaqmxError
        for any other.
        """
        device, _, tail = name.partition("/")
        with self._system.lock:
            card = self._system.inventory.device(device)
            number = re.fullmatch(r"_?ctr(\d+)", tail, re.IGNORECASE)
            if number is None or f"{card.name}/{tail.lower()}" not in card.counters:
                terminal = self._system.inventory.terminal(card, f"/{name}")
            else:
                terminal = card.full(f"Ctr{number[1]}InternalOutput")
            found = self._system.terminals.pulses(terminal, self._system.clock.now())
        return found.times, found.levels.astype(np.float64)

    def advance(self, until: float, in_callback: bool = False) -> None:
        """Move a virtual clock to `until` (s), from event to event, and let programs handle each."""
        self._events.advance(until, in_callback)

    def notice(self) -> None:
        """Let what time has brought be done."""
        with self._system.lock:
            self._system.notice()

    def settle(self) -> None:
        """Wait until programs have handled the events that have happened."""
        with self._system.lock:
            self._events.settle()

    def clear(self) -> None:
        """Clear all tasks, as the end of their programs does."""
        with self._system.lock:
            self._events.clear_tasks()

    def direct(self) -> DirectChannel:
        """A channel for this process, whose calls pass gRPC by."""
        return DirectChannel(self._service.service)

    def corrupt(self, how: Corrupt) -> None:
        """Replace every reply from now on by `how(call, reply)`, which may be any bytes."""
        self._service.corrupt = how

    def output(self, terminal: str) -> float:
        """Return the present value of an output terminal: V, or 0 or 1 for a digital line."""
        return float(self._system.outputs[terminal].at(np.array([self._system.clock.now()]))[0])

    def close(self) -> None:
        """Stop serving. Tasks are cleared; outputs keep their values. May be called again."""
        with self._system.lock:
            for task in list(self._system.tasks.values()):
                self._system.clear_task(task)
        self._events.close()
        self._service.close()
        if self._listener is not None:
            self._listener.close()


class _Service(grpc.GenericRpcHandler):  # type: ignore[misc]
    """Handler of all calls, selected by name: most of NI's 451 calls need nothing else."""

    def __init__(self, system: NiSystem, events: Events, around: Around | None) -> None:
        self.corrupt: Corrupt = lambda _call, reply: reply
        self._around = around
        self._system = system
        self._events = events
        self._lives: list[Flag] = []

    def close(self) -> None:
        """Wait for the end of no process any more."""
        for gone in list(self._lives):
            gone.set()

    def service(self, details: Any) -> Any:
        _, service, name = details.method.split("/")
        if service == _SERVICE.full_name and name in _SERVICE.methods_by_name:
            return self._daqmx(name)
        if details.method == LIVES:
            return grpc.unary_stream_rpc_method_handler(self._live)
        if service == _SESSIONS.full_name and name in _SESSIONS.methods_by_name:
            return self._unary(_SESSIONS.methods_by_name[name], self._session(name))
        return None

    def _daqmx(self, name: str) -> Any:
        method = _SERVICE.methods_by_name[name]
        if name.startswith("Register"):
            return grpc.unary_stream_rpc_method_handler(
                lambda request, context: self._stream(name, request, context),
                request_deserializer=message_factory.GetMessageClass(method.input_type).FromString,
                response_serializer=lambda reply: reply.SerializeToString(),
            )
        reply = message_factory.GetMessageClass(method.output_type)
        attribute = attributes.ATTRIBUTE_CALL.fullmatch(name)

        def run(request: Any, alive: Callable[[], bool]) -> Any:
            if attribute is not None:
                answer = reply()
                attributes.serve(self._system, attribute, request, answer)
                return answer
            if name.startswith("Unregister"):
                self._events.unregister(name, request)
                return reply()
            if name == "ClearTask":
                self._events.forget(self._system.task(request.task.name))
            elif hasattr(request, "task") and name != "StopTask":
                self._system.failures.refuse(self._system.tasks.get(request.task.name))
            answer = CALLS[name](self._system, request, alive)
            return reply() if answer is None else answer

        served = attribute is not None or name in CALLS or name.startswith("Unregister")
        if not served:
            return self._unary(method, self._refuse(name))
        seen = run if self._around is None else self._around(name, run, reply)
        return self._unary(method, self._guarded(seen))

    def _unary(self, method: Any, handle: Callable[[Any, Any], Any]) -> Any:
        def serialized(reply: Any) -> bytes:
            return self.corrupt(method.name, reply if isinstance(reply, bytes) else reply.SerializeToString())

        return grpc.unary_unary_rpc_method_handler(
            handle,
            request_deserializer=message_factory.GetMessageClass(method.input_type).FromString,
            response_serializer=serialized,
        )

    def _guarded(self, run: Callable[[Any, Callable[[], bool]], Any]) -> Callable[[Any, Any], Any]:
        def handle(request: Any, context: Any) -> Any:
            try:
                with self._system.lock:
                    self._system.notice()
                    self._system.created = ""
                    sent = {entry.key: entry.value for entry in context.invocation_metadata() or ()}
                    self._system.caller.in_callback = IN_CALLBACK in sent
                    self._system.caller.process = sent.get(PROCESS, "")
                    if FOLDER in sent and request.task.name in self._system.tasks:
                        self._system.tasks[request.task.name].folder = os.fsdecode(sent[FOLDER])
                    answer = run(request, context.is_active)
                    told = {CREATED: self._system.created, IGNORED: _ignored(self._system, request)}
                    if any(told.values()):
                        context.set_trailing_metadata(tuple((k, v.encode()) for k, v in told.items() if v))
                    return answer
            except AlreadyExistsError as error:
                context.abort(grpc.StatusCode.ALREADY_EXISTS, str(error))
            except DaqmxError as error:
                _abort(context, error)

        return handle

    def _refuse(self, name: str) -> Callable[[Any, Any], Any]:
        def handle(request: Any, context: Any) -> Any:
            with self._system.lock:
                self._system.unserved[name] += 1
            context.abort(grpc.StatusCode.UNIMPLEMENTED, f"The twin does not serve {name}.")

        return handle

    def _stream(self, name: str, request: Any, context: Any) -> Iterator[Any]:
        try:
            with self._system.lock:
                listener = self._events.register(name, request)
        except DaqmxError as error:
            _abort(context, error)
        if not context.add_callback(lambda: self._events.end(listener)):
            self._events.end(listener)
        # The client waits for the initial metadata; without it, it hangs (measured).
        context.send_initial_metadata(())
        return self._events.stream(listener)

    def _live(self, process: bytes, context: Any) -> Iterator[bytes]:
        """Wait until a process ends, however it does, and clear its tasks, as the driver does."""
        gone = Flag()
        try:
            if context.add_callback(gone.set):
                # The process makes no task before it has this.
                context.send_initial_metadata(())
                self._lives.append(gone)
                while not gone.wait(3600.0):
                    pass
                self._lives.remove(gone)
        finally:
            with self._system.lock:
                self._events.clear_tasks(process.decode())
        yield from ()

    def _session(self, name: str) -> Callable[[Any, Any], Any]:
        method = _SESSIONS.methods_by_name[name]
        reply = message_factory.GetMessageClass(method.output_type)

        def run(request: Any, alive: Callable[[], bool]) -> Any:
            answer = reply()
            if name == "ResetServer":
                self._events.clear_tasks()
                answer.is_server_reset = True
            elif name == "EnumerateDevices":
                for device in self._system.inventory.devices.values():
                    entry = answer.devices.add()
                    entry.name, entry.model, entry.vendor = device.name, device.product.name, "haploop"
                    entry.serial_number = f"{device.serial or 0:X}"
            return answer

        if name in ("ResetServer", "EnumerateDevices"):
            return self._guarded(run)
        return self._refuse(name)


def _ignored(system: NiSystem, request: Any) -> str:
    """Names of the properties without effect of the task that a request has started; empty for any other."""
    task = system.tasks.get(request.task.name) if hasattr(request, "task") else None
    if task is None or task.told == task.starts:
        return ""
    task.told = task.starts
    return ", ".join(ignored(task))


def _abort(context: Any, error: DaqmxError) -> NoReturn:
    metadata = [("ni-error", str(error.code))]
    if error.read is not None:
        metadata.append(("ni-samps-per-chan-read", str(error.read)))
    if error.written is not None:
        metadata.append(("ni-samps-per-chan-written", str(error.written)))
    context.set_trailing_metadata(tuple(metadata))
    context.abort(grpc.StatusCode.UNKNOWN, str(error))
    raise AssertionError("an abort raises")
