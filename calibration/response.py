"""The measured frequency response from a patch's volts to the table's velocity at a point."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from scipy.fft import fft, ifft, next_fast_len, rfft
from scipy.ndimage import uniform_filter1d

from calibration.excitation import linear_sweep
from calibration.spectra import fade
from instruments import Aim, Capture, ConfigurationError, DataError, InstrumentError, Rig
from instruments.arrays import ComplexArray, FloatArray

__all__ = ["Response", "measure_response"]

Progress = Callable[[float, float], None]
"""Told the seconds measured so far and the seconds that the whole will take."""

SWEEP_STOP_HZ = 625.0
"""Paper, "Vibration map": a linear sine sweep from 0 to 625 Hz."""
SWEEP_BAND = (20.0, 620.0)
"""Hz: the lines that the sweep excites fully, between its slow start and its fade."""
_WIDE = (12.0, 623.0)
"""Hz: a little more, for what needs neighbours."""
_PART = 75.0
"""Hz, of the overlapping parts in which harmonics are told from the response."""
_POOL = 41
"""Neighbouring lines whose noise is averaged: noise is smooth over frequency (5 Hz of it), so that
a few repeats tell its level within 10 %."""


@dataclass(frozen=True, eq=False)
class Response:
    """What one patch does at one point; arrays are (lines,).

    `velocity` is m/s per V at the patch, from the *measured* drive to the surface's own velocity:
    the vibrometer's delay and bandwidth and the card's channel skew are taken out. `deviation` is
    its standard deviation. `path` is measured volts at the patch per volt commanded (amplifier,
    converter and relay). `noise` is the density of everything in the measured velocity that did
    not repeat (m/s per sqrt(Hz), one-sided). `coherence` is that of one sweep: the share of the
    measured velocity's power that follows the drive, from the pooled noise and free of the bias
    that few repeats give the classical estimate.
    """

    patch: str
    point: str
    frequencies: FloatArray
    velocity: ComplexArray
    deviation: FloatArray
    coherence: FloatArray
    path: ComplexArray
    noise: FloatArray
    repeats: int
    level: float
    """Amplitude of the sweep (V, measured at the patch)."""
    levels: FloatArray
    """(levels,) V: amplitudes of further, smaller sweeps."""
    level_gain: ComplexArray
    """(levels,): the response to these over the response at `level`, one number for all lines: the
    patch's hysteresis, which makes it differ from one."""
    velocity_range: float
    """The vibrometer's full scale (m/s): a drive must stay within it to be checked."""
    rig: str
    rig_file: str
    """The rig as it was: its file as JSON."""
    simulated: bool
    created: str
    """When, ISO 8601, UTC."""

    @property
    def acceleration(self) -> ComplexArray:
        """m/s^2 per V at the patch."""
        return np.asarray(self.velocity * (2j * np.pi * self.frequencies))

    @property
    def displacement(self) -> ComplexArray:
        """M per V at the patch: what the paper's vibration maps show."""
        return np.asarray(self.velocity / (2j * np.pi * self.frequencies))

    def coherence_min(self, low: float, high: float) -> float:
        """Lowest coherence between two frequencies (Hz). Raises DataError if none was measured."""
        inside = (self.frequencies >= low) & (self.frequencies <= high)
        if not inside.any():
            raise DataError(f"The response has no line between {low:g} and {high:g} Hz.")
        return float(self.coherence[inside].min())


