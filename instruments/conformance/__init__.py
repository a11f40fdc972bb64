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

from .amplifier import AmplifierConformance as AmplifierConformance
from .camera import CameraConformance as CameraConformance
from .daq import DaqConformance as DaqConformance
from .generator import GeneratorConformance as GeneratorConformance
from .operator import OperatorConformance as OperatorConformance
from .player import PlayerConformance as PlayerConformance
from .relay import RelayConformance as RelayConformance
from .suite import Conformance as Conformance
from .suite import Fired as Fired
from .suite import bypass_interlock as bypass_interlock
from .vibrometer import VibrometerConformance as VibrometerConformance
