"""WAV: the signals as they are in 32-bit floats, or the main one at 48 kHz for a sound card.

WAV has no units: a sidecar (`OUT.wav.json`) keeps them, and the scale. When it began is stated by a broadcast
chunk (`bext`, EBU Tech 3285), as field recorders write it.
"""

from __future__ import annotations

import os
import re
import struct
import warnings
from fractions import Fraction
from pathlib import Path

import numpy as np
import scipy

from ..base.errors import DataError
from ..base.files import new_file
from .views import Channel, Signals, read_sidecar, sidecar, write_sidecar

_BEXT = struct.Struct("<320x10s8sQ")
"""Date, time, and number of the first sample, after what the recording is of."""
_SOUND_CARD_HZ = 48_000
_FULL_SCALE = 32_767
_HEADROOM = 0.89
"""Peak of a sound card's file over full scale (-1 dB), so that a player's own filter does not clip."""


def write_float(signals: Signals, path: Path) -> None:
    """All channels at their own rate, in their own units. Raises DataError for a fractional rate."""
    if signals.rate_hz != round(signals.rate_hz):
        raise DataError(
            f"A WAV file has a whole number of samples/s, and these are {signals.rate_hz:g}: export wav48."
        )
    values = np.stack([c.values for c in signals.channels], axis=1).astype(np.float32)
    write_sidecar(path, signals, unit_per_count=[1.0] * len(signals.channels))
    with new_file(path) as part:
        scipy.io.wavfile.write(part, round(signals.rate_hz), values)


def write_sound_card(signals: Signals, path: Path) -> None:
    """The main channel, resampled to 48 kHz, 16-bit PCM, its peak at -1 dB of full scale."""
    main = signals[signals.main]
    ratio = Fraction(_SOUND_CARD_HZ / signals.rate_hz).limit_denominator(10_000)
    values = scipy.signal.resample_poly(main.values, ratio.numerator, ratio.denominator)
    peak = float(np.abs(values).max()) or 1.0
    unit_per_count = peak / (_HEADROOM * _FULL_SCALE)
    counts = np.rint(values / unit_per_count).astype(np.int16)
    one = Signals(signals.title, _SOUND_CARD_HZ, (main,), main.name, signals.about)
    write_sidecar(path, one, unit_per_count=[unit_per_count])
    with new_file(path) as part:
        scipy.io.wavfile.write(part, _SOUND_CARD_HZ, counts)


def read_signals(path: Path, rate_hz: float | None) -> Signals:
    """Read a WAV file; integers become counts over full scale, unless a sidecar gives their unit.

    `rate_hz` is not needed. Raises DataError.
    """
    try:
        with warnings.catch_warnings():
            # Chunks that scipy does not know.
            warnings.simplefilter("ignore", scipy.io.wavfile.WavFileWarning)
            rate, values = scipy.io.wavfile.read(path)
        if not rate:
            raise ValueError("its sample rate is 0")
    except (ValueError, EOFError, struct.error) as error:
        raise DataError(f"{path} is no WAV file that can be read ({error}).") from None
    except (ArithmeticError, LookupError, MemoryError, NameError, TypeError):
        # What scipy's reader makes of a header that contradicts itself.
        raise DataError(f"{path} is no WAV file that can be read: its header contradicts itself.") from None
    values = np.asarray(values)
    values = values[:, None] if values.ndim == 1 else values
    beside = read_sidecar(path)
    labels = beside.get("channels", [])
    if "channels" in beside:
        scales = beside.get("unit_per_count", [1.0] * values.shape[1])
        if not (
            isinstance(labels, list)
            and isinstance(scales, list)
            and len(labels) == len(scales) == values.shape[1]
            and all(isinstance(label, dict) and {"name", "unit"} <= label.keys() for label in labels)
            and all(isinstance(scale, int | float) for scale in scales)
        ):
            raise DataError(
                f"{sidecar(path)} does not name each of the {values.shape[1]} channels of {path.name} with "
                "unit and scale: move it away, or export the file again."
            )
    else:
        labels = [{"name": f"channel {n + 1}", "unit": ""} for n in range(values.shape[1])]
        # 8-bit WAV is the only unsigned kind: its middle is 128.
        middle = 128.0 if values.dtype == np.uint8 else 0.0
        full = {"u": 128.0, "i": -float(np.iinfo(values.dtype).min)} if values.dtype.kind in "ui" else {}
        values, scales = values - middle, [1 / full.get(values.dtype.kind, 1.0)] * len(labels)
    channels = tuple(
        Channel(str(label["name"]), str(label["unit"]), scale * column.astype(np.float64))
        for label, scale, column in zip(labels, scales, values.T, strict=True)
    )
    about = dict(beside.get("about", {}))
    if "start_timestamp" not in about and (start := _broadcast_start(path, rate)):
        about["start_timestamp"] = start
    return Signals(path.stem, float(rate), channels, channels[0].name, about)


def _broadcast_start(path: Path, rate: int) -> str:
    """Date and time of the first sample, in the recorder's own time zone; empty where none is stated."""
    with path.open("rb") as file:
        file.seek(12)
        said = b""
        while not said and len(head := file.read(8)) == 8:
            name, size = struct.unpack("<4sI", head)
            if name == b"bext":
                said = file.read(_BEXT.size)
            file.seek(size + size % 2, os.SEEK_CUR)
    if len(said) < _BEXT.size:
        return ""
    day, clock, samples = _BEXT.unpack(said)
    found = [re.fullmatch(rb"(\d+)[-_:. ](\d+)[-_:. ](\d+)", text) for text in (day, clock)]
    if None in found:
        return ""
    date, (hours, minutes, seconds) = (tuple(map(int, one.groups())) for one in found if one)
    # The sample that it begins with is counted from midnight, unless the recorder counts from elsewhere.
    finer = samples / rate - 3600 * hours - 60 * minutes
    finer = finer if 0 <= finer - seconds < 1 else float(seconds)
    return f"{date[0]:04}-{date[1]:02}-{date[2]:02} {hours:02}:{minutes:02}:{finer:09.6f}"
