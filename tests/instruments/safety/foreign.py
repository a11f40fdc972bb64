"""What another program does on the same cards, on a rig's twin and through its wire."""

from collections.abc import Iterator
from contextlib import contextmanager

import grpc
import nidaqmx
import numpy as np
from nidaqmx import GrpcSessionOptions

from haploop.base.errors import InstrumentError
from haploop.instruments import Rig
from haploop.nidaqmx_twin.nodes import Run
from tests.raising import raising


def leave(rig: Rig, output: str, volts: float) -> None:
    """Another program writes volts to an output, and ends."""
    if rig.mode == "twin":
        # Its own way to the plant: it asks nobody of ours.
        now = rig.clock.now()
        rig.simulation.plant.advance(now)
        rig.daq._outputs[output].play(Run(now, np.inf, np.array([volts])))
        return
    with _foreign_task(rig, output) as task:
        task.write(volts, auto_start=True)


@contextmanager
def held(rig: Rig, output: str, volts: float) -> Iterator[None]:
    """Another program puts volts out, and keeps the output reserved."""
    if rig.mode == "twin":
        leave(rig, output, volts)
        zero = rig.daq.zero
        rig.daq.zero = raising(
            InstrumentError("Dev2 is in use by another program or task (-50103): close it.")
        )
        yield
        rig.daq.zero = zero
        return
    with _foreign_task(rig, output) as task:
        task.write(volts, auto_start=True)
        task.start()
        yield


@contextmanager
def _foreign_task(rig: Rig, output: str) -> Iterator[nidaqmx.Task]:
    settings = rig.daq._settings
    with grpc.insecure_channel(settings.server) as channel:
        name = f"somebody's {output}"
        with nidaqmx.Task(name, grpc_options=GrpcSessionOptions(channel, name)) as task:
            task.ao_channels.add_ao_voltage_chan(settings.outputs[output].terminal)
            yield task
