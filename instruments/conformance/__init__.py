"""What every implementation of a role must do, as tests that a driver's author runs.

Subclass the role's class in a test module, and give it one fixture, an open driver:

    class TestAcme(RelayConformance):
        @pytest.fixture
        def relay(self) -> Iterator[Relay]:
            ...

What a rig can offer beyond that (a second connection, a look at the contacts, a fault) is named
in `capabilities` and `faults`; a test that needs more than is offered is skipped and says so.
docs/adding-an-instrument.md shows it whole. Only tests import this package: it needs pytest.
"""

from instruments.conformance.amplifier import AmplifierConformance
from instruments.conformance.daq import DaqConformance
from instruments.conformance.generator import GeneratorConformance
from instruments.conformance.operator import OperatorConformance
from instruments.conformance.relay import RelayConformance
from instruments.conformance.suite import Conformance, Fired, bypass_interlock
from instruments.conformance.vibrometer import VibrometerConformance

__all__ = [
    "AmplifierConformance",
    "Conformance",
    "DaqConformance",
    "Fired",
    "GeneratorConformance",
    "OperatorConformance",
    "RelayConformance",
    "VibrometerConformance",
    "bypass_interlock",
]
