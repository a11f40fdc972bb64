"""The representative press of a button: one press that stands for every participant's."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, Self

import h5py
import numpy as np
from scipy import fft, signal
from scipy.interpolate import CubicSpline

from haploop.acquisition.presses.averaging import average
from haploop.acquisition.presses.protocol import Protocol
from haploop.acquisition.presses.quality import accepted_presses
from haploop.acquisition.presses.registration import WarpModel
from haploop.acquisition.presses.segmentation import ButtonPress, Segmentation, find_presses, segmentation_for
from haploop.acquisition.recording import Recording, check_destination, fresh_file, opened
from haploop.instruments import ConfigurationError, DataError
from haploop.instruments.arrays import ComplexArray, FloatArray

__all__ = ["Representative", "Window", "high_pass", "representative"]

_FORMAT = "haploop representative"
_VERSION = 2
_RIPPLE = 1e-4
"""What is added to the power response that is divided by: nothing is raised more than fiftyfold, and what
is raised tenfold comes out 1 % low."""


@dataclass(frozen=True)
class Window:
    """The part of a press, about its activation, that the representative holds (s)."""

    before: float = 0.15
    """A latch's first click comes 30 to 100 ms before its activation (docs/hardware.md, "Buttons and
    people")."""
    after: float = 0.35
    """At least; a momentary button whose contact opens later gets `ring` more than that."""
    ring: float = 0.1
    longest: float = 1.0
    taper: float = 0.03
    """Of the acceleration at both ends, so that it begins and ends at zero."""
    high_pass_hz: float = 10.0
    """The paper's, against gravity, drift and the hand's own motion."""


