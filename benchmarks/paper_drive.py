"""Paper baseline, from a press to volts: invert the response, fit a transfer function, simulate it.

"We then inverted the FRF (voltage/acceleration) and fit a transfer function using tfest [...]. Finally,
we inputted this transfer function and the synthesized acceleration signal to lsim to obtain the
actuation voltage signal" (paper, "Methodology"; the input voltage is 100 Vpp, figure 8). It is kept for
comparison. Where patch and point differ, the response has no causal, stable inverse, which this method
assumes; and it models the patch's hysteresis as a lag.
"""

from __future__ import annotations

import numpy as np
import scipy
from threadpoolctl import threadpool_limits

from haploop.acquisition import Representative
from haploop.base.arrays import ComplexArray, FloatArray
from haploop.calibration.band import BAND
from haploop.calibration.drive.actuation import Actuation
from haploop.calibration.drive.drive import Drive
from haploop.calibration.drive.targets import FADE, Method, target_grid
from haploop.calibration.model import Calibration
from haploop.calibration.spectra import fade, resample
from haploop.instruments import Limits

ORDERS = tuple(range(2, 34, 2))
"""Numbers of poles to try: the paper states none."""
_LINES = 600
_RELOCATIONS = 30


def paper_drive(
    press: Representative,
    calibration: Calibration,
    limits: Limits,
    order: int,
    *,
    method: Method = "modulated",
    band: tuple[float, float] = BAND,
) -> Drive:
    """The drive of the paper's method with `order` (even) poles, scaled to the largest output in `limits`.

    The inverse is fitted by vector fitting instead of `tfest`; unstable poles are mirrored, as
    `lsim` needs a stable system. Fit and input are confined to `band`, to the method's advantage: below
    it the inverse grows without bound. Raises what `drive_for` raises.
    """
    table = Actuation.of([calibration])
    grid = target_grid([press], table, method)
    band = table.measured_well(band, table.points)
    (target,), (in_band,) = grid.within(band)
    poles, residues, constant = _inverse(calibration, order, band)
    # The grid includes the ringing: a causal inverse moves after the press, and cannot before it.
    acceleration = resample(target, len(target) * grid.oversampling)
    edge = round(FADE * calibration.rate_hz)
    smooth = fade(len(acceleration), edge, edge)
    volts = smooth * _simulated(poles, residues, constant, acceleration, calibration.rate_hz)
    volts -= smooth * (volts.sum() / smooth.sum())
    scale = table.headroom(volts[None], limits)[0] * (1 - 1e-9)
    volts *= scale

    played = resample(volts / scale, len(target))
    missed = np.fft.rfft(target) - table.gain(grid.frequencies)[0, 0] * np.fft.rfft(played)
    inside = (grid.frequencies >= band[0]) & (grid.frequencies <= band[1])
    return Drive(
        button=press.button,
        patches=table.patches,
        point=calibration.response.point,
        rate_hz=calibration.rate_hz,
        volts=volts[None],
        target=scale * acceleration,
        scale=scale,
        method=f"paper baseline, order {order}, {method}",
        carrier_hz=grid.carriers[0],
        band=band,
        in_band=in_band,
        known=table.known,
        predicted_error=float(np.linalg.norm(missed[inside]) / np.linalg.norm(np.fft.rfft(target))),
        unreached="",
        rig=calibration.response.rig,
        simulated=bool(press.simulated or calibration.response.simulated),
        sources=tuple((str(name), str(content)) for name, content in press.sources),
        calibration=calibration.digest,
    )


def _inverse(
    calibration: Calibration, order: int, band: tuple[float, float]
) -> tuple[ComplexArray, ComplexArray, float]:
    """Poles (rad/s), residues and constant of volts per m/s^2, one of each conjugate pair."""
    response = calibration.response
    f = np.linspace(*band, _LINES)
    # The measured response itself, as in the paper, less its noise between the lines that are kept.
    # Per volt commanded: the inverse includes the amplifier's lag.
    commanded = response.acceleration * response.path
    measured = np.interp(f, response.frequencies, commanded)
    with threadpool_limits(1):
        return _vector_fit(f, np.asarray(1 / measured, dtype=np.complex128), order)


