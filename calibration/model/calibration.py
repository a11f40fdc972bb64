"""A calibration: response and model of one patch at one point, measured, dated and never edited."""

from __future__ import annotations

import glob
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...base import hdf5
from ...base.arrays import ComplexArray, FloatArray
from ...base.errors import ConfigurationError
from ...base.filters import fast_length
from ...base.notebook import InNotebook
from ...base.progress import Progress, silent
from ..band import BAND
from ..perception import pressing
from ..response import (
    SWEEP,
    BothSigns,
    Excitation,
    Hysteresis,
    Response,
    Waveforms,
    beyond,
    distortion,
    even_terms,
    fit_hysteresis,
    hidden,
    measure_above,
    measure_both_signs,
    measure_response,
    rows,
    terms_of,
)
from .finger import Finger
from .model import Model, fit

if TYPE_CHECKING:
    from ...instruments import Rig


@dataclass(frozen=True)
class ChannelScatter:
    """Standard deviations of what changes between a calibration and a later time, of one channel and patch.

    The defaults are estimates, for what was not measured.
    """

    gain: float = 0.01
    """Velocity per volt, relative."""
    delay: float = 2e-6
    """s."""
    changes: int = 0
    """Changes of channels from which they were told; 0 for estimates."""
    seconds: float = 0.0
    """Longest time between two calibrations among them."""


@dataclass(frozen=True, eq=False)
class Calibration(InNotebook):
    """Response, model and hysteresis of one patch at one point; `rate_hz` is the sample rate of drives.

    The model holds at the level of the excitation; the hysteresis describes the change with amplitude.

    For example:

        >>> calibration = haploop.Calibration.load("calibration.h5")
        >>> calibration.model.resonances[0].frequency_hz > 0
        True
    """

    response: Response
    model: Model
    hysteresis: Hysteresis
    rate_hz: float
    above: Response | None = None
    """Response beyond the model's band, to what amplifier and laser resolve; None if not measured: then no
    drive has power there."""
    distortion: float = 0.0
    """Motion at frequencies that were not played, over that at those played, with the hysteresis taken out.

    Measured with a multisine at the largest level and its negative, without the noise of either. It limits
    what a drive reaches without learning; 0 if not measured.
    """
    beyond: FloatArray = field(default_factory=lambda: np.zeros((3, 0)))
    """(3, bands): what that multisine moves above its own frequencies, by third octaves: see `beyond`; empty
    if not measured."""
    hidden: FloatArray = field(default_factory=lambda: np.zeros((3, 0)))
    """The same above what the laser passes, as far as it shows a part of that."""
    scatter: ChannelScatter = ChannelScatter()
    """Of its channel: see `calibration.model.channel_scatter`."""
    finger: Finger | None = None
    """Fingertip on the point that response and model hold for; None for the bare table."""
    chosen_hz: float = 0.0
    """Carrier (Hz) that was asked for; 0: the strongest resonance within the band of drives."""

    @property
    def carrier_hz(self) -> float:
        """Frequency (Hz) that carries presses: the one asked for, or the bare table's strongest resonance.

        A finger on a light pane makes another resonance the strongest, and a button would change its tone.
        """
        return self.chosen_hz or self.bare.resonance_hz

    @property
    def bare(self) -> Model:
        """The model of the bare table, also of a calibration under a finger."""
        return self.finger.bare if self.finger else self.model

    def carried_by(self, carrier_hz: float) -> Calibration:
        """The same with another carrier. Raises ConfigurationError for one that drives do not play."""
        low, high = BAND
        if not low < carrier_hz < high:
            raise ConfigurationError(
                f"A carrier of {carrier_hz:g} Hz lies outside the band of drives: choose one between "
                f"{low:g} and {high:g} Hz."
            )
        return replace(self, chosen_hz=carrier_hz)

    def quieter_than(self, hz: float) -> tuple[float, float]:
        """By how much (dB) the carrier is below another frequency at the same volts: as motion, and as felt.

        Motion is the bare table's velocity; what is felt counts from the threshold of a finger that presses.
        """
        f = np.array([self.carrier_hz, hz])
        motion = 20 * np.log10(np.abs(self.bare.velocity(f)))
        felt = motion + 20 * np.log10(f) - pressing(f)
        return float(motion[1] - motion[0]), float(felt[1] - felt[0])

    def __repr__(self) -> str:
        r, simulated = self.response, ", simulated" if self.response.simulated else ""
        under = f" under {self.finger.participant}'s finger" if self.finger else ""
        return (
            f"<Calibration patch {r.patch} at {r.point}{under}: resonance {self.model.resonance_hz:.2f} Hz, "
            f"{r.created}{simulated}>"
        )

    @classmethod
    def of(cls, response: Response) -> Calibration:
        """Fit model and hysteresis to a response. Raises what `fit` raises.

        Raises ConfigurationError for a response imported without a rig, because the rig sets the sample rate.
        """
        if not response.rig_file:
            raise ConfigurationError(
                f"The response of patch {response.patch} at the {response.point} point was {response.source} "
                "without a rig: say which rig it is for when reading it."
            )
        from ...instruments import RigFile  # noqa: PLC0415 - what is shown needs none

        table = RigFile.model_validate_json(response.rig_file).table
        assert table is not None  # the response was measured on it
        return cls(response, fit(response), fit_hysteresis(response), table.rate_hz)

    @property
    def digest(self) -> str:
        """Content hash of all inputs to a drive."""
        return hdf5.digest_of(self)

    def save(self, path: str | Path) -> None:
        """Write to a new HDF5 file, whole or not at all. Raises DataError if it exists."""
        hdf5.write(path, "calibration", hdf5.flatten(self))

    @classmethod
    def load(cls, path: str | Path) -> Calibration:
        """Read what `save` wrote. Raises DataError, one sentence, for anything else."""
        return hdf5.restore(cls, hdf5.read(path, "calibration"), path)


