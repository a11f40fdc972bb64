"""Twins of the vibrometers: each installs its head in the plant; the OFV-5000 has a controller and a wire."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TypeVar

from ..base.clock import Clock
from ..base.errors import ConfigurationError
from ..instruments.vibrometer.analog import AnalogVibrometer
from ..instruments.vibrometer.ofv5000 import LEVEL_FULL, Command, Ofv5000, scale_of, scale_text
from ..instruments.vibrometer.pdv100 import Pdv100
from .plant import LaserHead, Plant
from .transport import DirectLine, LineServer

Driver = TypeVar("Driver", bound=AnalogVibrometer)


def analog_vibrometer(settings: AnalogVibrometer.Settings, plant: Plant) -> AnalogVibrometer:
    """Install a head with the rig file's settings; return the real driver, which is arithmetic only."""
    return installed(AnalogVibrometer(settings), plant)


def installed(driver: Driver, plant: Plant) -> Driver:
    """Install the head of a driver, and return it."""
    head = LaserHead(
        driver.range,
        driver.scale,
        driver.bandwidth_hz,
        driver.delay,
        quantity=driver.quantity,
        high_pass_hz=driver.high_pass_hz,
        zero=driver.zero,
        mass=driver.mass,
    )
    plant.install(driver.channel, head)
    return driver


def pdv100(settings: Pdv100.Settings, plant: Plant) -> Pdv100:
    """Install a head with the rig file's settings; return the real driver, which is arithmetic only."""
    return installed(Pdv100(settings), plant)


DECODERS = {
    "VeloDec,0": ("VD-08", (0.0002, 0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05)),
    "VeloDec,1": ("VD-09", (0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)),
}
"""Name of each decoder, and its ranges (m/s per V; estimate, only the names and `5mm/s/V` were found)."""
_FIRMWARE = "2.05"
"""Version of controller and decoders (estimate)."""
_BANDWIDTH_HZ = 20e3
"""Bandwidth when the rig file gives none (estimate; docs/hardware.md, "OFV-5000")."""
_DELAY = 12.3e-6
"""Signal delay (s; estimate, only its format was found; docs/hardware.md, "OFV-5000")."""
_SEARCH = 3.0
"""Duration of an autofocus search (s; estimate)."""


class Controller:
    """Simulated controller, which answers lines and sets the head in the plant.

    The real answer to an unknown command was not found; this controller answers an unknown query with
    `Not Available` and ignores other unknown commands.
    """

    def __init__(self, head: LaserHead, decoder: str, full_scale: float, clock: Clock) -> None:
        self.head = head
        self.echo = False
        self.level = 0.8
        """Fraction of the light that returns while the head is in focus."""
        self.focusable = True
        self._decoder = decoder
        self._full_scale = full_scale
        self._clock = clock
        self._found_at = 0.0
        head.level = self.level

    def answer(self, line: str) -> Sequence[str]:
        """Return the lines of the reply: the echo when it is on, and the answer to a query."""
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
        names = {
            "Controller,0": "OFV-5000 Vibrometer Controller",
            "SensorHead,0": "OFV-505",
            **{device: name for device, (name, _) in DECODERS.items()},
        }
        return {
            **{
                f"{verb},{device},Name": name
                for device, name in names.items()
                for verb in ("GetDevInfo", "Get")
            },
            **{f"{verb},{device},Version": _FIRMWARE for device in names for verb in ("GetDevInfo", "Get")},
            **{
                f"GetDevInfo,{device},Range": ",".join(map(scale_text, scales))
                for device, (_, scales) in DECODERS.items()
            },
            "GetDevInfo,SensorHead,0,Focus": "0,3300",
            "GetDevInfo,Interface,0,Echo": "On,Off",
            "Get,Interface,0,Name": "RS-232",
            "Get,Controller,0,Remote": "Remote",
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
                scales = DECODERS.get(self._decoder, DECODERS["VeloDec,0"])[1]
                known = {scale_text(r): scale_of(scale_text(r)) for r in scales}
                if value in known:
                    self.head.scale = known[value]
                    self.head.range = known[value] * self._full_scale
            case "Interface,0", "Echo" if value in ("On", "Off"):
                self.echo = value == "On"
            case "SensorHead,0", "AutoFocus" if value == "Search":
                self._found_at = self._clock.now() + _SEARCH
                self.head.level = self.level if self.focusable else 0.0


def controller_in(plant: Plant, settings: Ofv5000.Settings) -> Controller:
    """Create a controller with the rig file's settings, and install its head in the plant."""
    scale = settings.scale
    has = DECODERS.get(settings.decoder, DECODERS["VeloDec,0"])[1]
    if not any(math.isclose(scale, other, rel_tol=1e-6) for other in has):
        raise ConfigurationError(
            f"No simulated {settings.decoder} of an OFV-5000 is set to {scale_text(scale)}: it has "
            f"{', '.join(map(scale_text, has))}. Correct 'scale' or 'decoder' in [vibrometer]."
        )
    bandwidth = settings.bandwidth_hz or _BANDWIDTH_HZ
    head = LaserHead(scale * settings.full_scale, scale, bandwidth, _DELAY)
    plant.install(settings.channel, head)
    return Controller(head, settings.decoder, settings.full_scale, plant.clock)


def twin(settings: Ofv5000.Settings, plant: Plant) -> Ofv5000:
    """Create the twin: the real driver's class, connected to a controller by calls."""
    return Ofv5000(settings, plant.clock, DirectLine(controller_in(plant, settings).answer))


@contextmanager
def wire(settings: Ofv5000.Settings, plant: Plant) -> Iterator[dict[str, object]]:
    """Serve a controller; yield the settings that point the driver at it."""
    with LineServer(controller_in(plant, settings).answer) as server:
        yield {"port": f"socket://{server.address}"}
