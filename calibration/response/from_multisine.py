"""Estimate of a response from a multisine, from rest or after settling, of one patch or several at once."""

from __future__ import annotations

import numpy as np
from scipy.fft import rfft
from scipy.ndimage import uniform_filter1d

from haploop.calibration.response.channels import Channels
from haploop.calibration.response.estimate import FrfEstimate
from haploop.calibration.response.excitation import Multisine
from haploop.calibration.response.local_rational import local_rational
from haploop.instruments.arrays import ComplexArray, FloatArray, IntArray

__all__ = ["from_multisine"]

_POOL = 25
"""Neighbouring lines whose noise or distortion is averaged: both are smooth over frequency."""


def from_multisine(
    multisine: Multisine,
    commanded: FloatArray,
    drive: FloatArray,
    velocity: FloatArray,
    channels: Channels,
    linear_volts: FloatArray | None = None,
) -> FrfEstimate:
    """Estimate the response on the excited lines, from signals that begin with the multisine.

    `commanded` is (samples,) V; `drive` (V) and `velocity` (m/s) are as sampled, at least as long.
    Patches driven at the same time are separated by their lines: call this for each, with its own
    drive. If `linear_volts` ((samples,), `drive` through the hysteresis model) are given, the response is
    per linear volt.
    """
    one = multisine.samples(channels.rate_hz)
    start = len(commanded) - multisine.periods * one

    def spectra(signal: FloatArray) -> ComplexArray:
        periods = signal[start : start + multisine.periods * one].reshape(multisine.periods, one)
        return np.asarray(rfft(periods)[:, : 2 * int(multisine.excited()[-1])])

    order, sampled = spectra(commanded).mean(axis=0), spectra(drive)
    f = np.arange(len(order)) * channels.rate_hz / one
    factor = channels.drive(sampled, order, f)
    U = sampled * factor
    lines = multisine.excited()
    path = U.mean(axis=0)[lines] / order[lines]
    Y = channels.velocity(spectra(velocity), f)
    if linear_volts is not None:
        # Delays and images affect linear volts as they affect the drive.
        U = spectra(linear_volts) * factor
    even, odd = multisine.silent()
    if multisine.from_rest:
        found = local_rational(U[0], Y[0], np.arange(lines[0], lines[-1] + 1))
        own = lines - lines[0]
        H, deviation, residual = found.response[own], np.sqrt(found.spread[own]), found.variance[own]
        silent = np.zeros(len(f), dtype=np.complex128)
        silent[lines[0] : lines[-1] + 1] = found.surprise
        even, odd = (n[(n >= lines[0]) & (n <= lines[-1])] for n in (even, odd))
    else:
        x, y = U[:, lines], Y[:, lines]
        silent = Y.mean(axis=0)
        power = (np.abs(x) ** 2).sum(axis=0)
        H = (np.conj(x) * y).sum(axis=0) / power
        # The level on unexcited odd lines equals that on the excited ones: noise, and the distortion
        # common to all periods.
        surprise = _power_at(lines, odd, silent)
        deviation = np.sqrt(multisine.periods * surprise / power)
        residual = surprise
        if multisine.periods > 1:
            residual = (np.abs(y - H * x) ** 2).sum(axis=0) / (multisine.periods - 1)
            residual = uniform_filter1d(residual, _POOL, mode="nearest")
    strength = np.abs(U.mean(axis=0)[lines])
    signal = np.maximum(np.abs(H) ** 2 * strength**2 - residual, 0.0)
    noise_lines = even if len(even) and multisine.periods == 1 else None
    noise = residual if noise_lines is None else _power_at(lines, noise_lines, silent)
    return FrfEstimate(
        frequencies=f[lines],
        velocity=H,
        deviation=deviation,
        coherence=signal / (signal + residual),
        path=path,
        noise=np.sqrt(2 * noise / (one * channels.rate_hz)),
        distortion=np.array([np.sqrt(_power_at(lines, n, silent)) / strength for n in (even, odd) if len(n)]),
        level_gain=np.zeros(0, dtype=np.complex128),
    )


def _power_at(lines: IntArray, silent: IntArray, spectrum: ComplexArray) -> FloatArray:
    """Power (lines,) interpolated from the unexcited lines, averaged over a few of them."""
    power = uniform_filter1d(np.abs(spectrum[silent]) ** 2, _POOL, mode="nearest")
    return np.asarray(np.interp(lines, silent, power))