@dataclass(frozen=True, eq=False)
class Representative:
    """The representative press of `members` presses; arrays are (samples,)."""

    button: str
    rate_hz: float
    acceleration: FloatArray
    """m/s^2, vertical, high-passed, zero at both ends."""
    force: FloatArray
    """N."""
    activation: FloatArray
    """0 before the contact changed, 1 after; between where the presses differ."""
    activation_index: int
    members: int
    spread: FloatArray
    """m/s^2: standard deviation of the aligned presses' accelerations."""
    bandwidth_hz: float
    """The accelerometer's pole: what is above it is weaker here than it was at the cap."""
    sources: tuple[tuple[str, str], ...]
    """(file name, content hash) of each recording."""
    left_out: tuple[str, ...]
    """Presses that were left out, and why."""
    method: str
    """Which of the methods of `haploop.acquisition.presses.averaging` made it."""
    simulated: bool
    scores: Mapping[str, float] = field(default_factory=dict)
    """Relative residual of each method on held-out presses (`averaging.average`); smaller is better."""
    parameters: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """What it was derived with: window, warps, and the segmentation of each recording (by file name)."""
    undone_hz: tuple[float, float] | None = None
    """The band in which the accelerometer's low-pass was undone; None where it was left as it is."""
    noise_gain: float = 1.0
    """How many times as strong (rms) that made a noise that was white up to half the sample rate."""

    @property
    def duration(self) -> float:
        """Seconds."""
        return len(self.acceleration) / self.rate_hz

    def save(self, path: str | Path) -> None:
        """Write an HDF5 file. Raises ConfigurationError for an existing file or a bad folder."""
        path = Path(path)
        check_destination(path)
        with fresh_file(path) as temporary, h5py.File(temporary, "w") as file:
            file.attrs.update({"format": _FORMAT, "format_version": _VERSION})
            for each in fields(self):
                value: Any = getattr(self, each.name)
                if isinstance(value, np.ndarray):
                    file[each.name] = value
                elif each.name in ("sources", "left_out"):
                    shape = (-1, 2) if each.name == "sources" else (-1,)
                    texts = np.array(value, dtype=object).reshape(shape)
                    file.create_dataset(each.name, data=texts, dtype=h5py.string_dtype())
                elif isinstance(value, Mapping):
                    file.create_dataset(each.name, data=json.dumps(value), dtype=h5py.string_dtype())
                elif value is not None:
                    file.attrs[each.name] = value

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what `save` wrote. Raises DataError."""
        path = Path(path)
        with opened(path) as file:
            if file.attrs.get("format") != _FORMAT:
                raise DataError(f"{path} is an HDF5 file, but not a haploop representative press.")
            if file.attrs["format_version"] != _VERSION:
                raise DataError(
                    f"{path} has representative-press format {file.attrs['format_version']}, but this "
                    f"haploop reads format {_VERSION}: compute it again from its recordings."
                )
            a = file.attrs
            return cls(
                button=str(a["button"]),
                rate_hz=float(a["rate_hz"]),
                acceleration=file["acceleration"][:],
                force=file["force"][:],
                activation=file["activation"][:],
                activation_index=int(a["activation_index"]),
                members=int(a["members"]),
                spread=file["spread"][:],
                bandwidth_hz=float(a["bandwidth_hz"]),
                sources=tuple((str(name), str(known)) for name, known in file["sources"].asstr()[:]),
                left_out=tuple(str(text) for text in file["left_out"].asstr()[:]),
                method=str(a["method"]),
                simulated=bool(a["simulated"]),
                scores=json.loads(file["scores"][()]),
                parameters=json.loads(file["parameters"][()]),
                undone_hz=(float(a["undone_hz"][0]), float(a["undone_hz"][1])) if "undone_hz" in a else None,
                noise_gain=float(a["noise_gain"]),
            )


def high_pass(acceleration: FloatArray, rate_hz: float, cutoff_hz: float = 10.0) -> FloatArray:
    """(..., samples) without what is below `cutoff_hz`, with zero phase.

    A second-order Butterworth filter forwards and backwards, so -6 dB at the cut-off; the signal is
    continued by half a second at both ends, without which 2 % of it stays there (measured).
    """
    sections = signal.butter(2, cutoff_hz, "highpass", fs=rate_hz, output="sos")
    samples = acceleration.shape[-1]
    if samples < 2:
        raise DataError(f"A signal of {samples} samples cannot be filtered.")
    return np.asarray(
        signal.sosfiltfilt(
            sections, acceleration, axis=-1, padlen=min(samples - 1, int(np.ceil(rate_hz / 2)))
        )
    )


def representative(
    recordings: Sequence[Recording],
    window: Window | None = None,
    model: WarpModel | None = None,
    undo_low_pass: tuple[float, float] | None = None,
) -> Representative:
    """The representative press of one button: per participant, then over participants (the paper,
    figure 5). The vertical acceleration decides; force and activation are averaged with it.

    Presses are aligned at the activation, and where the contact opens again. Two methods then bring them
    to one time, the paper's dynamic time warping barycentre and a registration by smooth warps; the
    result is that of the method with the smaller residual on held-out presses
    (`haploop.acquisition.presses.averaging.average`), and holds both scores.

    `undo_low_pass` is a band in Hz in which the response that the rig file states of the accelerometer
    is divided out, gain and delay: a stock GY-61 passes 50 Hz, and shows a fifth of a click at 263.5 Hz.
    Outside the band it is left as it is, a third of an octave away. Noise grows with it: `noise_gain`.

    Presses that were rejected, saturated a sensor, did not activate the button, or differ from the
    participant's other presses are left out and listed. Raises DataError when no press is left,
    ConfigurationError for recordings that cannot be combined, or an invalid band.
    """
    w, m = window or Window(), model or WarpModel()
    first = _check_together(recordings)
    rate_hz = first.rate_hz
    if undo_low_pass is not None and not 0 < undo_low_pass[0] < undo_low_pass[1] < rate_hz / 2:
        raise ConfigurationError(
            f"undo_low_pass is {undo_low_pass[0]:g} to {undo_low_pass[1]:g} Hz: use a band within 0 to "
            f"{rate_hz / 2:g} Hz, its lower edge first."
        )
    left_out: list[str] = []
    segmentations = {recording.path.name: _segmentation(recording) for recording in recordings}
    usable = [(r, _usable(r, segmentations[r.path.name], left_out)) for r in recordings]
    every = [press for _, presses in usable for press in presses]
    if not every:
        raise DataError(
            f"The recordings hold no usable press of the {first.button} button "
            f"({'; '.join(left_out) or 'none was found'}): record more presses."
        )
    openings = [p.opened - at for p, at in every if p.opened is not None]
    opening = float(np.median(openings)) if openings else 0.0
    after = max(w.after, opening / rate_hz + w.ring)
    before, after = round(w.before * rate_hz), round(min(after, w.longest) * rate_hz)
    curves: dict[str, list[FloatArray]] = defaultdict(list)
    names: dict[str, list[str]] = defaultdict(list)
    for recording, presses in usable:
        if presses:
            vertical = recording.acceleration[2]
            if undo_low_pass is not None:
                vertical = _undone(recording, vertical, undo_low_pass)
            vertical = high_pass(vertical, rate_hz, w.high_pass_hz)
            curves[recording.participant] += _cut(recording, vertical, presses, before, after, opening)
            names[recording.participant] += [f"press at {at / rate_hz:.2f} s" for _, at in presses]

    found = average([np.array(curves[participant]) for participant in sorted(curves)], rate_hz, m)
    for participant, kept in zip(sorted(curves), found.kept, strict=True):
        odd = [name for name, alike in zip(names[participant], kept, strict=True) if not alike]
        left_out += [f"{participant}, {name}: it differs from this participant's others" for name in odd]
    acceleration, force, activation = found.template
    return Representative(
        button=first.button,
        rate_hz=rate_hz,
        acceleration=acceleration * _taper(before + after, round(w.taper * rate_hz)),
        force=force,
        activation=np.clip(activation, 0.0, 1.0),
        activation_index=int(np.argmax(activation > 0.5)),
        members=len(found.aligned),
        spread=np.asarray(np.std(found.aligned, axis=0)),
        bandwidth_hz=_bandwidth(first),
        sources=tuple((r.path.name, r.content_hash) for r in recordings),
        left_out=tuple(left_out),
        method=found.method,
        simulated=any(r.simulated for r in recordings),
        scores=found.scores,
        parameters={"window": asdict(w), "warps": asdict(m)}
        | {name: asdict(segmentation) for name, segmentation in segmentations.items()},
        undone_hz=undo_low_pass,
        noise_gain=1.0 if undo_low_pass is None else _noise_gain(first, undo_low_pass),
    )


def _check_together(recordings: Sequence[Recording]) -> Recording:
    """The first recording. Raises ConfigurationError unless all are of one button and one rate."""
    if not recordings:
        raise ConfigurationError("A representative press needs at least one recording: name one.")
    first = recordings[0]
    for other in recordings[1:]:
        for what, mine, theirs in (
            ("the button", first.button, other.button),
            ("the sample rate", first.rate_hz, other.rate_hz),
            ("the accelerometer's bandwidth", _bandwidth(first), _bandwidth(other)),
            ("simulated", first.simulated, other.simulated),
        ):
            if mine != theirs:
                raise ConfigurationError(
                    f"{first.path.name} and {other.path.name} cannot be combined: "
                    f"{what} is {mine} in one and {theirs} in the other."
                )
    if len({r.content_hash for r in recordings}) < len(recordings):
        raise ConfigurationError("The same recording is given twice: give each recording once.")
    return first


def _segmentation(recording: Recording) -> Segmentation:
    """The parameters that presses were found with while recording, or else the button's."""
    protocol = Protocol.from_json(recording.header.protocol)
    return protocol.segmentation if protocol else segmentation_for(recording.button)


