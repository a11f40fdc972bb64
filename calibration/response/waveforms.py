"""What a calibration was computed from: the waveforms of every play, as measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from haploop.acquisition import hdf5
from haploop.instruments import Capture

__all__ = ["Waveforms"]


@dataclass(frozen=True, eq=False)
class Waveforms:
    """Volts at the converter of every play of a calibration, in order: run-downs, then excitations.

    Samples are stored in single precision, whose steps are finer than those of a 24-bit converter. A play
    through a player is resampled to the clock of its drive (`Rig.excite`).
    """

    captures: tuple[Capture, ...]
    calibration: str
    """Content hash of the calibration that was computed from them (`Calibration.digest`)."""
    patch: str
    point: str
    simulated: bool

    @classmethod
    def of(
        cls, captures: Sequence[Capture], calibration: str, patch: str, point: str, simulated: bool
    ) -> Waveforms:
        """Reduce captures to single precision."""
        single = (replace(one, volts=one.volts.astype(np.float32)) for one in captures)
        return cls(tuple(single), calibration, patch, point, simulated)

    @property
    def seconds(self) -> float:
        """Time measured (s)."""
        return float(sum(capture.volts.shape[1] / capture.rate_hz for capture in self.captures))

    def save(self, path: str | Path) -> None:
        """Write to a new HDF5 file, whole or not at all. Raises DataError if it exists."""
        hdf5.write(path, "waveforms", hdf5.flatten(self))

    @classmethod
    def load(cls, path: str | Path) -> Waveforms:
        """Read what `save` wrote. Raises DataError, one sentence, for anything else."""
        return hdf5.restore(cls, hdf5.read(path, "waveforms"), path)