def calibration_of(path: str | Path, patch: str) -> Path:
    """Name of a patch's file, where several patches were calibrated into one name: FILE-A.h5 for FILE.h5."""
    path = Path(path)
    return path.with_name(f"{path.stem}-{patch}{path.suffix}")


def load_calibrations(paths: Sequence[str | Path], patches: Sequence[str] = ()) -> tuple[Calibration, ...]:
    """Read calibrations of several patches: those of `patches` if any are named, in that order.

    A path without a file stands for those of `calibration_of`. Raises ConfigurationError for a patch without
    a calibration, and what `Calibration.load` raises.

    For example:

        >>> (calibration,) = haploop.load_calibrations(["calibration.h5"])
        >>> calibration.response.point
        'button'
    """
    files: list[str | Path] = []
    for path in paths:
        named = [calibration_of(path, patch) for patch in patches]
        there = Path(path).exists()
        beside = _patches_beside(Path(path)) if not there and not named else []
        if beside:
            raise ConfigurationError(
                f"There is no file {path}, and beside it there are calibrations of patches "
                f"{', '.join(beside)}: name those that are to play (--patches {','.join(beside)})."
            )
        files += named if named and not there else [path]
    found = [Calibration.load(path) for path in files]
    read = [one.response.patch for one in found]
    missing = [patch for patch in patches if patch not in read]
    if missing:
        raise ConfigurationError(
            f"There is no calibration of patch {', '.join(missing)} among those given ({', '.join(read)}): "
            f"calibrate it (haploop calibrate --patch {','.join(missing)})."
        )
    if patches:
        found = [one for patch in patches for one in found if one.response.patch == patch]
    return tuple(found)


def _patches_beside(path: Path) -> list[str]:
    """Patches whose files `calibration_of` names."""
    found = sorted(path.parent.glob(f"{glob.escape(path.stem)}-*{path.suffix}"))
    names = [one.stem.removeprefix(f"{path.stem}-") for one in found]
    return [name for name in names if "-" not in name and name != "waveforms"]


# Measure a calibration: the response, the patch's even order, what is left, and the response above.
#
# The even order is found from a drive and its negative. Everything odd in the patch and everything linear in
# the table answers the negative with the negative, so that the mean of both motions holds the even order
# alone, with noise, and with the ringing that both plays found. The even order is the known response applied
# to a kink and a square of the linear volts: two unknown parts, beside the free decay of the modes. Noise
# scatters the parts; an error of the response scales them. An even order of another shape, or one that lags
# in its own way, leaves a residual, which the distortion counts. After Pintelon and Schoukens, System
# Identification, 2012, chapter 3 (even and odd nonlinear contributions).

_RING = 2.0
"""Time (s) after the drive in which the simulated table falls silent, so that nothing wraps."""
_SIGNIFICANT = 12.0
"""Decrease of the squared residual, over that of a line of what is left, from which there is an even order:
noise alone takes more than that once in a thousand times."""
_UNSEEN = 1e-9
"""Singular values, over the largest, of columns that the others hold."""


