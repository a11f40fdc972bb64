"""Tests of the promises of each role, for a driver's author to run.

Subclass the role's class in a test module, and give it one fixture, an open driver:

    class TestAcme(RelayConformance):
        @pytest.fixture
        def relay(self) -> Iterator[Relay]:
            ...

Further capabilities of a rig (a second connection, a view of the contacts, a fault) are named in
`capabilities` and `faults`; a test that needs a missing one is skipped, with the reason.
docs/how-to/adding-an-instrument.md has a complete example. Only tests import this package: it needs pytest.
"""

from .amplifier import AmplifierConformance
from .camera import CameraConformance
from .daq import DaqConformance
from .generator import GeneratorConformance
from .operator import OperatorConformance
from .player import PlayerConformance
from .relay import RelayConformance
from .suite import Conformance, Fired, bypass_interlock
from .vibrometer import VibrometerConformance

__all__ = [
    "AmplifierConformance",
    "CameraConformance",
    "Conformance",
    "DaqConformance",
    "Fired",
    "GeneratorConformance",
    "OperatorConformance",
    "PlayerConformance",
    "RelayConformance",
    "VibrometerConformance",
    "bypass_interlock",
]
