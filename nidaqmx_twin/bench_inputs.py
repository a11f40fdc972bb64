"""What an input reads, as a bench file says it: a number, samples, a file, or a waveform by its name."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, model_validator
from scipy import signal

from ..base.arrays import FloatArray
from ..base.bounded import Strict
from ..base.errors import ConfigurationError
from ..base.validation import validate
from ..base.wording import did_you_mean
from .signals import Signal, signal_of


def _number(value: object) -> object:
    """`true` is no number of volts, and neither is "1"."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"must be a number (found {value!r})")
    return value


Number = Annotated[float, BeforeValidator(_number), Field(allow_inf_nan=False)]
Positive = Annotated[float, BeforeValidator(_number), Field(allow_inf_nan=False, gt=0)]


class _Waveform(Strict):
    waveform: str
    offset: Number = 0.0
    """Added (V)."""

    def at(self, terminal: str) -> Signal:
        """The signal at a terminal."""
        return self.values

    def values(self, times: FloatArray) -> FloatArray:
        """Values (samples,) at `times` (samples,) in s."""
        raise NotImplementedError


class _Periodic(_Waveform):
    frequency_hz: Positive
    amplitude: Number = 1.0
    """Half the distance of peak to peak (V)."""
    phase_deg: Number = 0.0

    def _turns(self, times: FloatArray) -> FloatArray:
        return np.asarray(2 * np.pi * (self.frequency_hz * times + self.phase_deg / 360))


class _Sine(_Periodic):
    def values(self, times: FloatArray) -> FloatArray:
        return np.asarray(self.offset + self.amplitude * np.sin(self._turns(times)))


class _Square(_Periodic):
    duty: Annotated[float, BeforeValidator(_number), Field(ge=0, le=1)] = 0.5
    """Part of a period in which it is high."""

    def values(self, times: FloatArray) -> FloatArray:
        return np.asarray(self.offset + self.amplitude * signal.square(self._turns(times), self.duty))


class _Triangle(_Periodic):
    """Begins at its offset and rises, as a sine."""

    def values(self, times: FloatArray) -> FloatArray:
        turns = self._turns(times) + np.pi / 2
        return np.asarray(self.offset + self.amplitude * signal.sawtooth(turns, 0.5))


class _Sawtooth(_Periodic):
    """Rises from its lowest value."""

    def values(self, times: FloatArray) -> FloatArray:
        return np.asarray(self.offset + self.amplitude * signal.sawtooth(self._turns(times)))


class _Chirp(_Waveform):
    """A sine whose frequency goes linearly `from_hz` `to_hz` in `duration_s`, again and again."""

    from_hz: Positive
    to_hz: Positive
    duration_s: Positive
    amplitude: Number = 1.0

    def values(self, times: FloatArray) -> FloatArray:
        swept = signal.chirp(times % self.duration_s, self.from_hz, self.duration_s, self.to_hz, phi=-90)
        return np.asarray(self.offset + self.amplitude * swept)


class _Step(_Waveform):
    """`before` until `at_s` after the start, then `after`."""

    before: Number = 0.0
    after: Number = 1.0
    at_s: Number

    def values(self, times: FloatArray) -> FloatArray:
        return np.asarray(self.offset + np.where(times < self.at_s, self.before, self.after))


class _Noise(_Waveform):
    """White, with a Gaussian distribution."""

    rms: Positive
    """V."""

    def at(self, terminal: str) -> Signal:
        """Noise of its own at each terminal."""
        seed = zlib.crc32(terminal.lower().encode())

        def values(times: FloatArray) -> FloatArray:
            drawn = np.random.default_rng([seed, abs(round(float(times[0]) * 1e9))])
            return np.asarray(self.offset + self.rms * drawn.standard_normal(len(times)))

        return values


WAVEFORMS: Mapping[str, type[_Waveform]] = {
    "sine": _Sine,
    "square": _Square,
    "triangle": _Triangle,
    "sawtooth": _Sawtooth,
    "chirp": _Chirp,
    "step": _Step,
    "noise": _Noise,
}


class _Samples(Strict):
    samples: Annotated[list[Number], Field(min_length=1)]
    rate_hz: Positive
    repeat: bool = False


class _File(Strict):
    file: Annotated[str, Field(min_length=1)]
    rate_hz: Positive | None = None
    """Of a .npy and a .csv; a .wav has its own."""
    repeat: bool = False

    @model_validator(mode="after")
    def _own_rate(self) -> _File:
        if self.rate_hz and self.file.lower().endswith(".wav"):
            raise ValueError("a .wav brings its own rate: leave out rate_hz")
        return self


_KINDS: Mapping[Literal["samples", "file"], type[Strict]] = {"samples": _Samples, "file": _File}


def input_of(told: Any, folder: Path, place: str) -> Callable[[str], Signal]:
    """The signal that a bench file says, by terminal: a function of the time since its start (s).

    Files lie in `folder`. Raises ConfigurationError, which begins with `place`.
    """
    if isinstance(told, bool):
        told = int(told)
    if isinstance(told, int | float):
        return _checked(lambda: signal_of(float(told), None, False, 0.0), place)
    if not isinstance(told, dict):
        raise ConfigurationError(
            f"{place}: an input is a number, or a table with waveform, samples or file (found {told!r})."
        )
    if "waveform" in told:
        name = told["waveform"]
        if name not in WAVEFORMS:
            hint = did_you_mean(str(name), WAVEFORMS, "there are")
            raise ConfigurationError(f"{place}: there is no waveform {name!r}; {hint}")
        return validate(WAVEFORMS[name], told, place).at
    kind = next((kind for kind in _KINDS if kind in told), None)
    if kind is None:
        words = ("waveform", *_KINDS)
        hint = did_you_mean(str(next(iter(told), "")), words, "it has one of")
        raise ConfigurationError(
            f"{place}: an input's table says waveform, samples or file, and not "
            f"{', '.join(told) or 'nothing'}; {hint}"
        )
    found = validate(_KINDS[kind], told, place)
    if isinstance(found, _Samples):
        return _checked(lambda: signal_of(found.samples, found.rate_hz, found.repeat, 0.0), place)
    assert isinstance(found, _File)
    path = folder / found.file
    if not path.is_file():
        raise ConfigurationError(f"{place}: there is no file {path}.")
    return _checked(lambda: signal_of(path, found.rate_hz, found.repeat, 0.0), place)


def _checked(make: Any, place: str) -> Callable[[str], Signal]:
    try:
        made: Signal = make()
    except ConfigurationError as error:
        raise ConfigurationError(f"{place}: {error}") from None
    return lambda _terminal: made