def measure_response(
    rig: Rig,
    patch: str = "A",
    point: str = "button",
    progress: Progress = lambda _done, _total: None,
    *,
    repeats: int = 3,
    shares: tuple[float, ...] = (0.5, 0.25, 0.1),
    duration: float = 7.0,
    tail: float = 1.2,
    level: float | None = None,
) -> Response:
    """Sweep a patch from 0 to 625 Hz, as the paper does, several times, and divide the spectra.

    The whole record, sweep and ringing, goes into one transform, so that there is no leakage
    (0.8 % error where Welch's method has 5 %). `level` is the peak in volts at the patch; None
    takes what the rig's limits allow. One more sweep at each of `shares` of that level shows how the
    response depends on it.

    Raises InstrumentError when the operator does not confirm, a signal leaves its range or the
    drive does not reach the patch; DataError when the point does not follow the patch;
    ConfigurationError for a rig that lacks an instrument or fewer than two repeats.
    """
    if repeats < 2:
        raise ConfigurationError("A response needs at least 2 repeats: their difference is its noise.")
    monitor = drive_monitor(rig)
    rate_hz = rig.table.rate_hz
    peak = rig.limits.peak if level is None else level
    sweep = linear_sweep(rate_hz, duration, SWEEP_STOP_HZ, peak)
    prepare(rig, point)

    factors = (*(1.0,) * repeats, *shares)
    total = len(factors) * (duration + tail)
    done = 0.0

    def tell(seconds: float) -> None:
        nonlocal done
        done += seconds
        progress(done, total)

    channels = (monitor, rig.vibrometer.channel)
    drives, velocities = [], []
    for factor in factors:
        capture = rig.excite(factor * sweep, (patch,), channels, tail, tell)
        refuse_overload(rig, capture)
        length = next_fast_len(capture.volts.shape[1], real=True)
        frequencies, drive, velocity = _spectra(rig, capture, length)
        drives.append(drive)
        velocities.append(velocity)
    X, Y = np.array(drives[:repeats]), np.array(velocities[:repeats])
    samples = capture.volts.shape[1]
    speed = SWEEP_STOP_HZ / duration

    commanded = rfft(sweep, length)[_lines(rate_hz, length)]
    power = (np.abs(X) ** 2).sum(axis=0)
    path = X.mean(axis=0) / commanded
    gain = float(np.median(np.abs(path)))
    _refuse_silent_drive(gain, patch)
    H = (np.conj(X) * Y).sum(axis=0) / power
    # The drive is strong where the velocity is weak, so that what does not repeat is the velocity's.
    residual = (np.abs(Y - H * X) ** 2).sum(axis=0) / (repeats - 1)
    residual = uniform_filter1d(residual, _POOL, mode="nearest")
    H = _without_harmonics(H, frequencies, speed)
    signal = np.maximum((np.abs(H) ** 2 * power - residual) / repeats, 0.0)
    smaller = [
        _without_harmonics(y / x, frequencies, speed)
        for x, y in zip(drives[repeats:], velocities[repeats:], strict=True)
    ]
    kept = (frequencies >= SWEEP_BAND[0]) & (frequencies <= SWEEP_BAND[1])
    response = Response(
        patch=patch,
        point=point,
        frequencies=frequencies[kept],
        velocity=H[kept],
        deviation=np.sqrt(residual / power)[kept],
        coherence=(signal / (signal + residual))[kept],
        path=path[kept],
        noise=np.sqrt(2 * residual / (samples * rate_hz))[kept],
        repeats=repeats,
        level=gain * peak,
        levels=gain * peak * np.array(shares),
        level_gain=np.array([np.vdot(H[kept], h[kept]) for h in smaller]) / np.linalg.norm(H[kept]) ** 2,
        velocity_range=rig.vibrometer.range,
        rig=rig.name,
        rig_file=rig.file.model_dump_json(),
        simulated=rig.simulated,
        created=datetime.now(UTC).isoformat(timespec="seconds"),
    )
    _refuse_incoherent(response)
    return response


def drive_monitor(rig: Rig) -> str:
    """The channel that measures the volts at the patch. Raises ConfigurationError without one."""
    if rig.sensors.drive is None:
        raise ConfigurationError(
            f"The rig {rig.name!r} has no [sensors.drive]; a drive is always measured, never assumed."
        )
    return rig.sensors.drive.channels[0]


def prepare(rig: Rig, point: str) -> None:
    """Settings confirmed, laser aimed at `point` and in focus. Raises InstrumentError."""
    rig.confirm_settings()
    if not rig.operator.confirm(Aim(point)):
        raise InstrumentError(f"The operator did not confirm this, so nothing was measured: {Aim(point)}")
    level = rig.vibrometer.signal_level()
    if level is not None and level < 0.1:
        raise InstrumentError(
            f"The vibrometer sees {level:.0%} of its light at the {point} point: focus the laser, or "
            "put a piece of reflective tape there."
        )


