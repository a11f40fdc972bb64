"""Tests of the sensors and of the DAQ cards that sample them, of the camera and of the streams."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ...base.arrays import FloatArray
from ...base.errors import HaploopError
from ...instruments import Camera, LinearSensor, Press, Rest, Rig
from ...instruments.operator import Place, Remove
from ...instruments.sensors import fault_at_rest
from ...instruments.streams import LslStreams
from ..background import Record, tones_in, tones_of
from ..spectra import resample
from .finding import Finding, Status

_GRAVITY = 9.80665
_MASS_TOLERANCE = 0.05
_NOTHING = 1.0
"""m/s^2 at rest below which an accelerometer may be AC-coupled."""
_COUPLED = 1.0
"""Constant voltage from which an AC-coupled sensor is not coupled so (V; IEPE supplies rest at 8 to 12)."""
_CONVERTER_NOISE = 28e-6
"""V rms per V of range: a 16-bit card's (estimate; docs/hardware.md, "All NI cards")."""
_TONES_HZ = 2500.0
"""Sample rate (Hz) at which steady tones are looked for."""
_ENDS = 0.02
"""Part of a record at either end that is left out."""
_TONES, _SHARE = 1.0, 0.3
"""Rms of steady tones over the card's own noise, and over all noise, from which they are told."""
COUNTS = 1e3
"""Full scale from which a channel counts: no input takes as many volts."""
_NOISY = 5e-3
"""Fraction of the range above which noise exceeds that of any sensor."""
_APART, _DRIFTED = 30e-3, 5e-3
"""Largest difference (s) between the times of one press on two cards, and largest change of this
difference between two presses. The snap of a button appears in force and acceleration 10 to 13 ms
apart, constant within 2 ms (measured on the plant)."""
_BETWEEN_PRESSES = 30.0
"""Time between the presses (s), in which clocks that differ by 170 ppm drift apart by 5 ms."""
_PRESS = 4.0
"""Time (s) from the request to press until the press is over."""
_PRESS_BAND = (15.0, 100.0)
"""Band (Hz) in which the snap appears in both force and acceleration."""


def cards(rig: Rig) -> Mapping[str, Sequence[str]]:
    """The measured channels of each card."""
    sensors = rig.sensors
    measured = [*sensors.of_presses.values(), *([sensors.drive] if sensors.drive else [])]
    names = [channel for sensor in measured for channel in sensor.channels]
    names += [extra.channel for extra in sensors.extra.values() if extra.channel not in names]
    if rig.file.vibrometer is not None:
        names.append(rig.vibrometer.channel)
    return rig.daq.cards(names)


def check_noise(rig: Rig) -> Iterator[Finding]:
    """Test that the noise floor of each channel is neither too high nor zero."""
    rig.operator.tell(Rest(1.0))
    for card, channels in cards(rig).items():
        rate_hz = rig.file.rate_hz
        try:
            with rig.daq.stream(channels, rate_hz, round(rate_hz / 10), round(rate_hz)) as stream:
                ranges = stream.full_scale
                capture = stream.capture()
        except HaploopError as error:
            yield Finding(f"Noise floor of {card or 'the card'}", "daq", "red", str(error))
            continue
        for name, volts, full_scale, overload in zip(
            channels, capture.volts, ranges, capture.overload, strict=True
        ):
            if full_scale >= COUNTS:
                told = (
                    f"{volts.std():.2g} counts rms about {volts.mean():.3g}, from 0 where the reading began."
                )
                yield Finding(f"Noise floor of {name}", "daq", "green", told)
                continue
            if overload and rig.sensors.activation and name in rig.sensors.activation.channels:
                told = f"The contact is at the end of its +-{full_scale:g} V: only its threshold counts."
                yield Finding(f"Noise floor of {name}", "daq", "green", told)
                continue
            status, sentence = _noise_floor(rig, name, volts, float(full_scale), bool(overload))
            yield Finding(f"Noise floor of {name}", "daq", status, sentence)


