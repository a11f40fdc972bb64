"""Sensor health: tests of accelerometer and laser, for unattended runs."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from ...base.arrays import BoolArray, FloatArray, IntArray
from ...instruments import Capture, Rest, Rig
from ...instruments.mains import Hum, mains_hum
from ...instruments.sensors import fault_at_rest
from ...instruments.vibrometer import Vibrometer
from ..background import Record, steady, tones_in, tones_of
from ..band import BAND
from ..drive import Drive
from ..response import RESOLVED, ringing_of
from ..spectra import fade

_NOISIER, _QUIETER = 4.0, 0.7
"""Noise of the laser at rest, over its usual noise, beyond which the laser is at fault: a blocked laser has
ten times; the DAQ alone, without a laser, half of a PDV-100's (measured on the simulated rig)."""
_LOUD = 2.0
"""Noise over the usual one, above which it is told."""
_SHAKING = 0.5
"""m/s^2 rms of an accelerometer at rest; its own noise is a fifth of this or less."""
_REST, _LASER_REST = 0.5, 1.0
"""Recording time (s) of accelerometer and laser at rest."""
_FAST = 3000.0
"""Frequency (Hz) above which no drive and no table moves, and a spike does."""
_SPIKE = 9.0
"""Size of a spike above that frequency, over the noise's standard deviation there."""
_SHARE, _REACH = 0.05, 1e-3
"""Share of a spike's size, within this time (s) of it, that counts as the filter's ringing."""
_AROUND = 0.2e-3
"""Time (s) on either side of a spike that is replaced with it."""
_SLOW, _TAPS = 1000.0, 0.02
"""Frequency (Hz) above which a filled gap should not move, and length (s) of the filter that tells it."""
_FLOOR = 1e-6
"""Regularisation of the filling, over the filter's power."""
_FIRST, _MAINS_OFF = np.arange(1, 3), 0.5
"""Multiples of the mains' frequency, and distance (Hz) within which a tone counts as theirs."""
_PATIENCE, _RINGS = 8, RESOLVED / 10
"""Records until the surface has come to rest, and rms velocity over the range that still rings."""
_FAINT = RESOLVED / 2
"""Amplitude of a tone, over the range, up to which it is not told."""
_EDGE, _LOWEST = 0.05, 10.0
"""Fade (s) and lowest frequency (Hz) where what is shown is brought to velocity."""
MATTERS = 0.1
"""Acceleration that the laser shows at rest, over that of a target, above which it can fail a check."""


@dataclass(frozen=True, eq=False)
class LaserAtRest:
    """Signal of the laser while nothing is driven."""

    noise: float
    """m/s per sqrt(Hz), one-sided, median over the band, without spikes."""
    spikes: float
    """Spikes per second."""
    hum: Hum | None
    """Mains hum (m/s)."""
    tones_hz: tuple[float, ...]
    """Steady tones of any origin."""
    shaking: float
    """Acceleration (m/s^2 rms within the band) that the signal would mean, spikes and hum included."""

    def disturbances(self, usual: float | None, spikes: float = 0.0) -> tuple[str, ...]:
        """Sentences on what disturbs the laser. `spikes` (per s) were counted while a patch was driven.

        `usual` is its noise in earlier, healthy runs; None if none is on record.
        """
        told = []
        if max(spikes, self.spikes) > 0:
            told.append(
                f"The laser spikes, {self.spikes:.0f} times a second at rest and {spikes:.0f} times while it "
                "measured: focus it, put reflective tape on the point, or move it by a millimetre."
            )
        if self.hum:
            told.append(
                f"The laser's signal has mains hum, {self.hum.rms * 1e6:.3g} µm/s at {self.hum.mains_hz:g} "
                "Hz and multiples: check the grounding of its cable, and ground laser and card at one point."
            )
        elif self.tones_hz:
            tones = ", ".join(f"{hz:.1f}" for hz in self.tones_hz)
            told.append(
                f"The laser's signal has steady tones at {tones} Hz: look for a fan or a motor nearby, and "
                "stop it."
            )
        if usual is not None and self.noise > _LOUD * usual:
            told.append(
                f"The laser has {self.noise / usual:.1f} times its usual noise: focus it, or put reflective "
                "tape on the point."
            )
        return tuple(told)

    def hides(self, drive: Drive) -> bool:
        """True when the laser at rest shows so much motion that a check of a drive could fail by it."""
        return self.shaking > MATTERS * float(np.sqrt(np.mean(drive.target**2)))


