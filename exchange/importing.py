"""A press that was recorded elsewhere, as a representative press; a response, as a calibration's."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from fractions import Fraction
from pathlib import Path

import numpy as np
import scipy

from ..acquisition import Representative, Window, file_name, high_pass
from ..calibration import Response, read_uff
from ..instruments import ConfigurationError, DataError, RigFile
from ..instruments.arrays import FloatArray
from . import csv_file, mat_file, sep005_file, uff_file, wav_file
from .views import Channel, Signals

__all__ = ["READERS", "import_press", "import_response", "is_response_file"]

READERS: Mapping[str, Callable[[Path, float | None], Signals]] = {
    "wav": wav_file.read_signals,
    "csv": csv_file.read_signals,
    "mat": mat_file.read_signals,
    "uff": uff_file.read_signals,
    "sep005": sep005_file.read_signals,
}
"""Functions that read signals, by format: the names that `export_file` has for them."""
_SUFFIXES = {
    ".wav": "wav", ".csv": "csv", ".tsv": "csv", ".txt": "csv", ".mat": "mat", ".uff": "uff", ".unv": "uff",
    ".sep005": "sep005", ".json": "sep005",
}  # fmt: skip
"""Format by the end of a file's name, where nobody states it."""
RATE_HZ = 5000.0
"""Samples per second of an imported press: the paper's, of which the drives' rate is a multiple."""
_ACCELERATIONS = {
    "m/s^2": 1.0, "m/s2": 1.0, "m/s²": 1.0, "m/s**2": 1.0, "m s-2": 1.0, "mm/s^2": 1e-3, "g": 9.80665,
}  # fmt: skip
"""m/s^2 per unit."""
_LONGEST = Window().longest
_MOST = 1e6
"""m/s^2: ten times what the hardest shock sensors take."""
_BOUNCE = 0.01
"""s: a contact that closes again within this time bounced."""
_SHORTEST = 0.01
"""s: a fifth of the shortest press."""
_SLOWEST, _FASTEST = 100.0, 1e8
"""Samples per second of a file: a press of half a second has fifty, and the fastest cards take 10^7."""


def is_response_file(path: str | Path, format: str | None = None) -> bool:
    """True for a UFF file of frequency responses; False for signals. `format` as for `import_press`.

    Raises ConfigurationError for an unknown format, DataError for a damaged file.
    """
    path = Path(path)
    return _format(path, format) == "uff" and uff_file.has_responses(path)


