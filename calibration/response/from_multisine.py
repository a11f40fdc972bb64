"""Estimate of a response from a multisine, from rest or after settling, on its lines and by its modes.

From rest one period does, by the local rational method. Model: within a few lines (r from -1 to 1) the output
is Y = (B(r) U + T(r)) / D(r). The response B / D is nearly a ratio of two polynomials of low order, and the
transient T of the start has the same denominator. With D(0) = 1 this is linear in eight coefficients, D Y = B
U + T, and least squares fit them to the 21 lines about each line (McKelvey and Guerin, Proc. IFAC SYSID,
2012; Pintelon and Schoukens, System Identification, 2012, section 7.2). So no settling is needed: 2.05 s
suffice, where a plain ratio would have an error of 5 to 19 %.

Assumptions: the table is linear and does not change within the period; a window holds one resonance and the
slope of its neighbours; the drive is known without noise, and strong on some lines of each window; the noise
of the output is alike on the lines of a window and independent from one to another. What breaks them: two
resonances within a window; a distortion or a tone of the mains, which least squares follow (`surprise` shows
it on unexcited lines); much noise, because the error of the equation is minimised, and that is the output's
times D: the estimate is then biased.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view
from threadpoolctl import threadpool_limits

from ...base.arrays import ComplexArray, FloatArray, IntArray
from .excitation import Multisine
from .hysteresis import HALF_WIDTHS, Hysteresis, first_harmonic, operators
from .modes import Modes, Plays, fit_modes
from .response import FrfEstimate
from .spot import Channels
from .terms import moved, rows, terms_of

_HALF = 10
"""Lines on either side: fewer average less noise, more bias the response within 5 Hz."""
_ORDER = 2
"""Order of all three polynomials: one resonance, and the slope from its neighbours."""
_AT_ONCE = 1000
"""Lines that are fitted at once: each takes 10 kB."""


@dataclass(frozen=True, eq=False)
class Local:
    """Local fit at each line (lines,): response, its variance `spread`, `variance`, and `surprise`.

    `variance` is that of the output about the local fit. `surprise` is the measured output less the
    prediction from the neighbouring lines: on an unexcited line, noise and distortion.
    """

    response: ComplexArray
    spread: FloatArray
    variance: FloatArray
    surprise: ComplexArray


def local_rational(drive: ComplexArray, output: ComplexArray, lines: IntArray) -> Local:
    """Estimate the response from `drive` to `output` (spectra of all lines from 0 Hz on) at `lines`.

    The drive must be strong on some of the lines around each.
    """
    half = int(min(_HALF, lines[0], len(drive) - 1 - lines[-1]))
    some = [lines[first : first + _AT_ONCE] for first in range(0, len(lines), _AT_ONCE)]
    fitted = [_fit(drive, output, one, half) for one in some]
    response, spread, variance, surprise = map(np.concatenate, zip(*fitted, strict=True))
    # Thirteen degrees of freedom estimate a variance within 28 %: the neighbours' are averaged in.
    variance = scipy.ndimage.uniform_filter1d(variance, 2 * half + 1, mode="nearest")
    return Local(response=response, spread=variance * spread, variance=variance, surprise=surprise)


def _fit(
    drive: ComplexArray, output: ComplexArray, lines: IntArray, half: int
) -> tuple[ComplexArray, FloatArray, FloatArray, ComplexArray]:
    """Response, its variance over that of the output, the output's, and the surprise: each (lines,)."""
    r = np.arange(-half, half + 1) / half
    u = sliding_window_view(drive, 2 * half + 1)[lines - half]
    y = sliding_window_view(output, 2 * half + 1)[lines - half]
    powers = r[:, None] ** np.arange(_ORDER + 1)
    columns = np.concatenate(
        [
            u[:, :, None] * powers,
            np.broadcast_to(powers, (len(lines), *powers.shape)),
            -y[:, :, None] * powers[:, 1:],
        ],
        axis=2,
    )
    norms = np.linalg.norm(columns, axis=1, keepdims=True)
    columns = columns / np.where(norms > 0, norms, 1.0)
    q, upper = np.linalg.qr(columns)
    seen = np.einsum("lij,li->lj", q.conj(), y)
    left = y - np.einsum("lij,lj->li", q, seen)
    # A tiny ridge prevents division by zero in rank-deficient windows, such as of noise-free data.
    size = np.abs(np.diagonal(upper, axis1=1, axis2=2)).max(axis=1)
    eye = np.eye(upper.shape[1])
    inverse = np.linalg.inv(upper + 1e-13 * size[:, None, None] * eye)
    solution = np.einsum("lij,lj->li", inverse, seen)
    variance = (np.abs(left) ** 2).sum(axis=1) / (2 * half + 1 - columns.shape[2])
    covariance = (np.abs(inverse[:, 0, :]) ** 2).sum(axis=1)
    weight = (np.abs(q[:, half, :]) ** 2).sum(axis=1)
    return (
        solution[:, 0] / norms[:, 0, 0],
        covariance / norms[:, 0, 0] ** 2,
        variance,
        left[:, half] / np.maximum(1 - weight, 0.05),
    )


