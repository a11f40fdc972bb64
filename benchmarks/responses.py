"""Our response from 2.05 s beside scipy's csd and pyFRF: `python benchmarks/responses.py`.

The default plant (hysteresis of 12 %, the vibrometer's usual noise), one table a seed. Errors are relative
rms differences, from 30 to 600 Hz, from the plate's response times the gain and lag that the patch has at
that level, one complex number. Everything here is simulated.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
import scipy.signal

from benchmarks.table import Row, markdown, ratios
from haploop.calibration import Multisine
from haploop.calibration.response.measuring import Play, Spot, excite, prepare, response_from
from haploop.instruments import open_rig

BAND = (30.0, 600.0)
Estimate = tuple[np.ndarray, np.ndarray]
"""Frequencies (lines,) in Hz, and a response at them (m/s per V)."""


def csd(drive: np.ndarray, velocity: np.ndarray, rate_hz: float) -> Estimate:
    """H1 of scipy's spectra, of one period as it is, which is exact for what has settled."""
    given = {"fs": rate_hz, "nperseg": len(drive), "window": "boxcar", "detrend": False}
    f, cross = scipy.signal.csd(drive, velocity, **given)
    return f, cross / scipy.signal.welch(drive, **given)[1]


def pyfrf(drive: np.ndarray, velocity: np.ndarray, rate_hz: float) -> Estimate:
    """H1 of pyFRF, of the whole signals."""
    from pyFRF import FRF

    frf = FRF(
        int(rate_hz), exc=drive, resp=velocity, exc_type="f", resp_type="v", fft_len=len(drive), window="none"
    )
    f = frf.get_f_axis()
    return f, 2j * np.pi * f * np.squeeze(frf.get_H1())  # it gives displacements


PEERS: dict[str, Callable[[np.ndarray, np.ndarray, float], Estimate]] = {"scipy.signal.csd": csd}
if importlib.util.find_spec("pyFRF"):
    PEERS["pyFRF"] = pyfrf


def estimates(seeds: Sequence[int]) -> list[Row]:
    """Processor time and error of estimates from the same 2.05 s of the same default plant."""
    cpu: dict[str, list[float]] = defaultdict(list)
    error: dict[str, list[float]] = defaultdict(list)
    for seed in seeds:
        with open_rig("simulated", simulation={"seed": seed}) as rig:
            prepare(rig, "button")
            quick, peak = Multisine(), rig.limits.peak
            capture = excite(rig, quick, "A", peak)
            drive, velocity = capture.volts[0], rig.vibrometer.to_si(capture.volts[1])
            one = quick.samples(capture.rate_hz)
            last = len(quick.volts(capture.rate_hz, peak))

            def ours(rig=rig, capture=capture, quick=quick, peak=peak) -> Estimate:
                found = response_from(Spot(rig, "A", "button"), capture, Play(quick, peak))
                return found.frequencies, found.velocity

            ways = {"haploop": ours} | {
                name: partial(peer, drive[last - one : last], velocity[last - one : last], capture.rate_hz)
                for name, peer in PEERS.items()
            }
            truth = rig.simulation.truth
            for name, way in ways.items():
                began = time.process_time()
                f, response = way()
                if name in PEERS:  # which know nothing of the laser
                    response = response / rig.vibrometer.response(f)
                cpu[name].append(time.process_time() - began)
                # On the lines that are played; on the others a ratio of spectra has no meaning.
                near = np.abs(f[:, None] - quick.excited() * capture.rate_hz / one).min(axis=1) < 0.01
                inside = near & (f >= BAND[0]) & (f <= BAND[1])
                own, found = truth.velocity_response("A", "button", f[inside]), response[inside]
                gain = np.vdot(own, found) / np.vdot(own, own)
                error[name].append(100 * float(np.linalg.norm(found / gain - own) / np.linalg.norm(own)))
    what, rows = "response from 2.05 s of a hysteretic table", []
    for name in PEERS:
        beside = ratios(cpu["haploop"], cpu[name])
        rows.append(Row(f"{what}: CPU", cpu["haploop"], "s", name, beside, "0.8 s"))
        beside = ratios(error["haploop"], error[name])
        rows.append(Row(f"{what}: error", error["haploop"], "%", name, beside))
    return rows


def main(words: Sequence[str] | None = None) -> list[Row]:
    """Print the table, and return its figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seeds", type=int, default=10)
    asked = parser.parse_args(words)
    rows = estimates(range(1000, 1000 + asked.seeds))
    print(markdown(rows))
    return rows


if __name__ == "__main__":
    main()