def import_press(
    path: str | Path,
    button: str | None = None,
    *,
    format: str | None = None,
    channel: str | None = None,
    scale: float | None = None,
    rate_hz: float | None = None,
    activation: float | None = None,
) -> Representative:
    """Make a representative press of a signal that another program recorded.

    `format` is one of `READERS`, by default what the file's name ends in. `button` is the name of the button
    that was pressed, by default as the file states, or "imported". `channel` names the acceleration; without
    it, the only channel in a unit of acceleration, or the only channel. `scale` is m/s^2 per unit of the
    file, and `rate_hz` its sample rate, for a file that does not state them. `activation` is the time (s) at
    which the button switched, by default as the file states, where a channel called activation rises, or the
    time of the largest acceleration. Of a file longer than a second the representative's window about the
    activation is taken. The press is resampled to 5000 samples/s, high-passed and tapered as any other.

    Raises ConfigurationError for a missing or wrong choice, DataError for a file that cannot be read.
    """
    path = Path(path)
    read = READERS[_format(path, format)]
    if not path.is_file():
        raise DataError(f"There is no file {path}: check the name.")
    if scale is not None and not (np.isfinite(scale) and scale):
        raise ConfigurationError(f"--scale is {scale:g}: state how many m/s^2 one unit of {path.name} is.")
    with np.errstate(all="ignore"):  # what is not finite is refused below, and not warned of
        signals = read(path, rate_hz)
    if button is None:
        button = str(signals.about.get("button", "imported"))
    file_name("P01", button)
    taken = _acceleration(path, signals, channel, scale)
    if not _SLOWEST <= signals.rate_hz <= _FASTEST:
        raise ConfigurationError(
            f"{path} would have {signals.rate_hz:g} samples/s: from {_SLOWEST:g} to {_FASTEST:g} are "
            "possible, so look at its time or at --rate."
        )
    with np.errstate(all="ignore"):
        values = _per_unit(path, taken, scale) * taken.values
    if not len(values) or not np.all(np.isfinite(values)) or not np.ptp(values):
        raise DataError(f"The channel {taken.name!r} of {path} is empty, constant, or not finite.")
    if (duration := len(values) / signals.rate_hz) < _SHORTEST:
        raise ConfigurationError(
            f"{path} lasts {1e3 * duration:.3g} ms, which is no press: look at the unit of its time, or at "
            "--rate."
        )
    if (largest := float(np.abs(values).max())) > _MOST:
        raise ConfigurationError(
            f"The channel {taken.name!r} of {path} would reach {largest:g} m/s^2: look at its unit, or at "
            "--scale."
        )
    cut, switched, after = _window(path, signals, values, activation)
    acceleration = _taper(high_pass(_resampled(values[cut], signals.rate_hz), RATE_HZ))
    length = len(acceleration)
    force = _beside(signals, ("force",), "N", cut, length)
    return Representative(
        button=button,
        rate_hz=RATE_HZ,
        acceleration=acceleration,
        force=force,
        activation=np.asarray(np.arange(length) >= switched, dtype=np.float64),
        activation_index=min(switched, length - 1),
        members=1,
        spread=np.zeros(length),
        bandwidth_hz=min(signals.rate_hz / 2, RATE_HZ / 2, _number(path, signals, "bandwidth_hz") or np.inf),
        sources=((path.name, hashlib.sha256(path.read_bytes()).hexdigest()),),
        left_out=(),
        method="imported",
        simulated=bool(signals.about.get("simulated", False)),
        reason=f"from the channel {taken.name} of {path.name}, {after}",
        parameters={"import": {"rate_hz": signals.rate_hz, "scale": _per_unit(path, taken, scale)}},
    )


def import_response(
    path: str | Path, rig: RigFile, patch: str | None = None, point: str | None = None
) -> Response:
    """The response in a UFF file; of several, the one of `patch` and `point`.

    A file with one response of another name gets these names. Raises ConfigurationError for a choice that
    is not in the file, DataError for a file that cannot be read.
    """
    found = read_uff(path, rig=rig)
    wanted = [r for r in found if patch in (None, r.patch) and point in (None, r.point)]
    if len(found) == 1 and not wanted:
        wanted = list(read_uff(path, rig=rig, patch=patch, point=point))
    if len(wanted) != 1:
        places = ", ".join(f"{r.patch} at {r.point}" for r in found)
        raise ConfigurationError(
            f"{path} holds {len(wanted) or 'no'} matching responses (it has {places}): "
            "select one with --patch and --point."
        )
    return wanted[0]


def _format(path: Path, format: str | None) -> str:
    if path.is_dir():
        raise ConfigurationError(f"{path} is a folder: name a file in it.")
    found = _SUFFIXES.get(path.suffix.lower(), "") if format is None else format
    if found not in READERS:
        problem = (
            f"has an unknown file type {path.suffix!r}" if format is None else f"cannot be read as {format!r}"
        )
        raise ConfigurationError(
            f"{path} {problem}: haploop imports {', '.join(_SUFFIXES)}, and files of other names as one of "
            f"{', '.join(READERS)} (--from)."
        )
    return found


def _acceleration(path: Path, signals: Signals, name: str | None, scale: float | None) -> Channel:
    names = [channel.name for channel in signals.channels]
    if name is not None:
        if name not in names:
            raise ConfigurationError(f"{path} has no channel {name!r}, only {', '.join(names)}.")
        return signals[name]
    likely = [c for c in signals.channels if c.unit in _ACCELERATIONS]
    for candidates in (likely, [c for c in likely if c.name in ("acceleration", "acceleration_z")]):
        if len(candidates) == 1:
            return candidates[0]
    if len(names) == 1:
        return signals.channels[0]
    raise ConfigurationError(
        f"{path} has the channels {', '.join(names)}: name the vertical acceleration (--channel)."
    )