def _vector_fit(f: FloatArray, target: ComplexArray, order: int) -> tuple[ComplexArray, ComplexArray, float]:
    """Stable poles (rad/s), residues and constant of the best relative fit to `target` (lines,).

    Vector fitting (Gustavsen and Semlyen, IEEE Transactions on Power Delivery 14, 1999). With absolute
    errors the antiresonances of the table, where its inverse is largest, would dominate the fit.
    """
    unit = 2 * np.pi * float(f[-1])
    s = np.asarray(2j * np.pi * f / unit, dtype=np.complex128)
    weight = 1 / np.abs(target)
    places = np.linspace(f[0], f[-1], order // 2) / f[-1]
    poles = np.asarray((-0.01 + 1j) * places, dtype=np.complex128)
    for _ in range(_RELOCATIONS):
        basis = _columns(poles, s)
        rows = np.hstack([basis, -target[:, None] * basis[:, :-1]]) * weight[:, None]
        shift = _least_squares(rows, target * weight)[basis.shape[1] :]
        moved = np.asarray(np.linalg.eigvals(_companion(poles, shift)), dtype=np.complex128)
        # `lsim` needs a stable system: a mirrored pole has the same magnitude.
        moved = -np.abs(moved.real) + 1j * moved.imag
        poles = np.concatenate([moved[moved.imag > 0], moved[moved.imag == 0]])
    found = _least_squares(_columns(poles, s) * weight[:, None], target * weight)
    residues = np.zeros(len(poles), dtype=np.complex128)
    column = 0
    for number, pole in enumerate(poles):
        residues[number] = found[column] + (1j * found[column + 1] if pole.imag else 0)
        column += 2 if pole.imag else 1
    return poles * unit, residues * unit, float(found[-1])


def _columns(poles: ComplexArray, s: ComplexArray) -> ComplexArray:
    """Basis (lines, unknowns): two for each pole pair, one for each real pole, and a constant."""
    columns = []
    for pole in poles:
        near, mirror = 1 / (s - pole), 1 / (s - np.conj(pole))
        columns += [near + mirror, 1j * (near - mirror)] if pole.imag else [near]
    return np.array([*columns, np.ones_like(s)]).T


def _companion(poles: ComplexArray, shift: FloatArray) -> FloatArray:
    """Matrix whose eigenvalues are the zeros of one plus `shift` over the poles."""
    blocks, inputs = [], []
    for pole in poles:
        rows = [[pole.real, pole.imag], [-pole.imag, pole.real]] if pole.imag else [[pole.real]]
        blocks.append(np.array(rows, dtype=np.float64))
        inputs += [2.0, 0.0] if pole.imag else [1.0]
    return np.asarray(scipy.linalg.block_diag(*blocks) - np.outer(inputs, shift))


def _least_squares(rows: ComplexArray, target: ComplexArray) -> FloatArray:
    real = np.concatenate([rows.real, rows.imag])
    size = np.maximum(np.linalg.norm(real, axis=0), 1e-30)
    solution = np.linalg.lstsq(real / size, np.concatenate([target.real, target.imag]), rcond=None)[0]
    return np.asarray(solution / size)


def _simulated(
    poles: ComplexArray, residues: ComplexArray, constant: float, signal: FloatArray, rate_hz: float
) -> FloatArray:
    """(samples,): exact output of the system for straight lines between samples, pole by pole.

    As in `lsim` with a smooth signal: a staircase would be half a sample late.
    """
    out = constant * signal
    for pole, residue in zip(poles, residues, strict=True):
        z = pole / rate_hz
        decay = np.exp(z)
        last = (np.expm1(z) - z) / (pole * z)
        first = np.expm1(z) / pole - last
        state = scipy.signal.lfilter(
            residue * np.array([last, first]), [1, -decay], signal.astype(np.complex128)
        )
        out = out + (2 if pole.imag > 0 else 1) * state.real
    return np.asarray(out)