def overloaded(rig: Rig, capture: Capture) -> str | None:
    """What left its range in a capture of drive monitor and laser, and what to do; None if nothing did."""
    laser = capture.channels.index(rig.vibrometer.channel)
    fastest = float(np.abs(rig.vibrometer.to_velocity(capture.volts[laser])).max())
    if capture.overload[laser] or fastest > rig.vibrometer.range:
        return (
            f"The laser left its range of {rig.vibrometer.range * 1e3:g} mm/s: "
            "choose a larger range, or a lower level."
        )
    if capture.overload.any():
        name = capture.channels[int(np.flatnonzero(capture.overload)[0])]
        return f"The channel {name!r} left its input range: widen the range in the rig file."
    return None


def refuse_overload(rig: Rig, capture: Capture) -> None:
    """Raises InstrumentError when something in a capture left its range."""
    problem = overloaded(rig, capture)
    if problem:
        raise InstrumentError(problem)


def _lines(rate_hz: float, length: int) -> slice:
    first, last = (edge * length / rate_hz for edge in _WIDE)
    return slice(int(np.ceil(first)), int(np.floor(last)) + 1)


def _spectra(rig: Rig, capture: Capture, length: int) -> tuple[FloatArray, ComplexArray, ComplexArray]:
    """Frequencies (Hz), and per line the volts at the patch and the surface's velocity, in time."""
    lines = _lines(capture.rate_hz, length)
    f = np.arange(lines.start, lines.stop) * capture.rate_hz / length
    drive, laser = capture.channels.index(drive_monitor(rig)), capture.channels.index(rig.vibrometer.channel)
    divider = rig.sensors.drive
    assert divider is not None
    volts = divider.to_si(capture.volts[[drive]])[0]
    velocity = rig.vibrometer.to_velocity(capture.volts[laser])
    skew = np.exp(-2j * np.pi * f * capture.delays[[drive, laser], None])
    # Means are taken off before the padding makes steps of them.
    X = rfft(volts - volts.mean(), length)[lines] * skew[0]
    Y = rfft(velocity - velocity.mean(), length)[lines] * skew[1] / rig.vibrometer.response(f)
    return f, np.asarray(X), np.asarray(Y)


def _without_harmonics(H: ComplexArray, frequencies: FloatArray, speed: float) -> ComplexArray:
    """A sweep's response without the harmonics that the patch's hysteresis adds to it.

    The sweep passes frequency f at the time f / speed (Hz, Hz/s). What the n-th harmonic brings at f
    came n times earlier, so that in the impulse response it stands before time zero, at (1/n - 1)
    f / speed, where no causal system answers (Farina, AES 108th Convention, 2000, for a logarithmic
    sweep; with a linear one the place depends on f). The answer is gated in overlapping parts of
    the band, each with its own gate from half way to the second harmonic to where the last wraps.
    """
    # Beyond the ends it is continued point-symmetrically and faded, because an edge would ring.
    step = float(frequencies[1] - frequencies[0])
    more = round(_PART / 2 / step)
    f = frequencies[0] + step * np.arange(-more, len(H) + more)
    longer = np.pad(H, more, mode="reflect", reflect_type="odd") * fade(len(f), more, more)
    time = np.arange(len(f)) / (len(f) * step)
    gated = np.zeros(len(f), dtype=np.complex128)
    for centre in np.arange(f[0], f[-1] + _PART, _PART):
        weight = np.clip(1 - np.abs(f - centre) / _PART, 0, 1)
        begin = 1 / step - max((centre - _PART) / speed / 4, 0.1)
        end = 1 / step - (centre + _PART) / speed
        gate = np.interp(time, [end - 0.1, end, begin, begin + 0.05], [1, 0, 0, 1])
        gated += fft(gate * ifft(longer * weight))
    return gated[more : more + len(H)]


def _refuse_silent_drive(gain: float, patch: str) -> None:
    if not 0.7 < gain < 1.4:
        raise InstrumentError(
            f"The drive monitor shows {gain:.2g} V for each volt that patch {patch} was to get: check the "
            "amplifier (is it on?), the relay, and the gain and divider in the rig file."
        )


def _refuse_incoherent(response: Response) -> None:
    typical = float(np.median(response.coherence))
    if typical < 0.5:
        raise DataError(
            f"The {response.point} point does not follow patch {response.patch}: the coherence is "
            f"{typical:.2f} where 0.5 is the least that can be used and 0.99 is usual. Check the laser's "
            "focus and aim, and that the patch is glued and connected."
        )