def _per_unit(path: Path, channel: Channel, scale: float | None) -> float:
    if scale is not None:
        return scale
    if channel.unit not in _ACCELERATIONS:
        raise ConfigurationError(
            f"The channel {channel.name!r} of {path} is in {channel.unit or 'no stated unit'!r}: state how "
            "many m/s^2 one of it is (--scale)."
        )
    return _ACCELERATIONS[channel.unit]


def _window(
    path: Path, signals: Signals, values: FloatArray, activation: float | None
) -> tuple[slice, int, str]:
    """Samples to take, the activation's index among those at `RATE_HZ`, and a clause on both."""
    rate_hz, window = signals.rate_hz, Window()
    stated = _number(path, signals, "activation_s")
    if activation is not None:
        at, how = activation, "activated where the operator said"
    elif stated is not None:
        at, how = stated, "activated where the file says"
    else:
        largest = int(np.argmax(np.abs(values - np.median(values))))
        rise = _rise(signals, largest)
        at = (largest if rise is None else rise) / rate_hz
        how = f"activated {'at its largest acceleration' if rise is None else 'where its contact closed'}"
    if not 0 <= at <= len(values) / rate_hz:
        raise ConfigurationError(
            f"{path} lasts {len(values) / rate_hz:.3f} s, so the button cannot have switched at {at:g} s."
        )
    start, stop = 0, len(values)
    if len(values) > _LONGEST * rate_hz:
        start = max(0, round((at - window.before) * rate_hz))
        stop = min(len(values), round((at + window.after) * rate_hz))
    return slice(start, stop), round((at - start / rate_hz) * RATE_HZ), how


def _rise(signals: Signals, near: int) -> int | None:
    """Sample at which a channel called activation rises, nearest to `near`; None where it does not."""
    found = next((c.values for c in signals.channels if c.name == "activation"), None)
    if found is None or not np.all(np.isfinite(found)):
        return None
    closed = found >= (found.min() + found.max()) / 2
    rises = np.flatnonzero(closed[1:] & ~closed[:-1]) + 1
    if not len(rises):
        return None
    nearest = rises[np.argmin(np.abs(rises - near))]
    # A contact bounces: its first touch counts, as in a recording.
    return int(rises[rises >= nearest - _BOUNCE * signals.rate_hz][0])


def _number(path: Path, signals: Signals, name: str) -> float | None:
    """What the file says about itself; None when it does not. Raises DataError for anything but a number."""
    said = signals.about.get(name)
    if said is None:
        return None
    if not isinstance(said, int | float) or not 0 <= said < np.inf:
        raise DataError(f"{path} gives {name} as {str(said)[:40]!r}, which is not a number of zero or more.")
    return float(said)


def _beside(signals: Signals, names: tuple[str, ...], unit: str, cut: slice, length: int) -> FloatArray:
    """(length,) of a further channel in its unit, or zeros."""
    found = next((c for c in signals.channels if c.name in names and c.unit == unit), None)
    if found is None:
        return np.zeros(length)
    values = _resampled(found.values[cut], signals.rate_hz)[:length]
    return np.pad(values, (0, length - len(values)))


def _resampled(values: FloatArray, rate_hz: float) -> FloatArray:
    ratio = Fraction(RATE_HZ / rate_hz).limit_denominator(100_000)
    if ratio == 1:
        return values
    # Its low-pass starts from zero: an offset (gravity) would ring at both ends.
    middle = np.median(values)
    return np.asarray(
        scipy.signal.resample_poly(values - middle, ratio.numerator, ratio.denominator) + middle
    )


def _taper(values: FloatArray) -> FloatArray:
    share = min(1.0, 2 * Window().taper * RATE_HZ / len(values))
    return np.asarray(values * scipy.signal.windows.tukey(len(values), share))