def _usable(
    recording: Recording, segmentation: Segmentation, left_out: list[str]
) -> list[tuple[ButtonPress, float]]:
    """Presses with their activation instants (samples); the others are added to `left_out`."""
    good = []
    accepted = accepted_presses(recording, find_presses(recording, segmentation))
    left_out += [
        f"{recording.participant}, press {bad.number}, attempt {bad.attempt}: {bad.reason}"
        for bad in recording.verdicts
        if not bad.accepted
    ]
    for number, press in enumerate(accepted, start=1):
        if press.saturated:
            left_out.append(f"{recording.participant}, press {number}: a sensor was saturated")
        elif press.activation is None:
            left_out.append(f"{recording.participant}, press {number}: the contact did not change")
        else:
            good.append((press, press.activation))
    return good


def _restoring(recording: Recording, band: tuple[float, float], frequencies: FloatArray) -> ComplexArray:
    """What the spectrum of an acceleration is multiplied by, to undo the sensor's low-pass in a band."""
    sensor = recording.sensors.acceleration
    assert sensor is not None
    response = sensor.response(frequencies)
    inverse = np.conj(response) / (np.abs(response) ** 2 + _RIPPLE)
    octaves = np.log2(np.maximum(frequencies, 1e-9))
    outside = np.maximum(np.log2(band[0]) - octaves, octaves - np.log2(band[1]))
    share = np.cos(np.pi / 2 * np.clip(3 * outside, 0, 1)) ** 2
    return np.asarray(1 + share * (inverse - 1))