def loose_accelerometer(rig: Rig) -> str | None:
    """The fault of the accelerometer, as a sentence; None if it has none, or the rig has no accelerometer."""
    sensor = rig.sensors.acceleration
    if sensor is None:
        return None
    rig.operator.tell(Rest(_REST))
    volts = rig.daq.captured(sensor.channels, rig.file.rate_hz, _REST).volts
    problem = fault_at_rest(sensor, volts)
    shown = sensor.to_si(volts)
    if problem is None and float(shown.std(axis=1).max()) > _SHAKING:
        hum = mains_hum(shown[int(np.argmax(shown.std(axis=1)))], rig.file.rate_hz)
        problem = "it shows vibration at rest: check its wires, and that nobody touches the rig."
        if hum and hum.share > 0.5:
            problem = f"it shows mains hum at {hum.mains_hz:g} Hz: check its grounding and its supply."
    if problem is None:
        return None
    rests = f"{', '.join(f'{one:.1f}' for one in shown.mean(axis=1))} m/s² along {', '.join(sensor.axes)}"
    return f"The accelerometer is loose or turned: it rests at {rests}; {problem}"


def laser_at_rest(rig: Rig) -> LaserAtRest:
    """Record the laser for a second without a drive, and look for noise, spikes and hum.

    While the surface still rings of what was played before, it is recorded again.
    """
    rate_hz = rig.table.rate_hz
    for _ in range(_PATIENCE):
        capture = rig.daq.captured((rig.vibrometer.channel,), rate_hz, _LASER_REST)
        calm, spikes = without_spikes(rig, capture)
        shown = rig.vibrometer.to_si(calm.volts[0])
        if not ringing_of(shown, rate_hz) > _RINGS * rig.vibrometer.range:
            break
    velocity = _velocity(rig.vibrometer, rig.vibrometer.to_si(capture.volts[0]), rate_hz)
    quiet = _velocity(rig.vibrometer, shown, rate_hz)
    f, power = scipy.signal.welch(quiet, rate_hz, nperseg=round(rate_hz / 10))
    inside = (f >= BAND[0]) & (f <= BAND[1])
    factor = max(1, round(rate_hz / _SLOW / 2.5))
    half = len(shown) // factor // 2
    # In two halves, because what still rings is no tone.
    halves = slice(0, half), slice(half, 2 * half)
    slow = [Record(scipy.signal.resample_poly(shown, 1, factor), halves)]
    tones = tones_in(slow, rate_hz / factor)
    if len(tones):
        loud = np.abs(tones_of(slow[0], tones, rate_hz / factor)) > _FAINT * rig.vibrometer.range
        tones = tones[steady(slow, tones, rate_hz / factor) & loud]
    hum = mains_hum(quiet, rate_hz)
    if hum and len(tones) and not np.any(np.abs(tones[:, None] - hum.mains_hz * _FIRST) < _MAINS_OFF):
        hum = None
    return LaserAtRest(
        noise=float(np.sqrt(np.median(power[inside]))),
        spikes=spikes / _LASER_REST,
        hum=hum,
        tones_hz=tuple(tones.tolist()),
        shaking=_in_band(velocity, rate_hz),
    )


def _velocity(pickup: Vibrometer, shown: FloatArray, rate_hz: float) -> FloatArray:
    """Velocity (m/s) of (samples,) that a pick-up shows: as it is, or above the lowest frequencies only."""
    if pickup.quantity == "velocity":
        return shown
    f = np.asarray(np.fft.rfftfreq(len(shown), 1 / rate_hz))
    spectrum = np.fft.rfft((shown - shown.mean()) * fade(len(shown), *(round(_EDGE * rate_hz),) * 2))
    return np.asarray(np.fft.irfft(np.where(f < _LOWEST, 0.0, spectrum / pickup.response(f)), len(shown)))


