"""Measuring time and error of responses of simulated tables: `python benchmarks/responses.py`.

Two plants a seed. *Linear*: patches without hysteresis, and a vibrometer so noisy that the velocity
stands 37 dB above its noise from 0 to 2.5 kHz (the band of a 5 kS/s recording); compared with the
plate's own response. *Default*: hysteresis of 12 %, and the vibrometer's usual noise; compared with
the plate's response times the gain and lag that the patch has at that level, one complex number.
Everything here is simulated.
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
from haploop.calibration import LinearSweep, Multisine, Response, calibrate, fit, measure_response
from haploop.calibration.model.model import Model
from haploop.calibration.response.measuring import excite, prepare, response_from
from haploop.instruments import Rig, open_rig

BAND = (30.0, 600.0)
SNR_DB = 37.0
NYQUIST = 2500.0
Errors = tuple[float, float, float, float]
Estimate = tuple[np.ndarray, np.ndarray]
"""Frequencies (lines,) in Hz, and a response at them (m/s per V)."""


def noise_scale(seed: int, excitation: Multisine | LinearSweep) -> float:
    """Noise scale of the vibrometer at which the velocity of an excitation is 37 dB above the noise."""
    with open_rig(
        "simulated", simulation={"seed": seed, "hysteresis": 0, "vibrometer_noise_scale": 0}
    ) as rig:
        drive = excitation.volts(rig.table.rate_hz, rig.limits.peak)
        capture = rig.excite(drive, ("A",), (rig.vibrometer.channel,))
        velocity = rig.vibrometer.to_velocity(capture.volts[0])
    density = 0.02e-6  # m/s per sqrt(Hz) at a scale of one
    return float(velocity.std() * 10 ** (-SNR_DB / 20) / (density * np.sqrt(NYQUIST)))


def compare(rig: Rig, response: Response, model: Model, level: bool) -> Errors:
    """Errors of lines and of the model over the band, and of the main resonance (mHz) and its damping."""
    truth = rig.simulation.truth  # type: ignore[union-attr]
    plate = truth.surface.modes(rig.clock.now())
    natural = plate.natural_hz
    main = int(np.argmin(np.abs(natural - truth.resonance_hz)))

    def error(f: np.ndarray, measured: np.ndarray) -> float:
        inside = (f >= BAND[0]) & (f <= BAND[1])
        own, found = truth.velocity_response("A", "button", f[inside]), measured[inside]
        gain = np.vdot(own, found) / np.vdot(own, own) if level else 1.0
        return float(np.linalg.norm(found / gain - own) / np.linalg.norm(own))

    f = np.arange(*BAND, 0.25)
    mode = min(model.resonances, key=lambda r: abs(r.frequency_hz - natural[main]))
    return (
        error(response.frequencies, response.velocity),
        error(f, model.velocity(f)),
        abs(mode.frequency_hz - natural[main]) * 1e3,
        abs(mode.damping / plate.damping[main] - 1),
    )


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
            drive, velocity = capture.volts[0], rig.vibrometer.to_velocity(capture.volts[1])
            one = quick.samples(capture.rate_hz)
            last = len(quick.volts(capture.rate_hz, peak))

            def ours(rig=rig, capture=capture, quick=quick, peak=peak) -> Estimate:
                found = response_from(rig, capture, quick, peak, patch="A", point="button")
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


def table(title: str, rows: dict[str, list[Errors]], seconds: dict[str, float]) -> None:
    """Print the errors over the seeds; of resonance and damping the worst."""
    print(f"\n{title}\n")
    print("| excitation | measuring | lines, mean / worst | fit, mean / worst | resonance | damping |")
    print("|---|---|---|---|---|---|")
    for name, found in rows.items():
        lines, fits, resonance, damping = np.array(found).T
        errors = " | ".join(f"{e.mean():.2%} / {e.max():.2%}" for e in (lines, fits))
        mode = f"{resonance.max():.1f} mHz | {damping.max():.2%}"
        print(f"| {name} | {seconds[name]:.2f} s | {errors} | {mode} |", flush=True)


def main(words: Sequence[str] | None = None) -> list[Row]:
    """Print both tables, and return the figures of the estimates beside other packages'."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--estimates", action="store_true", help="only beside scipy's csd and pyFRF")
    asked = parser.parse_args(words)
    seeds = range(1000, 1000 + asked.seeds)
    if asked.estimates:
        rows_ = estimates(seeds)
        print(markdown(rows_))
        return rows_
    sweep, one = LinearSweep(repeats=2, shares=()), LinearSweep()
    quick = Multisine()

    rows: dict[str, list[Errors]] = {}
    seconds: dict[str, float] = {}

    def add(name: str, excitation_s: float, row: Errors) -> None:
        rows.setdefault(name, []).append(row)
        seconds[name] = excitation_s

    excitations: dict[str, Multisine | LinearSweep] = {
        "multisine from rest, local rational method": quick,
        "the same on all lines": Multisine(lines="all"),
        "multisine, settled 1 s, 2 periods, plain ratio": Multisine(periods=2, settle=1.0),
        "the paper's sweep, twice": sweep,
    }
    for seed in seeds:
        for name, excitation in excitations.items():
            plant = {"seed": seed, "hysteresis": 0, "vibrometer_noise_scale": noise_scale(seed, excitation)}
            with open_rig("simulated", simulation=plant) as rig:
                response = measure_response(rig, excitation=excitation)
                add(name, excitation.duration, compare(rig, response, fit(response), False))
    table(f"Linear plant, {SNR_DB:.0f} dB, {len(seeds)} seeds", rows, seconds)

    rows, seconds = {}, {}
    for seed in seeds:
        with open_rig("simulated", simulation={"seed": seed}) as rig:
            calibration = calibrate(rig)
            add(
                "the paper's sweep at four levels",
                one.duration,
                compare(rig, calibration.response, calibration.model, True),
            )
            undone = partial(measure_response, rig, excitation=quick, hysteresis=calibration.hysteresis)
            measured: dict[str, Callable[[], Response]] = {
                "multisine from rest, hysteresis found": partial(measure_response, rig, excitation=quick),
                "the same, hysteresis of an earlier calibration": undone,
            }
            for name, measure in measured.items():
                response = measure()
                add(name, quick.duration, compare(rig, response, fit(response), True))
    table(f"Default plant (hysteresis 12 %), {len(seeds)} seeds", rows, seconds)
    return estimates(seeds)


if __name__ == "__main__":
    main()