_POOL = 25
"""Neighbouring lines whose noise is averaged: it is smooth over frequency."""
_MARGIN = 10
"""Lines beyond the band on either side, for the local fits at its ends."""
_LAW = 15
"""Left-out odd lines over which the law's misfit is averaged; it is averaged over all of them as well."""
_ALIKE = 2.0
"""Error of the response over the distortion on the lines that were left out. That distortion is the part of
a law's misfit that does not follow the drive; the part that does is its equal, and is in the response."""
_OPTIMISM = 1.4
"""Variance of a local fit to noise over the one it states: its denominators follow the noise (measured)."""
_ROUNDS = 4
"""Rounds of weighting in which noise and distortion are told apart where no even line is silent."""


def from_multisine(
    multisine: Multisine,
    commanded: FloatArray,
    drive: FloatArray,
    velocity: FloatArray,
    channels: Channels,
    hysteresis: Hysteresis | None = None,
    *,
    local_only: bool = False,
) -> tuple[FrfEstimate, Hysteresis]:
    """Estimate the response on the excited lines, from signals that begin with the multisine.

    `commanded` is (samples,) V; `drive` (V) and `velocity` (what the pick-up shows) are as sampled, and
    as long.
    The patch's `hysteresis` is found together with the table's modes in the same signals, unless it is
    given; the response is that to a sine of `hysteresis.level` volts. Modes explain resonances that a
    local method cannot resolve, and the local rational method estimates what they leave. `local_only` leaves
    the modes out, which takes a tenth of the time; the hysteresis must then be given.
    """
    one = multisine.samples(channels.rate_hz)
    start = len(commanded) - multisine.periods * one
    lines, excited, even, odd, inner = looked_at(multisine)
    f = lines * channels.rate_hz / one

    def spectra(signals: FloatArray) -> ComplexArray:
        signals = signals[..., start : start + multisine.periods * one]
        periods = signals.reshape(*signals.shape[:-1], multisine.periods, one).mean(axis=-2)
        return np.asarray(np.fft.rfft(periods)[..., lines])

    level = float(np.abs(drive[: len(commanded)]).max()) if hysteresis is None else hysteresis.level
    volts = drive[: len(commanded)]
    linear = operators(volts, level) if hysteresis is None else hysteresis.to_linear_volts(volts)[None]
    order, sampled = spectra(commanded), spectra(volts)
    # Delays and images affect linear volts as they affect the drive.
    factor = channels.drive(sampled[None], order, f)
    seen, moved = spectra(linear) * factor, channels.velocity(spectra(velocity), f)
    plays = Plays(f, (0,), seen[None], moved[:, None])
    with threadpool_limits(1):
        none = Modes(np.zeros(0, dtype=np.complex128), np.ones((1, 1)))
        modes = none if local_only else fit_modes([plays], 1)
        law, gains = _law(modes, level, hysteresis)
        gain = complex(gains @ modes.weights[0])
        modal = nothing(plays) if local_only else modal_estimate(modes, plays, gain, gains)
    x = modes.weights[0] @ seen
    local = local_rational(x, modal.left, inner)
    at = excited - inner[0]
    H = modal.response[excited] + gain * local.response[at]
    strength = np.abs(x[excited] / gain)
    unexplained = np.abs(local.surprise) ** 2
    silent = {"even": even, "odd": odd}
    power = {name: smoothed(unexplained[n - inner[0]], n, excited) for name, n in silent.items() if len(n)}
    everywhere = np.zeros(len(f))
    everywhere[inner] = unexplained
    moved_power = np.interp(np.arange(len(f)), excited, (np.abs(H) * strength) ** 2)
    law_misfit = _misfit(even, odd, everywhere, moved_power)[excited]
    scatter = _OPTIMISM * abs(gain) ** 2 * local.spread[at]
    variance = scatter + modal.variance[excited] + law_misfit * np.abs(H) ** 2
    # Means over the periods: of one, the noise is more.
    residual = multisine.periods * local.variance[at]
    noise = multisine.periods * power["even"] if len(even) else residual
    signal = np.abs(H) ** 2 * strength**2
    return FrfEstimate(
        frequencies=f[excited],
        velocity=H,
        deviation=np.sqrt(variance),
        scatter=np.sqrt(scatter),
        coherence=signal / (signal + residual),
        path=(sampled * factor)[excited] / order[excited],
        noise=np.sqrt(2 * noise / (one * channels.rate_hz)),
        distortion=np.array([np.sqrt(p) / strength for p in power.values()]),
        level_gain=np.zeros(0, dtype=np.complex128),
    ), law


