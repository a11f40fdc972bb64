"""The twins of vibrometers: each puts its laser head into the plant."""

from __future__ import annotations

from haploop.instruments.vibrometer.pdv100 import Pdv100
from haploop.mocks.plant import LaserHead, Plant

__all__ = ["pdv100"]


def pdv100(settings: Pdv100.Settings, plant: Plant) -> Pdv100:
    """The twin of a PDV-100: a head set as the rig file says. Its driver is arithmetic, and real."""
    driver = Pdv100(settings)
    head = LaserHead(driver.range, driver.scale, driver.bandwidth_hz, driver.delay)
    plant.install(driver.channel, head)
    return driver
