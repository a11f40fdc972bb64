"""Converters shared by twin and wire, so that both give, and lose, the same samples."""

from __future__ import annotations

import zlib
from typing import Protocol

import numpy as np

from ..base.arrays import BoolArray, FloatArray

LOST = {"overrun": -200279, "overflow": -200010}
"""NI's error for each `how` of `nodes.SamplesLost`."""
STOPPED = {"underflow": -200290, "fifo": -200621}
"""NI's error for each `how` of `nodes.PlayStopped`; "stopped" is none."""


class Converters(Protocol):
    """The converters of a card: those of an NI product, or of any other card."""

    @property
    def ai_bits(self) -> int:
        """Resolution of the inputs."""

    @property
    def ai_noise(self) -> float:
        """Noise in a range of +-10 V (V rms), scaled with the range."""

    @property
    def ao_bits(self) -> int:
        """Resolution of the outputs."""

    @property
    def ao_range(self) -> float:
        """Full scale of the outputs (+- V)."""


def noise_of(seed: int, device: str, acquisition: int) -> np.random.Generator:
    """Create the noise generator of a device's `acquisition`-th start (from 0) on a plant with `seed`.

    Each acquisition has its own generator, so that earlier reads do not change its noise.
    """
    return np.random.default_rng([seed, zlib.crc32(device.encode()), acquisition])


def convert(
    volts: FloatArray, full_scale: FloatArray, product: Converters, noise: np.random.Generator
) -> tuple[FloatArray, BoolArray]:
    """Convert the true `volts` at a card's terminals to the volts that it reports, and find overloads.

    `volts` is (channels, samples), at each channel's own conversion times and in the card's order of
    conversion; `full_scale` is (channels,), +- V. Returns volts of the same shape, and (channels,) True
    where a sample reached an end of the range. The noise is drawn sample by sample, so that it does not
    depend on the division of the samples into blocks.
    """
    channels, samples = volts.shape
    width = code_width(product, full_scale)[:, np.newaxis]
    # In units of codes. Noise is proportional to the range, so it is equal in every channel.
    drawn = noise.standard_normal((samples, channels))
    drawn *= product.ai_noise / 10.0 * 2.0 ** (product.ai_bits - 1)
    codes = volts / width
    codes += drawn.T
    np.rint(codes, out=codes)
    end = 2.0 ** (product.ai_bits - 1) - 1
    overload = np.asarray((codes.max(axis=1) >= end) | (codes.min(axis=1) <= -end))
    if overload.any():
        np.clip(codes, -end - 1, end, out=codes)
    codes *= width
    return codes, overload


def put_out(volts: FloatArray, product: Converters) -> FloatArray:
    """Round `volts` (of any shape) to the codes of a card's output, and clip them to its range."""
    end = 2.0 ** (product.ao_bits - 1)
    width = product.ao_range / end
    return np.asarray(np.clip(np.rint(volts / width), -end, end - 1) * width)


def code_width(product: Converters, full_scale: FloatArray) -> FloatArray:
    """Return the volts per code of input ranges of +-`full_scale` (V, any shape)."""
    return full_scale / 2.0 ** (product.ai_bits - 1)