def looked_at(multisine: Multisine) -> tuple[IntArray, IntArray, IntArray, IntArray, IntArray]:
    """The lines that are looked at; and the places among them of those that were excited, of the silent even
    and odd ones, and of all in the band.
    """
    excited = multisine.excited()
    even, odd = multisine.silent()
    inner = np.arange(min(excited[0], *odd[:1], *even[:1]), max(excited[-1], *odd[-1:], *even[-1:]) + 1)
    margin = int(min(_MARGIN, inner[0] - 1))
    lines = np.arange(inner[0] - margin, inner[-1] + margin + 1)
    return lines, excited - lines[0], even - lines[0], odd - lines[0], inner - lines[0]


def _law(modes: Modes, level: float, given: Hysteresis | None) -> tuple[Hysteresis, ComplexArray]:
    """The law that was found with the modes, unless it is given, and its operators' gains at `level` (V)."""
    if given is not None:
        return given, np.array([given.gain(level)])
    gains = np.append(first_harmonic(HALF_WIDTHS * level, level), 0.0)
    law = Hysteresis(HALF_WIDTHS * level, modes.weights[0, :-1], level)
    return Hysteresis(law.radii, law.weights / abs(law.gain(level)), level), gains


def _misfit(even: IntArray, odd: IntArray, unexplained: FloatArray, moved: FloatArray) -> FloatArray:
    """Relative variance (lines,) of the response by what the law of the patch does not explain.

    `unexplained` is power at all lines, `moved` (lines,) the excited lines' power, interpolated. A hysteresis
    distorts odd lines alone, so that even ones show the noise. Where none are silent, distortion is what is
    larger where the response is.
    """
    own, size = unexplained[odd], moved[odd]
    if len(even):
        noise = scipy.ndimage.uniform_filter1d(unexplained[even], 4 * _LAW, mode="nearest")
        own = own - np.interp(odd, even, noise)
        near = scipy.ndimage.uniform_filter1d(own, _LAW, mode="nearest") / scipy.ndimage.uniform_filter1d(
            size, _LAW, mode="nearest"
        )
        share = np.maximum(near, max(float(own.sum() / size.sum()), 0.0))
        return np.asarray(_ALIKE**2 * np.interp(np.arange(len(moved)), odd, share))
    weights, columns = np.ones(len(own)), np.array([np.full(len(own), own.mean()), size]).T
    for _ in range(_ROUNDS):
        # The power of a line has a standard deviation equal to its mean.
        parts = scipy.optimize.nnls(columns / weights[:, None], own / weights)[0]
        weights = np.maximum(columns @ parts, 1e-9 * own.mean())
    return np.full(len(moved), _ALIKE**2 * float(parts[1]))


def smoothed(power: FloatArray, lines: IntArray, at: IntArray) -> FloatArray:
    """Power averaged over neighbours among the `lines` on which it was measured, interpolated `at` others."""
    return np.asarray(np.interp(at, lines, scipy.ndimage.uniform_filter1d(power, _POOL, mode="nearest")))