def even_order(calibration: Calibration, both: BothSigns) -> FloatArray:
    """(2,): `Hysteresis.even` of a patch; zeros where the plays show none beyond their noise."""
    law, model, channels = calibration.hysteresis, calibration.model, both.channels
    samples = both.volts.shape[-1]
    at = np.asarray(np.fft.rfftfreq(samples, 1 / channels.rate_hz), dtype=np.float64)
    inside = (at >= model.band[0]) & (at <= model.band[1])
    long = fast_length(samples + round(_RING * channels.rate_hz))
    f = np.asarray(np.fft.rfftfreq(long, 1 / channels.rate_hz), dtype=np.float64)
    f = f[f <= model.band[1]]
    lag = law.gain(calibration.response.level)
    path = model.velocity(f) / lag * np.exp(-2j * np.pi * f * channels.drive_delay)

    def moved(linear_volts: FloatArray) -> ComplexArray:
        """(..., lines) m/s that linear volts make while they last."""
        spectra = np.fft.rfft(linear_volts, long)[..., : len(f)] * path
        return np.asarray(np.fft.rfft(np.fft.irfft(spectra, long)[..., :samples])[..., inside])

    seen = channels.velocity(np.fft.rfft(both.velocity.mean(axis=0))[inside], at[inside])
    odd = np.array([law.odd(one) for one in both.volts])
    # Where the two drives differ by more than their sign, the surface moves by that as well.
    seen = seen - moved(odd.mean(axis=0))
    columns = moved(np.mean([even_terms(one, law.level) for one in odd], axis=0))
    decays = terms_of(model.poles, at[inside])[1]
    _, without = _fitted(decays, seen)
    parts, left = _fitted(np.concatenate([columns, decays]), seen)
    per_line = left / (2 * int(inside.sum()) - len(columns) - len(decays))
    return parts[:2] if without - left > _SIGNIFICANT * per_line else np.zeros(2)


def _fitted(columns: ComplexArray, seen: ComplexArray) -> tuple[FloatArray, float]:
    """Real parts (columns,) of least squares, and the squared residual."""
    matrix, measured = rows(columns), rows(seen)
    norms = np.linalg.norm(matrix, axis=1)
    norms[norms == 0] = 1.0
    found = np.linalg.lstsq((matrix / norms[:, None]).T, measured, rcond=_UNSEEN)[0] / norms
    return found, float(((measured - found @ matrix) ** 2).sum())


def calibrate(
    rig: Rig,
    patch: str = "A",
    point: str = "button",
    progress: Progress = silent,
    *,
    excitation: Excitation = SWEEP,
) -> Calibration:
    """Measure the response of a patch at a point, fit a model to it, and measure the response above its band.

    Both kinds of excitation measure the patch's hysteresis as well.

    `progress` is called with the seconds measured. Raises what `measure_response` and `fit` raise.

    For example:

        >>> calibration = haploop.calibrate(rig, patch="A", point="button")
        >>> calibration.save("calibration.h5")
        >>> calibration.response.patch, calibration.response.point
        ('A', 'button')
    """
    found = Calibration.of(measure_response(rig, patch, point, progress, excitation=excitation))
    return examined(rig, found, progress)


def calibrate_keeping(
    rig: Rig,
    patch: str = "A",
    point: str = "button",
    progress: Progress = silent,
    *,
    excitation: Excitation = SWEEP,
) -> tuple[Calibration, Waveforms]:
    """`calibrate`, and the volts of every play that it was computed from, of which it can be computed again.

    Raises what `calibrate` raises.
    """
    with rig.captures() as captures:
        found = calibrate(rig, patch, point, progress, excitation=excitation)
    return found, Waveforms.of(rig, captures, found.digest, patch, point)


def examined(rig: Rig, calibration: Calibration, progress: Progress = silent) -> Calibration:
    """Add to a calibration the patch's even order, the distortion left, and the response above its band.

    To be called after its response was measured, with the laser still at the point. Raises what
    `measure_response` raises. A generator plays nothing but sweeps, which show none of that: then nothing is
    added.
    """
    if rig.feeds_amplifier("generator"):
        return calibration
    patch, point = calibration.response.patch, calibration.response.point
    both = measure_both_signs(rig, patch, point, progress)
    law = replace(calibration.hysteresis, even=even_order(calibration, both))
    above = measure_above(rig, patch, point, law, progress)
    found = replace(calibration, hysteresis=law, above=above, distortion=distortion(both, law))
    if above is None:
        return found
    return replace(found, beyond=beyond(both, law, above), hidden=hidden(both, law, above))