def _noise_floor(
    rig: Rig, name: str, volts: FloatArray, full_scale: float, overload: bool
) -> tuple[Status, str]:
    mean, rms = float(volts.mean()), float(volts.std())
    converter = _CONVERTER_NOISE * full_scale
    measured = f"{_volts(rms)} rms about {_volts(mean)} in +-{full_scale:g} V"
    sensors = rig.sensors
    # A weight, and gravity; what is AC-coupled shows nothing at rest.
    constant = [one for one in (sensors.force, sensors.acceleration) if one and not one.ac_coupled]
    never_zero = [channel for one in constant for channel in one.channels]
    if overload:
        return "red", (
            f"The signal is at the end of its range ({measured}): the sensor is saturated, its wire is "
            "disconnected, or the range in the rig file is too small."
        )
    if rms == 0:
        return "red", f"The signal is constant ({measured}): check the converter and the cable."
    if name in never_zero and abs(mean) < 10 * converter and rms < 2 * converter:
        return ("yellow", f"The signal is only the card's own noise ({measured}): is the sensor connected?")
    tones, heard = _tones(volts - mean, rig.file.rate_hz)
    if heard > _TONES * converter and heard > _SHARE * rms:
        told = ", ".join(f"{hz:.1f}" for hz in tones[:6])
        return "yellow", (
            f"The signal has steady tones at {told} Hz, {_volts(heard)} rms of it ({measured}): look for "
            "mains hum (ground the cable), a fan or a motor."
        )
    if rms > _NOISY * full_scale:
        return (
            "yellow",
            f"The signal is noisy ({measured}): check for hum, a floating ground or hands on the table.",
        )
    return "green", f"{measured}; the card's own noise is about {_volts(converter)}."


def _tones(volts: FloatArray, rate_hz: float) -> tuple[FloatArray, float]:
    """Steady tones of a channel at rest: frequencies (Hz), and their rms (V) together."""
    samples = min(len(volts), round(len(volts) / rate_hz * _TONES_HZ))
    rate_hz *= samples / len(volts)
    # Resampled as if it were periodic, so that its ends are left out.
    edge = round(_ENDS * samples)
    record = Record(resample(volts, samples), (slice(edge, samples - edge),))
    tones = tones_in([record], rate_hz)
    if not len(tones):
        return tones, 0.0
    return tones, float(np.sqrt((np.abs(tones_of(record, tones, rate_hz)) ** 2).sum() / 2))


def _volts(value: float) -> str:
    return f"{value:.3g} V" if abs(value) >= 0.1 else f"{value * 1e3:.2g} mV"


def check_force(rig: Rig, mass: float) -> Iterator[Finding]:
    """Compare the force sensor's reading with a known mass (kg), put on it by the operator."""
    sensor = rig.sensors.force
    assert sensor is not None
    if sensor.ac_coupled:
        sentence = (
            "Not tested with a mass: the force sensor is AC-coupled "
            f"({sensor.transfer.high_pass_hz[0]:.2g} Hz), and what is constant fades. Compare its "
            "sensitivity with its certificate."
        )
        yield Finding("Known mass", "force", "yellow", sentence)
        return
    rig.operator.tell(Rest(1.0))
    rest = rig.daq.captured(sensor.channels, rig.file.rate_hz, 1.0).volts.mean(axis=1)
    if not rig.operator.confirm(Place(mass)):
        yield Finding("Known mass", "force", "yellow", "Not tested: no mass was put on the force sensor.")
        return
    loaded = rig.daq.captured(sensor.channels, rig.file.rate_hz, 1.0).volts.mean(axis=1)
    rig.operator.confirm(Remove())
    force = sensor.to_si((loaded - rest)[:, np.newaxis])[:, 0]
    weight = mass * _GRAVITY
    normal = float(sensor.sign * force[sensor.row])
    level = [
        value
        for axis, value in zip(sensor.axes, force.tolist(), strict=True)
        if axis in ("x", "y", "z") and axis != sensor.axes[sensor.row]
    ]
    off, aside = normal / weight - 1, max(map(abs, level), default=0.0) / weight
    sideways = f", and {' and '.join(f'{value:.2f} N' for value in level)} sideways" if level else ""
    measured = f"{mass:g} kg reads {normal:.2f} N instead of {weight:.2f} N ({off:+.0%}){sideways}"
    if normal < 0.2 * weight and abs(off) > _MASS_TOLERANCE:
        what = "the sensor is upside down or not connected. Check its mounting and its cable."
        yield Finding("Known mass", "force", "red", f"{measured}: {what}")
    elif abs(off) > _MASS_TOLERANCE or aside > _MASS_TOLERANCE:
        what = (
            "the matrix belongs to another sensor. Check the serial number on the .cal file."
            if len(sensor.channels) > 3
            else "its scale or sensitivity is wrong. Copy it from its certificate again."
        )
        yield Finding("Known mass", "force", "red", f"{measured}: {what}")
    else:
        yield Finding("Known mass", "force", "green", f"{measured}.")


