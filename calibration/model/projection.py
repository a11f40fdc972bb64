"""A rational function of given poles: its least-squares fit to a response, what it leaves and its slopes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...base.arrays import ComplexArray, FloatArray

_ALIKE = 30
"""Largest distance (lines) at which noise may be correlated."""
_ENOUGH = 1000
"""Number of lines above which neighbouring ones are averaged."""


@dataclass(frozen=True, eq=False)
class Lines:
    """A response: `f` (lines,) Hz, and `H` (rows,), scaled to a noise power of one.

    Each row is the sum of `block` lines over the root of `block`, which leaves the noise power at one.
    """

    f: FloatArray
    H: ComplexArray
    block: int = 1

    @cached_property
    def spacing(self) -> float:
        """Median distance of neighbouring lines (Hz)."""
        return float(np.median(np.diff(self.f)))

    @cached_property
    def centres(self) -> FloatArray:
        """Frequencies (rows,) of the rows (Hz)."""
        return np.asarray(self.f.reshape(-1, self.block).mean(axis=1))

    def averaged(self) -> Lines:
        """Average neighbouring lines. A basis is averaged alike, so that this adds no bias and saves time."""
        block = len(self.f) // _ENOUGH
        if block < 2:
            return self
        kept = len(self.f) // block * block
        H = self.H[:kept].reshape(-1, block).sum(axis=1) / np.sqrt(block)
        return Lines(self.f[:kept], H, block)

    def gathered(self, values: FloatArray) -> FloatArray:
        """Combine real and imaginary parts (columns, 2, lines) into rows, (columns, 2 rows)."""
        if self.block > 1:
            # Twice as fast as a sum along a short axis.
            total = values[:, :, :: self.block] + values[:, :, 1 :: self.block]
            for k in range(2, self.block):
                total += values[:, :, k :: self.block]
            total /= np.sqrt(self.block)
            values = total
        return values.reshape(len(values), -1)


@dataclass(frozen=True, eq=False)
class Projection:
    """Least-squares solution for given poles (rad/s, one of each conjugate pair).

    The response is a sum of (a + b s) / ((s - p)(s - p*)), or of a / (s - p) for real poles, a constant and
    a slope. `basis` (unknowns, 2 rows) has rows of unit norm, `norms` before: b of pairs, a of pairs, a of
    real poles, constant, slope. `inverse` is that of its Gram matrix; `left` (2 rows,) is the residual, real
    parts first.
    """

    poles: ComplexArray
    lines: Lines
    quadratic: FloatArray
    """(2, pairs, lines): real and imaginary part of 1 / ((s - p)(s - p*))."""
    basis: FloatArray
    norms: FloatArray
    inverse: FloatArray
    solution: FloatArray
    left: FloatArray
    power: float
    """Power of the residual per row."""

    @classmethod
    def of(cls, poles: ComplexArray, lines: Lines) -> Projection:
        """Solve for the linear unknowns."""
        quadratic = _inverse_quadratic(poles[poles.imag > 0], 2 * np.pi * lines.f)
        basis = _basis(poles, quadratic, lines)
        norms = np.sqrt(np.einsum("ij,ij->i", basis, basis))
        basis /= norms[:, None]
        # The tiny ridge keeps coincident poles solvable; the second pass makes up for it, and for rounding.
        inverse = np.linalg.inv(basis @ basis.T + 1e-12 * np.eye(len(norms)))
        measured = np.concatenate([lines.H.real, lines.H.imag])
        found = inverse @ (basis @ measured)
        found = found + inverse @ (basis @ (measured - found @ basis))
        left = np.asarray(measured - found @ basis)
        power = float(left @ left) / (len(left) // 2)
        return cls(
            poles,
            lines,
            quadratic,
            basis,
            norms,
            np.asarray(inverse, dtype=np.float64),
            np.asarray(found / norms),
            left,
            power,
        )

    @property
    def residual(self) -> ComplexArray:
        """The residual (rows,)."""
        count = len(self.left) // 2
        return np.asarray(self.left[:count] + 1j * self.left[count:])

    @property
    def error(self) -> float:
        """Relative rms residual."""
        return float(np.sqrt(self.power / np.mean(np.abs(self.lines.H) ** 2)))

    @cached_property
    def independent(self) -> float:
        """Number of independent rows: the residual of neighbouring lines may be correlated, by smoothing."""
        count, total = len(self.left) // 2, float(self.left @ self.left)
        alike = np.fft.ifft(np.abs(np.fft.fft(self.residual, 2 * count)) ** 2)[1:_ALIKE] / max(total, 1e-300)
        return count / float(1 + 2 * (np.abs(alike) ** 2).sum())

    @property
    def parameters(self) -> int:
        """Number of real parameters: four a pole pair, two a real pole, a constant and a slope."""
        return 2 * len(self.poles) + 2 * int((self.poles.imag > 0).sum()) + 2

    def residues(self) -> ComplexArray:
        """(poles,) residues."""
        paired = self.poles.imag > 0
        count = int(paired.sum())
        b, a, p = self.solution[:count], self.solution[count : 2 * count], self.poles[paired]
        found = np.empty(len(self.poles), dtype=np.complex128)
        found[paired] = (a + b * p) / (2j * p.imag)
        found[~paired] = self.solution[2 * count : -2]
        return found

    def slope(self) -> FloatArray:
        """Derivative (parameters, 2 rows) by logarithms: pairs' decay and frequency, real poles' decay."""
        paired = self.poles.imag > 0
        pairs, real = self.poles[paired], self.poles[~paired].real[:, None]
        count, w = len(pairs), 2 * np.pi * self.lines.f
        re, im = self.quadratic
        b, a = self.solution[:count, None], self.solution[count : 2 * count, None]
        # -(a + b s) / quadratic^2, times the derivatives of the quadratic: 2 (s + decay) and 2 frequency.
        square_re, square_im = re**2 - im**2, 2 * re * im
        top_re, top_im = b * w * square_im - a * square_re, -a * square_im - b * w * square_re
        d, own = -pairs.real[:, None], 2 * pairs.imag[:, None] ** 2
        slopes = np.empty((2 * count + len(real), 2, len(w)))
        slopes[:count, 0], slopes[:count, 1] = (
            2 * d * (d * top_re - w * top_im),
            2 * d * (d * top_im + w * top_re),
        )
        slopes[count : 2 * count, 0], slopes[count : 2 * count, 1] = own * top_re, own * top_im
        # -decay / (s + decay)^2
        size = real * self.solution[2 * count : -2, None] / (w**2 + real**2) ** 2
        slopes[2 * count :, 0], slopes[2 * count :, 1] = size * (real**2 - w**2), size * 2 * real * w
        return self.lines.gathered(slopes)

    def explained(self, candidates: ComplexArray) -> FloatArray:
        """Energy of the residual (candidates,) that each pair of poles would take away if it were added."""
        quadratic = _inverse_quadratic(candidates, 2 * np.pi * self.lines.f)
        added = _basis(candidates, quadratic, self.lines)[:-2].reshape(2, len(candidates), -1)
        added /= np.linalg.norm(added, axis=2)[:, :, None]
        seen = added @ self.basis.T
        gram = np.einsum("ikn,jkn->kij", added, added) - np.einsum(
            "iku,uv,jkv->kij", seen, self.inverse, seen
        )
        along = (added @ self.left).T[:, :, None]
        return np.asarray((along * np.linalg.solve(gram + 1e-9 * np.eye(2), along)).sum(axis=(1, 2)))

    def costs(self) -> FloatArray:
        """Rise of the residual's power (poles,) when a pole is removed and the others stay where they are."""
        scaled = self.solution * self.norms
        paired = self.poles.imag > 0
        count = int(paired.sum())
        first = np.where(paired, np.cumsum(paired) - 1, 2 * count + np.cumsum(~paired) - 1)
        costs = []
        for k, pair in zip(first, paired, strict=True):
            own = [k, k + count] if pair else [k]
            costs.append(scaled[own] @ np.linalg.solve(self.inverse[np.ix_(own, own)], scaled[own]))
        return np.array(costs) / (len(self.left) // 2)


def _basis(poles: ComplexArray, quadratic: FloatArray, lines: Lines) -> FloatArray:
    """Rows (unknowns, 2 rows) of the linear unknowns, as `Projection` orders them."""
    real, w = poles[poles.imag == 0].real[:, None], 2 * np.pi * lines.f
    count = quadratic.shape[1]
    basis = np.empty((2 * count + len(real) + 2, 2, len(w)))
    np.multiply(-w, quadratic[1], out=basis[:count, 0])
    np.multiply(w, quadratic[0], out=basis[:count, 1])
    basis[count : 2 * count] = quadratic.transpose(1, 0, 2)
    size = 1 / (w**2 + real**2)
    basis[2 * count : -2, 0], basis[2 * count : -2, 1] = -real * size, -w * size
    basis[-2:] = 0
    basis[-2, 0], basis[-1, 1] = 1, w
    return lines.gathered(basis)


def _inverse_quadratic(pairs: ComplexArray, w: FloatArray) -> FloatArray:
    """Real and imaginary part of 1 / ((s - p)(s - p*)) at s = j w, (2, pairs, lines)."""
    d, own = -pairs.real[:, None], pairs.imag[:, None]
    found = np.empty((2, len(pairs), len(w)))
    re, im = (own - w) * (own + w) + d**2, 2 * d * w
    size = 1 / (re * re + im * im)
    np.multiply(re, size, out=found[0])
    np.multiply(-im, size, out=found[1])
    return found
