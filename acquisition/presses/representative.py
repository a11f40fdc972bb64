"""The representative press of a button, as `representing` makes it and as its file holds it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

import numpy as np

from ...base import hdf5
from ...base.arrays import FloatArray
from ...base.errors import DataError
from ...base.files import check_destination, private_files
from ...base.notebook import InNotebook

_LARGEST = 1e9
"""Samples/s, N and m/s^2 that no press reaches."""
KIND = "representative"
"""Kind of its file."""


@dataclass(frozen=True, eq=False)
class Representative(InNotebook):
    """The representative press of `members` presses; arrays are (samples,).

    For example:

        >>> press = haploop.Representative.load("press.h5")
        >>> press.acceleration.shape == press.force.shape
        True
    """

    button: str
    rate_hz: float
    acceleration: FloatArray
    """m/s^2, vertical, high-passed, zero at both ends."""
    force: FloatArray | None
    """N; None where no force was measured."""
    activation: FloatArray
    """0 before the contact changed, 1 after; values between 0 and 1 where the presses differ."""
    activation_index: int
    members: int
    spread: FloatArray
    """m/s^2: standard deviation of the aligned presses' accelerations."""
    bandwidth_hz: float
    """Corner of the sensor of motion, or end of the band in which it was differentiated; content above it is
    attenuated relative to the motion of the cap."""
    sources: tuple[tuple[str, str], ...]
    """(file name, content hash) of each recording."""
    left_out: tuple[str, ...]
    """Presses that were left out, each with its reason."""
    method: str
    """Name of the method (`averaging.average`)."""
    simulated: bool
    reason: str = ""
    """Reason for the method, as a clause."""
    corrected: tuple[str, ...] = ()
    """What was wrong with recorded signals and was corrected, each with its participant."""
    scores: Mapping[str, float] = field(default_factory=dict)
    """Relative error of each method compared on held-out presses (`averaging.average`); smaller is better.
    Empty for a method that was asked for by name."""
    parameters: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Parameters: window, warps, and the segmentation of each recording (by file name)."""
    undone_hz: tuple[float, float] | None = None
    """Band (Hz) in which the accelerometer's low-pass was undone; None when it was not undone."""
    noise_gain: float = 1.0
    """Gain (rms) of undoing the low-pass for white noise up to half the sample rate."""
    travel: FloatArray | None = None
    """m of the cap; None where no displacement was measured."""
    motion: str = "acceleration"
    """What the acceleration is from: "acceleration", or "velocity" or "displacement", differentiated."""
    activated_by: str = "activation"
    """What told the activation: "activation" (the contact), "force" (its snap), the click in
    "acceleration", "velocity" or "displacement", or, of an imported press, "stated" by a file or a person."""

    def refuse_nonsense(self) -> None:
        """See `hdf5.restore`. Raises DataError for signals that no presses have."""
        slow = [one for one in (self.force, self.travel) if one is not None]
        signals = (self.acceleration, self.activation, self.spread, *slow)
        whole = all(np.ndim(one) == 1 and np.all(np.abs(one) < _LARGEST) for one in signals)
        if not whole or len({len(one) for one in signals}) != 1:
            raise DataError(f"the press's signals are not of one length with values below {_LARGEST:g}.")
        length = len(self.acceleration)
        if not 0 <= self.activation_index < length:
            raise DataError(f"the press activates at sample {self.activation_index} of {length}.")
        if not 0 < self.rate_hz < _LARGEST:
            raise DataError(f"the press has {self.rate_hz:g} samples/s.")

    def __repr__(self) -> str:
        peak = float(np.max(np.abs(self.acceleration), initial=0.0))
        return f"<Representative {self.button}: {self.members} presses, {peak:.2f} m/s² peak{self._mark}>"

    @property
    def _mark(self) -> str:
        return ", simulated" if self.simulated else ""

    @property
    def duration(self) -> float:
        """Seconds."""
        return len(self.acceleration) / self.rate_hz

    @private_files()
    def save(self, path: str | Path) -> None:
        """Write to a new HDF5 file, completely or not at all; its owner alone can read it, as the recordings.

        Raises ConfigurationError for an existing file or a bad folder, DataError for a disk that fails.
        """
        check_destination(Path(path))
        hdf5.write(path, KIND, hdf5.flatten(self))

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a file of `save`. Raises DataError for any other or a damaged file."""
        return hdf5.restore(cls, hdf5.read(path, KIND), path)