def check_gravity(rig: Rig) -> Iterator[Finding]:
    """Test that the accelerometer at rest shows gravity along its vertical axis, or nothing if AC-coupled."""
    sensor = rig.sensors.acceleration
    assert sensor is not None
    rig.operator.tell(Rest(1.0))
    volts = rig.daq.captured(sensor.channels, rig.file.rate_hz, 1.0).volts
    shown, axes = sensor.to_si(volts).mean(axis=1), ", ".join(sensor.axes)
    measured = f"At rest it reads {', '.join(f'{one:.1f}' for one in shown)} m/s² along {axes}"
    if not sensor.gravity:
        yield _without_gravity(sensor, volts, measured)
        return
    what = fault_at_rest(sensor, volts)
    if what is None:
        expected = f"upright, with {sensor.sign * _GRAVITY:.1f} expected on {sensor.axes[sensor.row]}"
        yield Finding("Gravity", "acceleration", "green", f"{measured}: {expected}.")
        return
    if float(np.abs(shown).max()) < _NOTHING:
        what += " An IEPE or charge accelerometer shows no gravity: give it high_pass_hz in the rig file."
    yield Finding("Gravity", "acceleration", "red", f"{measured}: {what}")


def _without_gravity(sensor: LinearSensor, volts: FloatArray, measured: str) -> Finding:
    """Of an accelerometer that shows no gravity: an AC-coupled one shows nothing that is constant."""
    constant = float(np.abs(volts.mean(axis=1)).max())
    if sensor.ac_coupled and constant > _COUPLED:
        what = (
            f"its channel shows a constant {constant:.1f} V, and it is AC-coupled: that is the bias of an "
            "IEPE supply. Couple the channel AC."
        )
        return Finding("Gravity", "acceleration", "red", f"{measured}: {what}")
    why = "it is AC-coupled" if sensor.ac_coupled else "its axis is not vertical"
    sentence = f"{measured}: {why}, and shows no gravity. Tap beside it to see that it follows."
    return Finding("Gravity", "acceleration", "green", sentence)


def check_clock(rig: Rig) -> Iterator[Finding]:
    """Test that two cards share one clock: both measure two presses, half a minute apart."""
    groups = cards(rig)
    names = " and ".join(groups)
    both = [channels[0] for channels in groups.values()]
    force, acceleration = rig.sensors.force, rig.sensors.acceleration
    if force is None or acceleration is None:
        rig.daq.captured(both, rig.file.rate_hz, 1.0)
        sentence = f"Not tested: {names} have no pair of sensors that both measure a press."
        yield Finding("One clock", "daq", "yellow", sentence)
        return
    rate_hz = rig.file.rate_hz
    channels = (*force.channels, *acceleration.channels)
    total = _BETWEEN_PRESSES + 2 * _PRESS
    lags = []
    with rig.daq.stream(channels, rate_hz, round(rate_hz / 2), round(total * rate_hz)) as stream:
        rig.operator.tell(Press("push", "doctor", 1, 2))
        asked, blocks = 1, []
        for block in stream:
            blocks.append(block.volts)
            if asked == 1 and block.end >= (_BETWEEN_PRESSES + _PRESS) * rate_hz:
                rig.operator.tell(Press("push", "doctor", 2, 2))
                asked = 2
    volts = np.concatenate(blocks, axis=1)
    window = round(_PRESS * rate_hz)
    for first in (0, round((_BETWEEN_PRESSES + _PRESS) * rate_hz)):
        part = volts[:, first : first + window]
        pushed = force.along(part[: len(force.channels)])
        shaken = acceleration.along(part[len(force.channels) :])
        lags.append(_lag(pushed, shaken, rate_hz))
    if any(lag is None for lag in lags):
        sentence = (
            f"Not tested: no press was measured by both {names}. Press any button on the rig when prompted."
        )
        yield Finding("One clock", "daq", "yellow", sentence)
        return
    before, after = (float(lag) for lag in lags if lag is not None)
    measured = (
        f"{names} measure one press {abs(before) * 1e3:.1f} ms apart, and another one {_BETWEEN_PRESSES:g} s "
        f"later {abs(after) * 1e3:.1f} ms apart"
    )
    if max(abs(before), abs(after)) > _APART or abs(after - before) > _DRIFTED:
        what = (
            "the cards run on clocks of their own. Check the cable between them (of NI cards: RTSI, and its "
            "entry in NI MAX)."
        )
        yield Finding("One clock", "daq", "red", f"{measured}: {what}")
    else:
        drift = _DRIFTED / _BETWEEN_PRESSES * 1e6
        yield Finding(
            "One clock", "daq", "green", f"{measured}: one clock, within {drift:.0f} parts in a million."
        )


