"""A lab whose hardware is simulated in virtual time, but opened as hardware: with locks, lockouts, duty."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from importlib import metadata
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from haploop.base.clock import RealClock
from haploop.instruments import Rig, RigFile, load_rig_file
from haploop.instruments.daq.ni_daqmx import NiDaq
from haploop.instruments.generator.scpi_generator import ScpiGenerator
from haploop.instruments.relay.yocto import Yocto
from haploop.instruments.rig import opening
from haploop.instruments.safety import machine
from haploop.mocks.daq.twin import DaqTwin
from haploop.mocks.relay.box import BoxAdapter, RelayTwin
from haploop.mocks.simulation import Simulation
from haploop.nidaqmx_twin.nodes import Run

FOUR_CHANNELS = """
[daq.channels]
drive_b = { terminal = "Dev2/ai6", range = 1, config = "rse" }
drive_c = { terminal = "Dev2/ai7", range = 1, config = "rse" }
drive_d = { terminal = "Dev2/ai16", range = 1, config = "rse" }
[daq.outputs]
amplifier_b = { terminal = "Dev2/ao1", range = 10 }
amplifier_c = { terminal = "Dev2/ao2", range = 10 }
amplifier_d = { terminal = "Dev2/ao3", range = 10 }
[amplifier]
input = { A = "amplifier", B = "amplifier_b", C = "amplifier_c", D = "amplifier_d" }
[sensors.drive]
channels = ["drive", "drive_b", "drive_c", "drive_d"]
ratio = 100
"""


def serve(file: RigFile, dead_man: float) -> tuple[Simulation, dict[str, Any]]:
    """A plant in real time, with its card and relay served, and where."""
    world = Simulation(file, RealClock())
    at = world.serve("ni-daqmx", NiDaq.Settings.model_validate(file.daq.settings))
    relay = Yocto.Settings.model_validate(file.relay.settings | {"dead_man": dead_man})
    return world, at | world.serve("yocto-maxicoupler", relay)


class Lab:
    """One plant behind every rig that is opened, now and later; `left` cards keep what they put out."""

    def __init__(self, file: RigFile, place: Path) -> None:
        self.place = place
        self.world = Simulation(file)
        self.plant, self.clock, self.truth = self.world.plant, self.world.clock, self.world.truth
        self._kept: dict[str, Any] = {}

    def instrument(self, role: str, device: Any, driver: Any) -> Any:
        """Open an instrument; cards, boxes and generators outlast the rig."""
        if role not in self._kept:
            made = self.world.instrument(role, device, driver, "twin")
            if role in ("daq", "relay", "generator"):
                self._kept[role] = made
            return made
        if role == "daq":
            return self.daq
        if role == "generator":
            return type(self.generator)(self.generator._settings, self.clock, self.generator._line)
        settings = driver.Settings.model_validate(device.settings)
        relay = RelayTwin.__new__(RelayTwin)
        relay.box = self._kept[role].box
        board = BoxAdapter("Yocto-MaxiCoupler (twin)", relay.box, settings.dead_man)
        super(RelayTwin, relay).__init__(settings, self.clock, board)
        return relay

    def leave(self, output: str, volts: float) -> None:
        """Another program writes volts to an output, and ends."""
        now = self.clock.now()
        self.plant.advance(now)
        self.daq._outputs[output].play(Run(now, np.inf, np.array([volts])))

    @staticmethod
    def forget(rig: Rig) -> None:
        """The rig's program is killed: its locks are gone, and nothing of it is closed."""
        rig._stack.pop_all()
        gc.collect()  # from Python 3.13 on, the locks are in a cycle
        rig._signals.close()
        for piece in rig.hardware:
            machine._held.discard(piece)
            machine._reserved.discard(piece)

    @property
    def daq(self) -> DaqTwin:
        """The cards, as any program finds them."""
        daq: DaqTwin = self._kept["daq"]
        return daq

    @property
    def generator(self) -> ScpiGenerator:
        """The generator, as any program finds it."""
        generator: ScpiGenerator = self._kept["generator"]
        return generator


@contextmanager
def lab(folder: Path, file: RigFile | str = "haptable") -> Iterator[Lab]:
    """Rigs are opened by `open_rig`, as if their hardware were there; `folder` is this computer's place."""
    here = Lab(load_rig_file(file) if isinstance(file, str) else file, folder)
    drivers = opening._drivers

    def simulated(rig: RigFile) -> Iterator[Any]:
        for role, device, driver in drivers(rig):
            stand_in = SimpleNamespace(Settings=driver.Settings, __module__="haploop.tests")
            stand_in.hardware = getattr(driver, "hardware", lambda _settings: ())
            stand_in.open = lambda _s, _c, r=role, v=device, d=driver: here.instrument(r, v, d)
            yield role, device, stand_in

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(opening, "_drivers", simulated)
        # Looked up anew at each opening, which is most of its time.
        patch.setattr(metadata, "version", cache(metadata.version))
        patch.setattr(opening, "RealClock", lambda: here.clock)
        patch.setattr("haploop.instruments.safety.machine._place", lambda: folder)
        yield here
    here.world.close()
