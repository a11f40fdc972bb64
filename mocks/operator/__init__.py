"""The simulated person at the rig."""

from .twin import OperatorTwin

__all__ = ["OperatorTwin"]
