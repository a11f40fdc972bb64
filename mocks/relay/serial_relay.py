"""Twin and wire of a serial relay board; the driver's module describes the protocol."""

from __future__ import annotations

import math
import re
import socket
from collections.abc import Iterator
from contextlib import contextmanager

from ...instruments.relay import ChannelRelay
from ...instruments.relay.serial_relay import DIGITS, PROMPT, SerialRelay
from ..transport import Loopback, ReplyFault
from .box import BoxAdapter, Contacts, SimulatedBox, box_in

_CHANNELS = range(8)
_FIRMWARE = "00000008"
_PINS = 8
"""General purpose pins and analog inputs (estimate)."""


class SerialRelayTwin(ChannelRelay):
    """The twin of `haploop.instruments.relay.serial_relay.SerialRelay`, with the same settings."""

    def __init__(self, settings: SerialRelay.Settings, plant: Contacts) -> None:
        self.box = box_in(plant, settings.patches, range(len(DIGITS)))
        board = BoxAdapter("The relay board (twin)", self.box, math.inf)
        super().__init__(settings, plant.clock, board)


class SerialRelayWire(Loopback):
    """A board served on loopback at `url` (`socket://...`) while its context lasts."""

    def __init__(self, box: SimulatedBox, port: int = 0) -> None:
        self.faults: list[ReplyFault] = []
        self._box = box
        self._id = "00000000"
        self._outputs = 0
        """General purpose outputs that are set, as bits."""
        super().__init__(self._serve, port)
        self.url = f"socket://{self.address}"

    def _serve(self, link: socket.socket) -> None:
        pending = b""
        while more := link.recv(256):
            pending += more
            while b"\r" in pending:
                line, pending = pending.split(b"\r", 1)
                command = line.decode("ascii", "replace")
                if not self._reply(link, command):
                    return

    def _reply(self, link: socket.socket, command: str) -> bool:
        answer = self._do(command)
        echo = f"{command}\n\r"
        reply = (echo + (f"{answer}\n\r" if answer else "")).encode() + PROMPT
        fault = next((f for f in self.faults if f.fires(command)), None)
        if fault is None:
            link.sendall(reply)
            return True
        if fault.kind == "terminator":
            reply = reply.replace(PROMPT, b"\n")
        return fault.send(link, reply, self.closing)

    def _do(self, command: str) -> str:
        """Execute a command and return the answer; empty for an unknown command."""
        match command.split():
            case ["ver"]:
                return _FIRMWARE
            case ["relay", "on" | "off" | "read" as what, digit] if digit in [*DIGITS[: len(_CHANNELS)]]:
                channel = DIGITS.index(digit)
                if what == "read":
                    return "on" if self._box.states()[channel].closed else "off"
                self._box.set_state(channel, what == "on")
            case ["relay", "readall"]:
                bits = sum(state.closed << n for n, state in self._box.states().items() if n in _CHANNELS)
                return f"{bits:0{len(_CHANNELS) // 4}x}"
            case ["relay", "writeall", word] if re.fullmatch(rf"[0-9a-fA-F]{{{len(_CHANNELS) // 4}}}", word):
                for channel in _CHANNELS:
                    self._box.set_state(channel, bool(int(word, 16) >> channel & 1))
            case ["reset"]:
                for channel in _CHANNELS:
                    self._box.set_state(channel, False)
            case _:
                return self._do_other(command)
        return ""

    def _do_other(self, command: str) -> str:
        """Commands that do not touch the relays."""
        match command.split():
            case ["id", "get"]:
                return self._id
            case ["id", "set", word] if re.fullmatch(r"[0-9A-Za-z]{8}", word):
                self._id = word
            case ["gpio", "set" | "clear" | "read" as what, digit] if digit in [*DIGITS[:_PINS]]:
                bit = 1 << DIGITS.index(digit)
                if what == "read":
                    return "on" if self._outputs & bit else "off"
                self._outputs = self._outputs | bit if what == "set" else self._outputs & ~bit
            case ["adc", "read", digit] if digit in [*DIGITS[:_PINS]]:
                return "0"  # nothing is wired to its inputs
        return ""


@contextmanager
def wire(settings: SerialRelay.Settings, plant: Contacts) -> Iterator[dict[str, object]]:
    """Serve a board on a box in the plant; yield the settings that point the driver at it."""
    with SerialRelayWire(box_in(plant, settings.patches, _CHANNELS)) as board:
        yield {"port": board.url}
