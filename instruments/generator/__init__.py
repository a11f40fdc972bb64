"""Function generators: the role, and its drivers."""

from ..waveforms import Arbitrary, Burst, Sweep, Waveform
from .role import Generator

__all__ = ["Arbitrary", "Burst", "Generator", "Sweep", "Waveform"]
