"""The amplifier role: its limits, and the conversion of volts at the patch to volts at its input."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Collection, Mapping
from copy import deepcopy
from types import MappingProxyType

import numpy as np

from ...base.arrays import FloatArray
from ...base.errors import ConfigurationError
from ..limits import Limits


class Amplifier(ABC):
    """A voltage amplifier between a DAQ output and the relay. Safe state: zero volts at its input.

    It has one channel for all patches, or one for each: then several drives can play at once.
    """

    identity: str
    input: str
    """Name of the output that feeds it: the DAQ's, a player's or a generator's. Empty with `inputs`."""
    inputs: Mapping[str, str] = MappingProxyType({})
    """Names of the DAQ's outputs that feed it, by patch, when it has a channel for each patch."""

    own_gain: float | None = None
    """The product's own gain (V per V), where it has one that the rig file can contradict."""

    def sharing(self, patches: Collection[str]) -> int:
        """Largest number of these patches that one channel drives, in parallel."""
        channels = Counter(self.inputs.get(patch, self.input) for patch in frozenset(patches))
        return max(channels.values(), default=0)

    @abstractmethod
    def limits(self, patches: int) -> Limits:
        """Limits of its output into `patches` patches in parallel."""

    @abstractmethod
    def to_input(self, drive: FloatArray) -> FloatArray:
        """Convert `drive`, (samples,) V at the patch, to volts at its input: in proportion."""


_PROBES = np.array([-100.0, -1.0, 0.0, 1.0, 400.0])
"""Volts at the patch at which a gain is read."""


class ReadOnce(Amplifier):
    """The figures of an amplifier as they are now: plays rest on these, whatever is written to it later."""

    def __init__(self, amplifier: Amplifier, patches: int) -> None:
        """`patches` is the largest number of them that are ever connected.

        Raises ConfigurationError for a driver whose volts at the input are not in proportion to the patch's.
        """
        self.identity, self.input = amplifier.identity, amplifier.input
        self.inputs = dict(amplifier.inputs)
        self._limits = tuple(deepcopy(amplifier.limits(count)) for count in range(patches + 1))
        at_input = np.array(amplifier.to_input(_PROBES.copy()))
        share = float(at_input[-1]) / float(_PROBES[-1])
        if not share or not np.allclose(at_input, share * _PROBES, rtol=1e-6, atol=0.0):
            raise ConfigurationError(
                f"The amplifier {self.identity!r} is no plain gain: its driver makes {at_input.tolist()} V "
                f"at its input of {_PROBES.tolist()} V at the patch, and nothing is played through it."
            )
        self._gain = 1 / share

    def limits(self, patches: int) -> Limits:
        """See `Amplifier.limits`; the relay refuses more patches than there are."""
        return self._limits[min(patches, len(self._limits) - 1)]

    def to_input(self, drive: FloatArray) -> FloatArray:
        """See `Amplifier.to_input`."""
        return drive / self._gain
