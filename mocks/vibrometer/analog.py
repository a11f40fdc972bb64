"""Twins of pick-ups with an analog output, and of the PDV-100: each installs its head in the plant."""

from __future__ import annotations

from typing import TypeVar

from ...instruments.vibrometer.analog import AnalogVibrometer
from ...instruments.vibrometer.pdv100 import Pdv100
from ..plant import LaserHead, Plant

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


# Twin of the PDV-100, which installs its laser head in the plant.


def pdv100(settings: Pdv100.Settings, plant: Plant) -> Pdv100:
    """Install a head with the rig file's settings; return the real driver, which is arithmetic only."""
    return installed(Pdv100(settings), plant)
