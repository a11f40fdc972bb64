"""Twins of both, and the thermometer's wire; their answers depend only on the plant's clock and seed."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from haploop.mocks.plant.plant import Plant
from haploop.mocks.transport import DirectLine, LineServer
from haploop_acme_thermometer.microscope import AcmeC1
from haploop_acme_thermometer.thermometer import AcmeT1


def reply(plant: Plant, line: str) -> Sequence[str]:
    answers = {"ID": "ACME T1 (twin)", "T": f"{21 + plant.clock.now() / 60:.2f}", "H": "40"}
    return [answers.get(line, "ERROR")]


def wire_humidity(settings: AcmeT1.Settings, plant: Plant) -> None:
    """Put 55 % (75 % above the output's -20 % at 0 V) on the channel that the analog output is wired to."""
    if settings.humidity:
        plant.connect(settings.humidity, lambda times: np.full(len(times), 75 / 40))


def thermometer(settings: AcmeT1.Settings, plant: Plant) -> AcmeT1:
    wire_humidity(settings, plant)
    return AcmeT1(settings, DirectLine(lambda line: reply(plant, line)))


@contextmanager
def thermometer_wire(settings: AcmeT1.Settings, plant: Plant) -> Iterator[dict[str, object]]:
    wire_humidity(settings, plant)
    with LineServer(lambda line: reply(plant, line)) as server:
        yield {"port": f"socket://{server.address}"}


def microscope(settings: AcmeC1.Settings, plant: Plant) -> AcmeC1:
    noise = plant.rng("acme microscope")
    return AcmeC1(lambda: b"P5 8 8 255\n" + noise.bytes(64))
