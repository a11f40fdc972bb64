"""The paper's way from a press to volts: invert the response, fit a transfer function, simulate it.

"We then inverted the FRF (voltage/acceleration) and fit a transfer function using tfest [...]. Finally,
we inputted this transfer function and the synthesized acceleration signal to lsim to obtain the
actuation voltage signal" (paper, "Methodology"; the input voltage is 100 Vpp, figure 8). It is kept to be
compared with. It asks a causal, stable system to be the inverse of a response that, where patch and
point differ, has none; and it takes the patch's hysteresis for a lag.
"""

from __future__ import annotations

import warnings

import numpy as np
from scipy.signal import lfilter
from skrf import Frequency, Network
from skrf.vectorFitting import VectorFitting
from threadpoolctl import threadpool_limits

from acquisition import Representative
from calibration import actuation
from calibration.drive import BAND, Drive, Method, wanted_of
from calibration.record import Calibration
from calibration.spectra import resample
from instruments import Limits
from instruments.arrays import ComplexArray, FloatArray

__all__ = ["ORDERS", "paper_drive"]

ORDERS = tuple(range(2, 34, 2))
"""Numbers of poles that are worth trying: the paper names none."""
_LINES = 600


def paper_drive(
    press: Representative,
    calibration: Calibration,
    limits: Limits,
    order: int,
    *,
    method: Method = "modulated",
    band: tuple[float, float] = BAND,
) -> Drive:
    """The drive that the paper's method gives with `order` (even) poles, as loud as `limits` allow.

    The inverse is fitted by vector fitting instead of `tfest`; unstable poles are mirrored, as
    `lsim` needs a stable system. Fit and input are confined to `band`, to the method's advantage: below
    it the inverse grows without bound. Raises what `drive_for` raises.
    """
    wanted = wanted_of(press, calibration, method)
    band = actuation.measured_well(calibration.response, band)
    target, in_band = wanted.within(band)
    poles, residues, constant = _inverse(calibration, order, band)
    acceleration = wanted.on_drive(target)
    volts = _simulated(poles, residues, constant, acceleration, calibration.rate_hz)
    smooth = wanted.smooth
    volts *= np.minimum(1.0, smooth / 0.05)
    volts -= smooth * (volts.sum() / smooth.sum())
    scale = actuation.room(calibration, volts, limits) * (1 - 1e-9)
    volts *= scale

    grid = len(wanted.window)
    played = resample(np.pad(volts / scale, (0, grid * wanted.oversampling - len(volts))), grid)
    missed = np.fft.rfft(target) - actuation.gain(calibration, wanted.frequencies) * np.fft.rfft(played)
    inside = (wanted.frequencies >= band[0]) & (wanted.frequencies <= band[1])
    return Drive(
        button=press.button,
        patch=calibration.response.patch,
        point=calibration.response.point,
        rate_hz=calibration.rate_hz,
        volts=volts,
        target=scale * wanted.on_drive(target),
        scale=scale,
        method=f"the paper's, order {order}, {method}",
        carrier_hz=wanted.carrier_hz,
        band=band,
        in_band=in_band,
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
    # The measured response itself, as the paper's, less its noise between the lines that are kept.
    measured = np.interp(f, response.frequencies, response.acceleration.real) + 1j * np.interp(
        f, response.frequencies, response.acceleration.imag
    )
    inverse = 1 / measured
    size = float(np.median(np.abs(inverse)))
    fitting = VectorFitting(
        Network(frequency=Frequency.from_f(f, unit="hz"), s=(inverse / size)[:, None, None])
    )
    with threadpool_limits(1), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        fitting.vector_fit(
            n_poles_real=0,
            n_poles_cmplx=order // 2,
            init_pole_spacing="lin",
            fit_constant=True,
            fit_proportional=False,
            enforce_dc=False,
        )
    poles = np.asarray(fitting.poles, dtype=np.complex128)
    poles = -np.abs(poles.real) + 1j * poles.imag
    residues = np.asarray(fitting.residues, dtype=np.complex128).reshape(-1, len(poles))[0]
    return poles, residues * size, float(np.ravel(fitting.constant_coeff)[0]) * size


def _simulated(
    poles: ComplexArray, residues: ComplexArray, constant: float, signal: FloatArray, rate_hz: float
) -> FloatArray:
    """(samples,): what the system makes of a staircase, pole by pole and exactly."""
    out = constant * signal
    for pole, residue in zip(poles, residues, strict=True):
        decay = np.exp(pole / rate_hz)
        push = residue * (decay - 1) / pole
        state = lfilter([0, push], [1, -decay], signal.astype(np.complex128))
        out = out + (2 if pole.imag > 0 else 1) * state.real
    return np.asarray(out)