# Response and ringing of one play after its modes, what they leave, and how well they are known.
#
# The modes are fitted to all lines together, so that a resonance narrower than a line's spacing and the
# ringing of the start are told apart by what they have in common, which a local method cannot do. Poles and
# residues are parameters of a least-squares problem, and the deviation follows from its Jacobian.

_NEAR, _FAR = 5, 25
"""Lines over which the power of the residual is averaged: few, for hum, and many."""
_UNSEEN = 1e-11
"""Smallest eigenvalue of the scaled normal equations: below it, rounding errors determine a parameter."""


@dataclass(frozen=True, eq=False)
class ModalEstimate:
    """Fields are (lines,): response and its variance, and velocity that is not explained, `left`."""

    response: ComplexArray
    variance: FloatArray
    left: ComplexArray


def nothing(plays: Plays) -> ModalEstimate:
    """The estimate without modes, which leaves everything."""
    lines = len(plays.f)
    return ModalEstimate(np.zeros(lines, dtype=np.complex128), np.zeros(lines), plays.velocity[:, 0])


def modal_estimate(modes: Modes, plays: Plays, gain: complex, gains: ComplexArray) -> ModalEstimate:
    """Solve for one patch's response at the first point of `plays`, from the modes fitted to it.

    The response is multiplied by `gain`, that of the patch's law; `gains` (operators,) are its derivatives by
    the law's weights. The variance takes the residual's power as it is around each line (White,
    Econometrica 48, 1980), not as the same everywhere.
    """
    f = plays.f
    tones = modes.tones(f)
    poles = np.concatenate([modes.poles[~tones], modes.poles[tones]])
    n, own_n = len(poles), int((~tones).sum())
    response, ringing = terms_of(poles[:own_n], f)[0], terms_of(poles, f)[1]
    volts, alone = modes.weights[0] @ plays.operators[0], np.ones((1, len(f)), dtype=np.complex128)
    linear = np.concatenate([volts * response, ringing])
    found, left = _solved(rows(linear), plays.velocity[:, 0])
    own, ring = found[: len(response)], found[len(response) :]
    H = (own @ rows(response)).view(np.complex128)
    apart = np.zeros((2, n, len(f)), dtype=np.complex128)
    apart[:, :own_n] = moved(poles[:own_n], own[None, : 2 * own_n], alone, f)
    own_moved = apart.reshape(-1, len(f))
    rung = moved(poles, ring[None, : 2 * n], alone, f).reshape(-1, len(f))
    # A weight at its bound of zero is no free parameter.
    free = np.flatnonzero(modes.weights[0, 1:]) + 1
    J = rows(np.concatenate([linear, volts * own_moved + rung, plays.operators[0, free] * H]))
    change = rows(
        np.concatenate([gain * response, np.zeros_like(ringing), gain * own_moved, gains[free, None] * H])
    )
    power = np.abs(left) ** 2 * len(f) / max(len(f) - len(J) / 2, 1)
    power = np.maximum(
        *(scipy.ndimage.uniform_filter1d(power, size, mode="nearest") for size in (_NEAR, _FAR))
    )
    norms = np.linalg.norm(J, axis=1)[:, None]
    values, vectors = np.linalg.eigh((J @ J.T) / (norms * norms.T))
    # Along the eigenvectors, where what is hardly seen stays apart from what is seen well.
    inner = (vectors.T @ (J / norms)) / np.maximum(values, _UNSEEN)[:, None]
    reach = vectors.T @ (change / norms)
    spread = ((inner * np.repeat(power, 2)) @ inner.T @ reach * reach).sum(axis=0).reshape(-1, 2).sum(axis=1)
    return ModalEstimate(H * gain, np.maximum(spread, 0) / 2, left)


def _solved(columns: FloatArray, measured: ComplexArray) -> tuple[FloatArray, ComplexArray]:
    """Least squares of the least norm: the unknowns, and the residual (lines,)."""
    norms = np.linalg.norm(columns, axis=1)
    found = np.linalg.lstsq((columns / norms[:, None]).T, rows(measured), rcond=_UNSEEN)[0] / norms
    return found, measured - (found @ columns).view(np.complex128)
