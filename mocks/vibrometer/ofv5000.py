"""The OFV-5000's twin and wire: a controller whose range really scales the laser's output."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from haploop.instruments.clock import Clock
from haploop.instruments.vibrometer.ofv5000 import Ofv5000
from haploop.instruments.vibrometer.ofv5000_codec import LEVEL_FULL, Command, scale_of, scale_text
from haploop.mocks.plant import LaserHead, Plant
from haploop.mocks.transport import DirectLine, LineServer

__all__ = ["Controller", "twin", "wire"]

RANGES = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
"""m/s per V (estimate; `5mm/s/V` was found)."""
_BANDWIDTH_HZ = 20e3
_DELAY = 12.3e-6
"""Seconds (estimate; its form is as found)."""
_SEARCH = 3.0
"""Seconds that a search for the focus takes (estimate)."""


class Controller:
    """What the controller does with a line, and what that does to the head in the plant.

    What a real one says to a command that it does not know was not found; this one answers a
    question `Not Available` and passes over the rest.
    """

    def __init__(self, head: LaserHead, decoder: str, full_scale: float, clock: Clock) -> None:
        self.head = head
        self.echo = False
        self.level = 0.8
        """Share of the light that comes back, and what the head then has while it is in focus."""
        self.focusable = True
        self._decoder = decoder
        self._full_scale = full_scale
        self._clock = clock
        self._found_at = 0.0
        head.level = self.level

    def answer(self, line: str) -> Sequence[str]:
        """The lines that come back: the echo when it is on, and an answer to a question."""
        command = Command.parse(line)
        reply = self._reply(command) if command else None
        return [line] * self.echo + ([] if reply is None else [reply])

    def _reply(self, command: Command) -> str | None:
        if command.verb == "Set":
            self._set(command.device, command.attribute, command.value or "")
            return None
        return self._questions().get(str(command), "Not Available")

    def _questions(self) -> dict[str, str]:
        searching = not self.focusable or self._clock.now() < self._found_at
        return {
            "GetDevInfo,Controller,0,Name": "OFV-5000 Vibrometer Controller",
            "GetDevInfo,SensorHead,0,Focus": "0,3300",
            f"Get,{self._decoder},Range": scale_text(self.head.scale),
            f"Get,{self._decoder},SignalDelay": f"{self.head.delay * 1e6:.4g} us",
            f"Get,{self._decoder},MaxFreq": f"{self.head.bandwidth_hz / 1e3:g} kHz",
            "Get,SignalLevel,0,Value": str(round(self.head.level * LEVEL_FULL)),
            "Get,SensorHead,0,AutoFocusResult": "Searching" if searching else "Found",
            "Get,Interface,0,Echo": "On" if self.echo else "Off",
        }

    def _set(self, device: str, attribute: str, value: str) -> None:
        match device, attribute:
            case (self._decoder, "Range"):
                known = {scale_text(r): scale_of(scale_text(r)) for r in RANGES}
                if value in known:
                    self.head.scale = known[value]
                    self.head.range = known[value] * self._full_scale
            case "Interface,0", "Echo" if value in ("On", "Off"):
                self.echo = value == "On"
            case "SensorHead,0", "AutoFocus" if value == "Search":
                self._found_at = self._clock.now() + _SEARCH
                self.head.level = self.level if self.focusable else 0.0


def controller_in(plant: Plant, settings: Ofv5000.Settings) -> Controller:
    """A controller set as the rig file says, its head installed in the plant."""
    scale = settings.scale
    bandwidth = settings.bandwidth_hz or _BANDWIDTH_HZ
    head = LaserHead(scale * settings.full_scale, scale, bandwidth, _DELAY)
    plant.install(settings.channel, head)
    return Controller(head, settings.decoder, settings.full_scale, plant.clock)


def twin(settings: Ofv5000.Settings, plant: Plant) -> Ofv5000:
    """The real driver's class, talking to a controller by calls."""
    return Ofv5000(settings, plant.clock, DirectLine(controller_in(plant, settings).answer))


@contextmanager
def wire(settings: Ofv5000.Settings, plant: Plant) -> Iterator[dict[str, object]]:
    """Serve a controller; gives the settings that point the driver at it."""
    with LineServer(controller_in(plant, settings).answer) as server:
        yield {"port": f"socket://{server.address}"}
