"""The simulated person at the rig."""

from haploop.mocks.operator.twin import OperatorTwin

__all__ = ["OperatorTwin"]
