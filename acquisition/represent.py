"""The representative press of a button: one press that stands for every participant's."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Self

import h5py
import numpy as np
from scipy import signal
from scipy.interpolate import CubicSpline

from acquisition.averaging import WarpModel, register
from acquisition.presses import ButtonPress, find_presses
from acquisition.recording import Recording
from acquisition.scan import opened
from acquisition.store import check_target, fresh_file
from instruments import ConfigurationError, DataError
from instruments.arrays import FloatArray

__all__ = ["Representative", "Window", "high_pass", "representative"]

_FORMAT = "haploop representative"
_METHOD = (
    "presses aligned at activation, and where the contact opens again; dynamic time warping "
    "barycentre refined by smooth-warp registration, per participant and then over participants"
)


@dataclass(frozen=True)
class Window:
    """The part of a press, about its activation, that the representative holds (s)."""

    before: float = 0.15
    """A latch's first click comes 30 to 100 ms before its activation (hardware.md, section 11)."""
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
    """One press that stands for `members` presses; arrays are (samples,)."""

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
    """Presses that it does not stand for, and why."""
    method: str
    simulated: bool

    @property
    def duration(self) -> float:
        """Seconds."""
        return len(self.acceleration) / self.rate_hz

    def save(self, path: str | Path) -> None:
        """Write an HDF5 file. Raises ConfigurationError for an existing file or a bad folder."""
        path = Path(path)
        check_target(path)
        with fresh_file(path) as temporary, h5py.File(temporary, "w") as file:
            file.attrs.update({"format": _FORMAT, "format_version": 1})
            for field in fields(self):
                value: Any = getattr(self, field.name)
                if isinstance(value, np.ndarray):
                    file[field.name] = value
                elif isinstance(value, tuple):
                    file.create_dataset(
                        field.name,
                        data=np.array(value, dtype=object).reshape(
                            (-1, 2) if field.name == "sources" else -1
                        ),
                        dtype=h5py.string_dtype(),
                    )
                else:
                    file.attrs[field.name] = value

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what `save` wrote. Raises DataError."""
        path = Path(path)
        with opened(path) as file:
            if file.attrs.get("format") != _FORMAT:
                raise DataError(f"{path} is an HDF5 file, but not a representative press of haploop.")
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
    recordings: Sequence[Recording], window: Window | None = None, model: WarpModel | None = None
) -> Representative:
    """The press that stands for all presses of one button: the barycentre per participant, then over
    participants (the paper, figure 5), of the vertical acceleration; force and activation go along.

    A press with a saturated sensor, or without activation, is left out, and said so. Raises DataError
    when no press is left, ConfigurationError for recordings that do not belong together.
    """
    w = window or Window()
    first = _check_together(recordings)
    rate_hz = first.rate_hz
    left_out: list[str] = []
    usable: list[tuple[Recording, list[tuple[ButtonPress, float]]]] = []
    for recording in recordings:
        usable.append((recording, _usable(recording, left_out)))
    every = [press for _, presses in usable for press in presses]
    if not every:
        raise DataError(
            f"No press of the {first.button} button can be used ({'; '.join(left_out) or 'none was found'})."
        )
    openings = [p.opened - at for p, at in every if p.opened is not None]
    opening = float(np.median(openings)) if openings else 0.0
    after = max(w.after, opening / rate_hz + w.ring)
    before, after = round(w.before * rate_hz), round(min(after, w.longest) * rate_hz)
    curves: dict[str, list[FloatArray]] = defaultdict(list)
    for recording, presses in usable:
        curves[recording.participant] += _cut(recording, presses, before, after, opening, w.high_pass_hz)

    means, members = [], []
    for participant in sorted(curves):
        if not curves[participant]:
            continue
        own = register(np.array(curves[participant]), rate_hz, model)
        means.append(own.template)
        members.append(own.aligned[:, 0])
    whole = register(np.array(means), rate_hz, model)
    # Each press's own warp, and on top of it its participant's.
    times = np.arange(before + after)
    warped = np.concatenate(
        [
            CubicSpline(times, presses, axis=-1)(np.clip(times + shift, 0, times[-1]))
            for presses, shift in zip(members, whole.shifts, strict=True)
        ]
    )
    acceleration, force, activation = whole.template
    return Representative(
        button=first.button,
        rate_hz=rate_hz,
        acceleration=acceleration * _taper(len(times), round(w.taper * rate_hz)),
        force=force,
        activation=np.clip(activation, 0.0, 1.0),
        activation_index=before,
        members=len(warped),
        spread=np.asarray(np.std(warped, axis=0)),
        bandwidth_hz=_bandwidth(first),
        sources=tuple((r.path.name, r.content_hash) for r in recordings),
        left_out=tuple(left_out),
        method=_METHOD,
        simulated=any(r.simulated for r in recordings),
    )


def _check_together(recordings: Sequence[Recording]) -> Recording:
    """The first recording. Raises ConfigurationError unless all are of one button and one rate."""
    if not recordings:
        raise ConfigurationError("A representative press needs at least one recording.")
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
                    f"{first.path.name} and {other.path.name} do not belong together: "
                    f"{what} is {mine} in one and {theirs} in the other."
                )
    if len({r.content_hash for r in recordings}) < len(recordings):
        raise ConfigurationError("The same recording was given twice; give each once.")
    return first


def _usable(recording: Recording, left_out: list[str]) -> list[tuple[ButtonPress, float]]:
    """Presses with their activation instants (samples); the others are added to `left_out`."""
    good = []
    for number, press in enumerate(find_presses(recording), start=1):
        if press.saturated:
            left_out.append(f"{recording.participant}, press {number}: a sensor was saturated")
        elif press.activation is None:
            left_out.append(f"{recording.participant}, press {number}: the contact did not change")
        else:
            good.append((press, press.activation))
    return good


def _cut(
    recording: Recording,
    presses: list[tuple[ButtonPress, float]],
    before: int,
    after: int,
    opening: float,
    high_pass_hz: float,
) -> list[FloatArray]:
    """(3, samples) of each press: acceleration, force, activation, on one clock about its activation.

    A press whose contact opens again does so `opening` samples later in all of them.
    """
    rate_hz = recording.rate_hz
    rows = (
        (high_pass(recording.acceleration[2], rate_hz, high_pass_hz), recording.delay("acceleration")),
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
        raise DataError(f"{recording.path} has no acceleration sensor.")
    return sensor.bandwidth_hz
