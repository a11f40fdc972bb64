"""Twin of the PDV-100, which installs its laser head in the plant."""

from __future__ import annotations

from ...instruments.vibrometer.pdv100 import Pdv100
from ..plant import Plant
from .analog import installed


def pdv100(settings: Pdv100.Settings, plant: Plant) -> Pdv100:
    """Install a head with the rig file's settings; return the real driver, which is arithmetic only."""
    return installed(Pdv100(settings), plant)