def without_spikes(rig: Rig, capture: Capture) -> tuple[Capture, int]:
    """Replace the spikes of the laser's channel by what the signal around them suggests, and count them.

    A spike is told from motion by its speed: neither drive nor table move above 3 kHz. A signal that left its
    range in spikes alone counts as within it.
    """
    laser = capture.channels.index(rig.vibrometer.channel)
    hit = _spikes(capture.volts[laser], capture.rate_hz)
    found, count = scipy.ndimage.label(hit)
    groups = np.asarray(found, dtype=np.int64)
    if not count:
        return capture, 0
    volts = capture.volts.copy()
    volts[laser] = _filled(volts[laser], hit, groups, capture.rate_hz)
    overload = capture.overload.copy()
    fastest = float(np.abs(rig.vibrometer.to_si(volts[laser])).max())
    overload[laser] &= fastest > 0.98 * rig.vibrometer.range
    return replace(capture, volts=volts, overload=overload), count


def laser_or_patch(noise: float, usual: float | None) -> str:
    """Attribute a point that follows no drive to the laser or the patch, by the laser's noise at rest.

    `usual` is its noise in earlier, healthy runs; None if none is on record.
    """
    if usual is None:
        return "The laser or the patch has failed: there is no earlier noise of the laser to compare with."
    times = noise / usual
    evidence = f"at rest it shows {times:.1f} times its usual noise"
    if times > _NOISIER:
        return f"The laser does not see the surface, {evidence}: it is blocked or out of focus."
    if times < _QUIETER:
        return f"The laser is not connected, {evidence}: check its cable, and that it is on."
    return f"The laser is healthy, {evidence}, so that the patch is dead or its wires are off."


def _spikes(signal: FloatArray, rate_hz: float) -> BoolArray:
    """(samples,): True in spikes and right beside them."""
    fast = scipy.signal.sosfiltfilt(
        scipy.signal.butter(4, min(_FAST, 0.3 * rate_hz), "high", fs=rate_hz, output="sos"), signal
    )
    spread = float(np.median(np.abs(fast))) / 0.6745
    near = scipy.ndimage.maximum_filter1d(np.abs(fast), 2 * round(_REACH * rate_hz) + 1)
    hit = np.abs(fast) > np.maximum(_SPIKE * spread, _SHARE * near)
    edge = round(_REACH * rate_hz)  # where the filter sees the signal begin and end
    hit[:edge] = hit[len(hit) - edge :] = False
    if not spread or not hit.any():
        return np.zeros(len(signal), dtype=np.bool_)
    return np.asarray(scipy.ndimage.binary_dilation(hit, iterations=max(1, round(_AROUND * rate_hz))))


def _filled(signal: FloatArray, hit: BoolArray, groups: IntArray, rate_hz: float) -> FloatArray:
    """The signal with each gap filled such that gap and surroundings have the least power above 1 kHz."""
    index = np.arange(len(signal))
    filled = np.interp(index, index[~hit], signal[~hit])
    taps = scipy.signal.firwin(2 * round(_TAPS * rate_hz / 2) + 1, _SLOW, pass_zero=False, fs=rate_hz)
    kernel = scipy.signal.fftconvolve(taps, taps[::-1])
    middle = len(kernel) // 2
    for _ in range(2):  # the second time with the neighbouring gaps filled
        fast = scipy.signal.fftconvolve(filled, kernel, mode="same")
        for gap in scipy.ndimage.find_objects(groups):
            column = kernel[middle : middle + gap[0].stop - gap[0].start].copy()
            column[0] *= 1 + _FLOOR
            filled[gap] -= scipy.linalg.solve_toeplitz(column, fast[gap])
    return filled


def _in_band(velocity: FloatArray, rate_hz: float) -> float:
    """Acceleration within the band of drives (m/s^2 rms)."""
    f = np.fft.rfftfreq(len(velocity), 1 / rate_hz)
    spectrum = np.fft.rfft(velocity - velocity.mean()) * 2j * np.pi * f
    spectrum[(f < BAND[0]) | (f > BAND[1])] = 0
    return float(np.fft.irfft(spectrum, len(velocity)).std())