def _undone(recording: Recording, acceleration: FloatArray, band: tuple[float, float]) -> FloatArray:
    """An acceleration (samples,) as it was before the sensor's low-pass, within a band."""
    # A filter by Fourier transform is circular: a second of what it begins and ends as keeps that away.
    pad = round(recording.rate_hz)
    padded = np.pad(acceleration, pad, mode="edge")
    length = fft.next_fast_len(len(padded), real=True)
    frequencies = np.asarray(fft.rfftfreq(length, 1 / recording.rate_hz))
    spectrum = fft.rfft(padded, length) * _restoring(recording, band, frequencies)
    return np.asarray(fft.irfft(spectrum, length)[pad : pad + len(acceleration)])


def _noise_gain(recording: Recording, band: tuple[float, float]) -> float:
    """See `Representative.noise_gain`."""
    frequencies = np.linspace(0, recording.rate_hz / 2, 5001)
    return float(np.sqrt(np.mean(np.abs(_restoring(recording, band, frequencies)) ** 2)))


def _cut(
    recording: Recording,
    vertical: FloatArray,
    presses: list[tuple[ButtonPress, float]],
    before: int,
    after: int,
    opening: float,
) -> list[FloatArray]:
    """(3, samples) of each press: acceleration, force, activation, on one clock about its activation.

    A press whose contact opens again does so `opening` samples later in all of them.
    """
    rate_hz = recording.rate_hz
    rows = (
        (vertical, recording.delay("acceleration")),
        (recording.force, recording.delay("force")),
    )
    lags = np.arange(-before, after, dtype=np.float64)
    curves = []
    for press, at in presses:
        late = 0.0 if press.opened is None else press.opened - at - opening
        instants = at + lags + _stretch(lags, late, opening)
        curve = [_sampled(row, instants - delay * rate_hz) for row, delay in rows]
        curve[1] = curve[1] - np.mean(recording.force[press.start : max(press.start + 1, press.onset)])
        closed = np.where(lags < 0, 0.0, 1.0)
        if press.opened is not None:
            closed[instants >= press.opened] = 0.0
        curves.append(np.array([*curve, closed]))
    return curves


def _stretch(lags: FloatArray, late: float, opening: float) -> FloatArray:
    """What to add to lags (samples), so that what comes `late` behind `opening` comes at it.

    Fingers hold a button for as long as they like, which is more than a warp should follow. Time is
    stretched between the two clicks only, so neither changes its pitch.
    """
    if opening <= 0:
        return np.zeros(len(lags))
    x = np.clip((lags / opening - 0.25) / 0.6, 0.0, 1.0)
    # The steepest slope is 15/8 of the mean one, and time must not run backwards.
    most = 0.8 * 0.6 * opening * 8 / 15
    return float(np.clip(late, -most, most)) * x**3 * (10 - 15 * x + 6 * x**2)


def _sampled(row: FloatArray, instants: FloatArray) -> FloatArray:
    """A signal at instants (samples), between its samples; beyond its ends it stays as it ends."""
    low = max(0, int(instants[0]) - 8)
    high = min(len(row), int(instants[-1]) + 9)
    part = CubicSpline(np.arange(low, high), row[low:high])
    return np.asarray(part(np.clip(instants, low, high - 1)))


def _taper(samples: int, length: int) -> FloatArray:
    """(samples,): 1, and half a cosine to zero at both ends."""
    edge = 0.5 - 0.5 * np.cos(np.pi * np.arange(length) / length)
    return np.concatenate([edge, np.ones(samples - 2 * length), edge[::-1]])


def _bandwidth(recording: Recording) -> float:
    sensor = recording.sensors.acceleration
    if sensor is None:
        raise DataError(f"{recording.path} was recorded without an acceleration sensor.")
    return sensor.bandwidth_hz
