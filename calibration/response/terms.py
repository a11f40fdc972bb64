"""Terms of a response with given poles, which its unknowns multiply, and the derivatives by the poles."""

from __future__ import annotations

import numpy as np

from ...base.arrays import ComplexArray, FloatArray


def rows(values: ComplexArray) -> FloatArray:
    """(..., 2 lines): real and imaginary parts by turns, of (..., lines)."""
    return np.ascontiguousarray(values).view(np.float64)


def terms_of(poles: ComplexArray, f: FloatArray) -> tuple[ComplexArray, ComplexArray]:
    """Terms (unknowns, lines) of the real unknowns of a response, and of those of what rings.

    Of each pair 1 / (s - p) + 1 / (s - conj p), then of each i / (s - p) - i / (s - conj p).
    """
    s, inverse = 2j * np.pi * np.asarray(f), _inverse_quadratics(poles, f)
    n = len(poles)
    response = np.empty((2 * n + 2, len(s)), dtype=np.complex128)
    np.multiply(inverse, 2 * (s - poles.real[:, None]), out=response[:n])
    np.multiply(rows(inverse), -2 * poles.imag[:, None], out=rows(response[n : 2 * n]))
    response[-2], response[-1] = 1, s
    ringing = response.copy()
    ringing[-1] = 1j
    return response, ringing


def moved(poles: ComplexArray, shares: FloatArray, drives: ComplexArray, f: FloatArray) -> ComplexArray:
    """Derivatives (2, poles, lines) of what modes make of drives by logarithms of decays and frequencies.

    `shares` (drives, 2 poles) are the unknowns of `terms_of`, `drives` is (drives, lines). A pair is
    (a s + b) / ((s - p) (s - conj p)); a and b are held, because what they do the terms themselves make.
    """
    s, inverse = 2j * np.pi * f, _inverse_quadratics(poles, f)
    decay, turn = -poles.real, poles.imag
    real, imag = shares[:, : len(poles)], shares[:, len(poles) :]
    tops = [(part.T @ rows(drives)).view(np.complex128) for part in (real, real * decay - imag * turn)]
    steep = (tops[0] * s + tops[1]) * (inverse * inverse)
    found = np.empty((2, *steep.shape), dtype=np.complex128)
    np.multiply(steep, -4 * decay[:, None] * (s + decay[:, None]), out=found[0])
    np.multiply(rows(steep), -4 * turn[:, None] ** 2, out=rows(found[1]))
    return found


def _inverse_quadratics(poles: ComplexArray, f: FloatArray) -> ComplexArray:
    """1 / ((s - p) (s - conj p)), (poles, lines).

    In real numbers: a complex division takes five times as long.
    """
    w, decay, turn = 2 * np.pi * np.asarray(f), -poles.real[:, None], poles.imag[:, None]
    real, imag = (turn - w) * (turn + w) + decay**2, 2 * decay * w
    size = 1 / (real**2 + imag**2)
    inverse = np.empty(real.shape, dtype=np.complex128)
    np.multiply(real, size, out=inverse.real)
    np.multiply(imag, -size, out=inverse.imag)
    return inverse
