"""Twin of the PDV-100, which installs its laser head in the plant."""

from __future__ import annotations

from ...instruments.vibrometer.pdv100 import Pdv100
from ..plant import LaserHead, Plant

__all__ = ["pdv100"]


def pdv100(settings: Pdv100.Settings, plant: Plant) -> Pdv100:
    """Install a head with the rig file's settings; return the real driver, which is arithmetic only."""
    driver = Pdv100(settings)
    head = LaserHead(driver.range, driver.scale, driver.bandwidth_hz, driver.delay)
    plant.install(driver.channel, head)
    return driver