def _lag(force: FloatArray, acceleration: FloatArray, rate_hz: float) -> float | None:
    """Delay (s) of a press in the acceleration relative to the force; None without a press."""
    low, high = _PRESS_BAND
    size = 2 * len(force)
    f = np.fft.rfftfreq(size, 1 / rate_hz)
    # A Butterworth band-pass of second order, forwards and backwards; scipy.signal takes longer to load than
    # all else that is examined.
    aside = np.divide(f**2 - low * high, f * (high - low), out=np.full(len(f), np.inf), where=f > 0)
    spectra = []
    for signal in (force, acceleration):
        band = np.fft.irfft(np.fft.rfft(signal - np.median(signal), size) / (1 + aside**4), size)
        shape = np.abs(band[: len(force)])
        if shape.max() < 8 * np.median(shape):
            return None
        spectra.append(np.fft.rfft(shape, size))
    pair = np.fft.irfft(spectra[1] * spectra[0].conj(), size)
    late = int(pair.argmax())
    return (late - size if late >= len(force) else late) / rate_hz


# Test of the camera that sees the finger: frames arrive, at the stated rate, neither dark nor too bright.

_FRAMES = 20
_BRIGHT, _DARK = 200.0, 2.0
"""Grey levels: above, a finger saturates; below, the lamps are off or the lens is covered."""


def check_camera(rig: Rig) -> Iterator[Finding]:
    """Yield findings about frames, rate and light; nobody touches the surface meanwhile."""
    camera = rig.role(Camera)
    camera.start()
    try:
        frames = [camera.read() for _ in range(_FRAMES)]
    finally:
        camera.stop()
    taken = frames[-1].number - frames[0].number
    of = frames[-1].number + 1  # numbers count from the start
    lost = of - _FRAMES
    rate_hz = taken / (frames[-1].time - frames[0].time)
    if lost:
        sentence = f"{lost} of {of} frames were lost: use a shorter cable, or another port."
        yield Finding("Frames", "camera", "yellow", sentence)
    elif abs(rate_hz / camera.rate_hz - 1) > 0.05:
        sentence = f"{rate_hz:.1f} frames/s arrive, not {camera.rate_hz:g}: change 'rate_hz' in [camera]."
        yield Finding("Frames", "camera", "red", sentence)
    else:
        yield Finding("Frames", "camera", "green", f"{rate_hz:.1f} frames/s, none lost of {_FRAMES}.")
    brightest = float(np.percentile(np.mean([frame.pixels for frame in frames], axis=0), 99))
    if brightest > _BRIGHT:
        sentence = f"The image reaches {brightest:.0f} of 255 without a finger: lower the exposure."
        yield Finding("Light", "camera", "red", sentence)
    elif brightest < _DARK:
        yield Finding("Light", "camera", "red", "The image is dark: open the lens, and switch the lamps on.")
    else:
        yield Finding(
            "Light", "camera", "green", f"The image reaches {brightest:.0f} of 255 without a finger."
        )


# Test of the streams of other programs: each is there, once, and its clock can be measured.


def check_streams(rig: Rig) -> Iterator[Finding]:
    """Yield a finding for each stream that is recorded along."""
    for name, said in rig.role(LslStreams).look().items():
        yield Finding(f"Stream {name}", "streams", "green" if isinstance(said, str) else "red", str(said))
