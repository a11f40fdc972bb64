"""Sound cards through PortAudio (optional: sounddevice): what their player and their DAQ share.

A card's volume is the operating system's, which cannot be read here (docs/hardware.md, "Sound card"): volts
at full scale are declared, from a loop-back calibration, and a person confirms that the volume is still the
same.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from ..base.arrays import ComplexArray, FloatArray
from ..base.errors import ConfigurationError, InstrumentError, LimitError
from ..base.extras import optional

LEAD = 0.05
"""Silence before a waveform (s), in which a sleeping card unmutes (estimate)."""
_MEAN = 0.01
"""Largest mean over the peak: an AC-coupled output removes the mean, as a slow sag."""


class AudioStream(Protocol):
    """The used part of a stream of `sounddevice`."""

    @property
    def active(self) -> bool:
        """True while it calls back for samples."""

    def start(self) -> object:
        """Start calling back for samples."""

    def close(self, ignore_errors: bool) -> object:
        """Stop at once, drop waiting samples, and release the device."""


class Audio(Protocol):
    """The used part of the module `sounddevice`, which the twin replaces."""

    CallbackStop: type[Exception]
    CallbackAbort: type[Exception]
    PortAudioError: type[Exception]

    @property
    def OutputStream(self) -> Callable[..., AudioStream]:  # noqa: N802  as sounddevice calls it
        """Opens a device's outputs; its keyword arguments are the driver's own."""

    @property
    def InputStream(self) -> Callable[..., AudioStream]:  # noqa: N802
        """Opens a device's inputs."""

    @property
    def Stream(self) -> Callable[..., AudioStream]:  # noqa: N802
        """Opens inputs and outputs together, in one callback."""

    def query_devices(self, device: int | str | None, kind: str) -> Any:
        """Return the device's name and capabilities, as a mapping."""


def load() -> Audio:
    """Return the module `sounddevice`. Raises ConfigurationError without it, or without PortAudio."""
    try:
        audio: Audio = optional("sounddevice", "sound", "A sound card")
    except OSError as error:
        # Without PortAudio itself, importing sounddevice is an OSError.
        raise ConfigurationError(
            f"A sound card needs PortAudio, which does not load ({error}): install the distribution's "
            "PortAudio package (Debian: libportaudio2), or sounddevice anew."
        ) from None
    return audio


def found(audio: Audio, device: int | str, kind: str, table: str) -> tuple[str, int]:
    """Return the name of a device and its number of channels of a kind, "input" or "output".

    Raises InstrumentError, which names the rig file's `table`.
    """
    try:
        known = audio.query_devices(None if device == "" else device, kind)
        return str(known["name"]), int(known[f"max_{kind}_channels"])
    except (audio.PortAudioError, ValueError) as error:
        told = " ".join(str(error).split())
        raise InstrumentError(
            f"There is no sound {kind} {device or 'by default'!r} ({told}): plug the card in, "
            f"or set 'device' in {table} to one that `python -m sounddevice` lists."
        ) from None


def high_pass(frequencies: FloatArray, corner_hz: float) -> ComplexArray:
    """Response of an AC coupling at `frequencies` (Hz): a zero at 0 Hz and a pole; 1 with a corner of 0."""
    if not corner_hz:
        return np.ones(len(frequencies), dtype=np.complex128)
    f = 1j * frequencies
    return np.asarray(f / (f + corner_hz))


def refuse_mean(volts: FloatArray) -> None:
    """Raise LimitError for a waveform that an AC-coupled output does not put out as it is."""
    peak, mean = float(np.abs(volts).max(initial=0.0)), float(volts.mean()) if len(volts) else 0.0
    if abs(mean) > _MEAN * peak:
        raise LimitError(
            f"A waveform with a mean of {mean:.2g} V at a peak of {peak:.2g} V was refused: a sound "
            "card's output is AC-coupled, so take the mean off."
        )
