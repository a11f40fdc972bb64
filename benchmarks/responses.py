"""Measuring time and error of responses of simulated tables: `python benchmarks/responses.py`.

Two plants a seed. *Linear*: patches without hysteresis, and a vibrometer so noisy that the velocity
stands 37 dB above its noise from 0 to 2.5 kHz (the band of a 5 kS/s recording); compared with the
plate's own response. *Default*: hysteresis of 12 %, and the vibrometer's usual noise; compared with
the plate's response times the gain and lag that the patch has at that level, one complex number.
Everything here is simulated.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial

import numpy as np

from haploop.calibration import LinearSweep, Multisine, Response, calibrate, fit, measure_response
from haploop.calibration.model.model import Model
from haploop.instruments import Rig, open_rig

BAND = (30.0, 600.0)
SNR_DB = 37.0
NYQUIST = 2500.0
Row = tuple[float, float, float, float]


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


def compare(rig: Rig, response: Response, model: Model, level: bool) -> Row:
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


def table(title: str, rows: dict[str, list[Row]], seconds: dict[str, float]) -> None:
    """Print the errors over the seeds; of resonance and damping the worst."""
    print(f"\n{title}\n")
    print("| excitation | measuring | lines, mean / worst | fit, mean / worst | resonance | damping |")
    print("|---|---|---|---|---|---|")
    for name, found in rows.items():
        lines, fits, resonance, damping = np.array(found).T
        errors = " | ".join(f"{e.mean():.2%} / {e.max():.2%}" for e in (lines, fits))
        mode = f"{resonance.max():.1f} mHz | {damping.max():.2%}"
        print(f"| {name} | {seconds[name]:.2f} s | {errors} | {mode} |", flush=True)


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    seeds = range(1000, 1000 + parser.parse_args().seeds)
    sweep, one = LinearSweep(repeats=2, shares=()), LinearSweep()
    quick = Multisine()

    rows: dict[str, list[Row]] = {}
    seconds: dict[str, float] = {}

    def add(name: str, excitation_s: float, row: Row) -> None:
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


if __name__ == "__main__":
    main()
