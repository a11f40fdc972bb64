"""What a calibration was computed from: the waveforms of every play, as measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...base import hdf5
from ...instruments import Capture, Rig
from ...instruments.vibrometer import Quantity

_BESIDE = "-waveforms"
"""How the name of a calibration's file goes on for its waveforms."""


@dataclass(frozen=True, eq=False)
class Waveforms:
    """Volts at the converter of every play of a calibration, in order: run-downs, then excitations.

    Samples are stored in single precision, whose steps are finer than those of a 24-bit converter. A play
    through a player is resampled to the clock of its drive (`Rig.excite`). What brings the volts to SI is
    stored with them.
    """

    captures: tuple[Capture, ...]
    calibration: str
    """Content hash of the calibration that was computed from them (`Calibration.digest`)."""
    patch: str
    point: str
    drive: str
    """Channel that monitors the patch."""
    drive_ratio: float
    """Volts at the patch over volts of that channel."""
    laser: str
    """Channel of the vibrometer."""
    laser_scale: float
    """SI over volts of that channel: m/s, m or m/s^2 per V."""
    laser_bandwidth_hz: float
    """Corner of the vibrometer's output (Hz; one pole)."""
    laser_high_pass_hz: float
    """Corner of its high-pass (Hz; one pole); 0 without."""
    laser_delay: float
    """Delay of the vibrometer's output (s)."""
    laser_quantity: Quantity
    """What it shows."""
    simulated: bool

    @classmethod
    def of(cls, rig: Rig, captures: Sequence[Capture], calibration: str, patch: str, point: str) -> Waveforms:
        """Of the captures that a rig collected."""
        divider = rig.sensors.drive
        assert divider is not None  # a table was measured
        return cls(
            tuple(captures),
            calibration,
            patch,
            point,
            drive=rig.monitor(patch),
            drive_ratio=float(divider.to_si(np.ones((1, 1)))[0, 0]),
            laser=rig.vibrometer.channel,
            laser_scale=rig.vibrometer.scale,
            laser_bandwidth_hz=rig.vibrometer.bandwidth_hz,
            laser_high_pass_hz=rig.vibrometer.high_pass_hz,
            laser_delay=rig.vibrometer.delay,
            laser_quantity=rig.vibrometer.quantity,
            simulated=rig.simulated,
        )

    @staticmethod
    def beside(calibration: Path) -> Path:
        """Where the waveforms of a calibration's file are kept: FILE-waveforms.h5 beside it."""
        return calibration.with_name(f"{calibration.stem}{_BESIDE}{calibration.suffix}")

    @staticmethod
    def is_beside(path: Path) -> bool:
        """True for a file with a name that `beside` gives."""
        return path.stem.endswith(_BESIDE)

    @property
    def seconds(self) -> float:
        """Time measured (s)."""
        return float(sum(capture.volts.shape[1] / capture.rate_hz for capture in self.captures))

    def save(self, path: str | Path) -> None:
        """Write to a new HDF5 file, whole or not at all. Raises DataError if it exists."""
        hdf5.write(path, "waveforms", hdf5.flatten(self), packed=True)

    @classmethod
    def load(cls, path: str | Path) -> Waveforms:
        """Read what `save` wrote. Raises DataError, one sentence, for anything else."""
        return hdf5.restore(cls, hdf5.read(path, "waveforms"), path)
