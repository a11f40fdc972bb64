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

from haploop.instruments.conformance.amplifier import AmplifierConformance
from haploop.instruments.conformance.daq import DaqConformance
from haploop.instruments.conformance.generator import GeneratorConformance
from haploop.instruments.conformance.operator import OperatorConformance
from haploop.instruments.conformance.player import PlayerConformance
from haploop.instruments.conformance.relay import RelayConformance
from haploop.instruments.conformance.suite import Conformance, Fired, bypass_interlock
from haploop.instruments.conformance.vibrometer import VibrometerConformance

__all__ = [
    "AmplifierConformance",
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
