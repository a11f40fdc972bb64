"""The measured frequency response from a patch's volts to the table's velocity, and its waveforms.

Result of a frequency response estimator, for any excitation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...base import hdf5
from ...base.arrays import ComplexArray, FloatArray
from ...base.errors import DataError
from ...instruments import Capture
from ...instruments.vibrometer import Quantity
from ..background import Tones
from .hysteresis import Hysteresis

if TYPE_CHECKING:
    from ...instruments import Rig

_CREST = 1.66
"""Crest factor of the multisines here."""
LINEAR = Hysteresis(np.zeros(1), np.ones(1), 1.0)
"""The law of a patch without hysteresis."""


@dataclass(frozen=True, eq=False)
class Response:
    """Frequency response of one point to one patch; arrays are (lines,).

    `velocity` is m/s per V at the patch, from the *measured* drive to the surface's own velocity:
    the vibrometer's delay and bandwidth and the card's channel skew are taken out. `deviation` is
    its standard deviation, of noise and of everything else that the measurement could not tell apart
    (drift, distortion, a law that does not fit, resonances narrower than lines resolve). `path` is measured
    volts at the patch per volt commanded (amplifier, converter and relay). `noise` is the density of
    everything in the measured velocity that did
    not repeat (m/s per sqrt(Hz), one-sided). `coherence` is that of one sweep or period: the share
    of the measured velocity's power that follows the drive, from the pooled noise and free of the
    bias that few repeats give the classical estimate. `distortion` is (2, lines) m/s per V: even and
    odd distortion, noise included, from lines that were not excited; (1, lines), odd only, where all
    even lines were. Lines need not be evenly spaced. What was not measured is empty.
    """

    patch: str
    point: str
    frequencies: FloatArray
    velocity: ComplexArray
    deviation: FloatArray
    coherence: FloatArray
    path: ComplexArray
    noise: FloatArray
    distortion: FloatArray
    repeats: int
    level: float
    """Amplitude of the sweep, or peak of the multisine (V, measured at the patch)."""
    levels: FloatArray
    """(levels,) V: amplitudes of further, smaller sweeps."""
    level_gain: ComplexArray
    """(levels,): the response to these over the response at `level`, one number for all lines: the
    patch's hysteresis, which makes it differ from one."""
    pickup_range: float
    """Full scale of the vibrometer (SI, of `pickup`): a drive must stay within it to be checked."""
    excitation: str
    """Excitation and its duration, in a sentence."""
    source: str
    """"measured", or the file that it was imported from, with its hash."""
    rig: str
    rig_file: str
    """The rig file at that time, as JSON."""
    simulated: bool
    created: str
    """Time of creation, ISO 8601, UTC."""
    scatter: FloatArray = field(default_factory=lambda: np.zeros(0))
    """(lines,) m/s per V: the part of `deviation` that differs from line to line, which a fit averages. The
    rest is common to neighbouring lines: the law's misfit, drift, what the lines do not resolve."""
    pickup: Quantity = "velocity"
    """What the vibrometer shows."""
    hysteresis: Hysteresis = LINEAR
    """The law that a multisine's response was computed with; that of sweeps follows from `level_gain`."""
    tones: Tones = field(default_factory=Tones)
    """The background's, in the rests between sweeps."""

    def __repr__(self) -> str:
        simulated = ", simulated" if self.simulated else ""
        low, high = (
            (float(edge) for edge in self.frequencies[[0, -1]]) if len(self.frequencies) else (0.0, 0.0)
        )
        lines = f"{low:.0f} to {high:.0f} Hz, {len(self.frequencies)} lines"
        return f"<Response of patch {self.patch} at {self.point}: {lines}{simulated}>"

    def refuse_nonsense(self) -> None:
        """See `hdf5.restore`. Raises DataError for lines that no measurement has."""
        lines = self.frequencies.shape
        if len(lines) != 1 or not lines[0] or not np.all(np.isfinite(self.velocity)):
            raise DataError("the response's frequencies and velocities are not rows of finite values.")
        if not (
            np.all(np.diff(self.frequencies) > 0) and 0 <= self.frequencies[0] <= self.frequencies[-1] < 1e9
        ):
            raise DataError("the response's frequencies do not rise.")
        rows = (self.velocity, *(one for one in self._said if one.size))
        if any(row.shape != lines for row in rows) or self.distortion.shape[-1:] not in ((0,), lines):
            raise DataError(f"the response does not have {lines[0]} values of each kind, one for each line.")
        if not np.all(np.isfinite(self.coherence)):
            raise DataError("the response's coherence is not finite.")
        if self.levels.shape != self.level_gain.shape:
            raise DataError("the response has gains of other levels than it was measured at.")

    @property
    def _said(self) -> tuple[FloatArray | ComplexArray, ...]:
        """Rows of lines that are empty where nothing was measured."""
        return self.deviation, self.coherence, self.path, self.noise, self.scatter

    @property
    def acceleration(self) -> ComplexArray:
        """m/s^2 per V at the patch."""
        return np.asarray(self.velocity * (2j * np.pi * self.frequencies))

    @property
    def displacement(self) -> ComplexArray:
        """Displacement (m per V at the patch), as in the paper's vibration maps."""
        return np.asarray(self.velocity / (2j * np.pi * self.frequencies))

    def confidence(self, level: float = 0.95) -> FloatArray:
        """(lines,) radius around `velocity` (m/s per V) that contains the true one with this probability.

        The noise of a line is circular and Gaussian (central limit theorem), so that the squared
        distance is exponentially distributed; multiply as `acceleration` and `displacement` do.
        """
        return np.asarray(np.sqrt(-np.log1p(-level)) * self.deviation)

    @property
    def uncertainty(self) -> float:
        """Relative standard deviation: rms over the lines, over that of the response; NaN if not known."""
        if not len(self.deviation):
            return float("nan")
        return float(np.linalg.norm(self.deviation) / np.linalg.norm(self.velocity))

    def snr_db(self, peak: float) -> float:
        """Velocity over noise (dB) within the band for a multisine of `peak` V, for `plan_excitation`."""
        if not len(self.noise):
            raise DataError(f"{self.source} says nothing about noise, so nothing can be planned with it.")
        band = float(self.frequencies[-1] - self.frequencies[0])
        signal = peak / _CREST * np.sqrt(np.mean(np.abs(self.velocity) ** 2))
        return float(20 * np.log10(signal / np.sqrt(np.mean(self.noise**2) * band)))


@dataclass(frozen=True, eq=False)
class FrfEstimate:
    """Fields as in `Response`; arrays are (lines,)."""

    frequencies: FloatArray
    velocity: ComplexArray
    deviation: FloatArray
    scatter: FloatArray
    coherence: FloatArray
    path: ComplexArray
    noise: FloatArray
    distortion: FloatArray
    level_gain: ComplexArray


# What a calibration was computed from: the waveforms of every play, as measured.

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
