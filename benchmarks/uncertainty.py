"""Stated uncertainty of responses and models against random simulated plants that nobody named.

    python benchmarks/uncertainty.py      # 20 minutes on one core

Each plant has 6 to 60 modes to 2.5 kHz, damping ratios of 0.2 to 5 %, up to three close pairs, a patch with
hysteresis of either of two laws or none, and by chance modes that soften with amplitude (Duffing), mains hum,
spikes of the laser, a drift while it is measured, and up to ten times the vibrometer's noise. Errors are
those of lines from 30 to 600 Hz, over the standard deviation that the response or the model states for that
line. A complex Gaussian error is within one standard deviation (rms of its magnitude) on 63 % of lines, and
within two on 98 %.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from scipy.stats import norm

from benchmarks import table as figures
from haploop import open_rig
from haploop.base.arrays import ComplexArray, FloatArray
from haploop.base.errors import HaploopError
from haploop.calibration import Calibration, LinearSweep, Multisine, measure_response
from haploop.calibration.model import standard_deviation
from haploop.calibration.response import Excitation
from haploop.instruments import Rig
from haploop.mocks.plant import BoucWen, Hysteresis, Modal, ModalSurface, random_modal
from haploop.mocks.plant.surface import place_of

WAYS = {
    "multisine from rest": Multisine(),
    "multisine, settled 1 s, 2 periods": Multisine(settle=1.0, periods=2),
    "sweep": LinearSweep(),
}


@dataclass(frozen=True, eq=False)
class Drawn:
    """A plant, its patch's law, and what disturbs the measurement."""

    surface: Modal
    law: str
    width: float
    simulation: dict[str, object]
    said: str


@dataclass(frozen=True, eq=False)
class Row:
    """Relative error and standard deviation (rms over the lines), and the errors (lines,) in deviations."""

    error: float
    stated: float
    ratios: FloatArray
    seconds: float


def drawn(name: str) -> Drawn:
    """The plant of a name: the same for the same name."""
    seed = int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "little")
    rng = np.random.default_rng(seed)
    low = float(np.exp(rng.uniform(np.log(0.002), np.log(0.02))))
    surface = random_modal(rng, damping=(low, min(2.5 * low, 0.05)))
    law = str(rng.choice(["play", "bouc-wen", "none"], p=[0.45, 0.45, 0.1]))
    width = 0.0 if law == "none" else float(rng.uniform(0.05, 0.25))
    faults: list[dict[str, object]] = []
    if law == "bouc-wen":
        faults.append({"kind": "patch-hysteresis", "law": "bouc-wen", "width": width})
    if rng.random() < 0.25:
        volts, hz = float(np.exp(rng.uniform(np.log(3e-4), np.log(1e-2)))), 50 * (1 + rng.normal(0, 5e-4))
        faults.append({"kind": "mains-hum", "channel": "laser", "volts": volts, "frequency": float(hz)})
    if rng.random() < 0.15:
        faults.append({"kind": "laser-spikes", "rate": float(rng.uniform(0.3, 3))})
    if rng.random() < 0.2:
        faults.append({"kind": "frequency-drift", "rate": float(rng.normal(0, 1e-5))})
    noise = float(np.exp(rng.uniform(0, np.log(10))))
    if rng.random() < 0.2:
        # At 3 um, which a sweep at full voltage reaches at the largest peak.
        surface = surface.model_copy(update={"softening": low * float(rng.uniform(0.02, 0.5))})
    simulation: dict[str, object] = {
        "seed": seed % 2**31,
        "hysteresis": width if law == "play" else 0.0,
        "vibrometer_noise_scale": noise,
        "faults": faults,
    }
    kinds = ", ".join([*(str(fault["kind"]) for fault in faults), *["softening"] * bool(surface.softening)])
    inside = sum(30 < f < 600 for f in surface.natural_hz)
    return Drawn(
        surface, law, width, simulation, f"{inside} modes, {low:.2%}, {law}, noise {noise:.1f}, {kinds}"
    )


def true_response(
    rig: Rig, plant: Drawn, excitation: Excitation, f: FloatArray, level: float
) -> ComplexArray:
    """What a sine of `level` volts does: the surface's response times the patch's first harmonic.

    Of modes that soften, the linear response nearest to what they do while `excitation` is played.
    """
    assert rig.simulation is not None
    turn = 2 * np.pi * np.arange(3 * 5000) / 5000
    volts = level * np.sin(turn) * np.clip(turn / (2 * np.pi), 0, 1)
    gain = 2j * np.mean((_linear_volts(plant, volts) * np.exp(-1j * turn))[-5000:]) / level
    truth = rig.simulation.truth
    found = truth.velocity_response("A", "button", f)
    if plant.surface.softening:
        found = found + _softened(rig, plant, excitation, f, level, abs(gain))
    return np.asarray(gain * found)


def _linear_volts(plant: Drawn, volts: FloatArray) -> FloatArray:
    law = BoucWen(plant.width) if plant.law == "bouc-wen" else Hysteresis(plant.width)
    return law.follow(volts) if plant.width else volts


def _softened(
    rig: Rig, plant: Drawn, excitation: Excitation, f: FloatArray, level: float, gain: float
) -> ComplexArray:
    """Change of the response (lines,) by softening: each mode's spring is the one that does the same work.

    For a multisine that of its mean square motion, which is nearly Gaussian; for a sweep that of the sine
    at each frequency.
    """
    assert rig.simulation is not None and rig.table is not None
    surface, truth = rig.simulation.truth.surface, plant.surface
    assert isinstance(surface, ModalSurface)
    modes = surface.modes(rig.clock.now())
    w, coupling = 2 * np.pi * modes.natural_hz[:, None], modes.coupling["A"][:, None]
    loss = 2 * modes.damping[:, None] * w
    sizes = np.concatenate([[0.0], np.geomspace(1e-4, 100, 400)])
    if isinstance(excitation, Multisine):
        volts = _linear_volts(plant, excitation.volts(rig.table.rate_hz, level))
        spectrum = 2 * np.abs(np.fft.rfft(volts)) ** 2 / len(volts) ** 2
        at = np.fft.rfftfreq(len(volts), 1 / rig.table.rate_hz)
        driven = at < 2 * excitation.high
        at, spectrum = at[driven], spectrum[driven]
        wave = norm.ppf((np.arange(2000) + 0.5) / 2000)
    else:
        at, spectrum = f, np.full(len(f), (gain * level) ** 2)
        wave = np.cos(2 * np.pi * np.arange(200) / 200)
    squares = (sizes[:, None] * wave) ** 2
    lost = (squares**2 / (1 + squares)).sum(axis=1) / np.maximum(squares.sum(axis=1), 1e-300)
    share, s = 2 * truth.softening / (np.sqrt(2) - 1), 2j * np.pi * at
    softer = np.zeros((len(w), 1))
    for _ in range(40):
        power = spectrum * np.abs(coupling / (w**2 * (1 - share * softer) + loss * s + s**2)) ** 2
        size = np.sqrt(power.sum(axis=1, keepdims=True) if isinstance(excitation, Multisine) else power)
        softer = (softer + np.interp(size / truth.soft_at, sizes, lost)) / 2
    s = 2j * np.pi * f
    weight = modes.shape(place_of(rig.file, "button"))[:, None] * coupling * s
    soft, hard = (weight / (w**2 * (1 - share * x) + loss * s + s**2) for x in (softer, 0.0))
    return np.asarray((soft - hard).sum(axis=0))


def compared(found: ComplexArray, deviation: FloatArray, true: ComplexArray, seconds: float) -> Row:
    """The row of one response or model."""
    size = np.linalg.norm(true)
    error = np.abs(found - true)
    return Row(
        float(np.linalg.norm(error) / size),
        float(np.linalg.norm(deviation) / size),
        np.asarray(error / deviation),
        seconds,
    )


def measured(plant: Drawn, excitation: Excitation) -> tuple[Row, Row]:
    """Rows of the response and of its model."""
    with open_rig("simulated", simulation=plant.simulation, plant=plant.surface) as rig:
        began = rig.clock.now()
        response = measure_response(rig, excitation=excitation)
        seconds = rig.clock.now() - began
        calibration = Calibration.of(response)
        f = response.frequencies
        inside = (f > 30) & (f < 600)
        f = f[inside]
        true = true_response(rig, plant, excitation, f, response.level)
    lines = compared(response.velocity[inside], response.deviation[inside], true, seconds)
    model = compared(calibration.model.velocity(f), standard_deviation(calibration, f), true, seconds)
    return lines, model


def table(rows: dict[str, list[Row]]) -> None:
    """Print the shares within one and two standard deviations, and their size."""
    titles = "plants", "lines within 1, 2", "plants within 1, 2, 3", "error", "stated / error", "measuring"
    print("\n| | " + " | ".join(titles) + " |")
    print("|" + "---|" * (1 + len(titles)))
    for name, found in rows.items():
        if not found:
            continue
        ratios = np.array([[np.mean(row.ratios < n) for n in (1, 2)] for row in found]).mean(axis=0)
        error, stated = np.array([(row.error, row.stated) for row in found]).T
        within = [np.mean(error < n * stated) for n in (1, 2, 3)]
        seconds = np.array([row.seconds for row in found])
        low, middle, high = np.percentile(stated / error, [5, 50, 95])
        print(
            f"| {name} | {len(found)} | {ratios[0]:.0%}, {ratios[1]:.1%} "
            f"| {within[0]:.0%}, {within[1]:.1%}, {within[2]:.1%} "
            f"| {np.median(error):.2%}, {error.max():.1%} | {middle:.1f} ({low:.1f} to {high:.1f}) "
            f"| {seconds.mean():.1f} s, {seconds.max():.1f} s |",
            flush=True,
        )


def main(words: Sequence[str] | None = None) -> list[figures.Row]:
    """Measure every plant in every way asked for, print the table, and return what it says of each way."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--plants", type=int, default=200)
    parser.add_argument("--settled", type=int, default=60, help="plants measured after settling")
    parser.add_argument("--sweeps", type=int, default=40, help="plants measured with sweeps as well")
    parser.add_argument(
        "--every", type=int, default=20, help="plants after which the table is printed so far"
    )
    parser.add_argument("--name", default="uncertainty", help="another name gives other plants")
    asked = parser.parse_args(words)
    counts = dict(zip(WAYS, (asked.plants, asked.settled, asked.sweeps), strict=True))
    rows: dict[str, list[Row]] = {f"{name}, {part}": [] for name in WAYS for part in ("lines", "model")}
    refused: list[str] = []
    for number in range(max(counts.values())):
        plant = drawn(f"{asked.name} {number}")
        for name, excitation in WAYS.items():
            if number >= counts[name]:
                continue
            began = time.process_time()
            try:
                lines, model = measured(plant, excitation)
            except HaploopError as error:
                refused.append(f"{number}, {name}: {error}")
                print(refused[-1], flush=True)
                continue
            rows[f"{name}, lines"].append(lines)
            rows[f"{name}, model"].append(model)
            print(
                f"{number} {name[:12]} ({plant.said}): lines {lines.error:.2%} said {lines.stated:.2%}, "
                f"model {model.error:.2%} said {model.stated:.2%}, within "
                f"{np.mean(lines.ratios < 1):.2f} {np.mean(lines.ratios < 2):.2f}, "
                f"{np.mean(model.ratios < 1):.2f} {np.mean(model.ratios < 2):.2f}; {lines.seconds:.1f} s; "
                f"{time.process_time() - began:.0f} s CPU",
                flush=True,
            )
        if (number + 1) % asked.every == 0 or number + 1 == max(counts.values()):
            table(rows)
            print(f"\nRefused: {len(refused)}", flush=True)
    return [
        figures.Row(
            f"stated deviation of {name}",
            [100 * one.stated for one in found],
            "%",
            "the true error",
            [one.stated / one.error for one in found],
            ">= 1",
            more=True,
        )
        for name, found in rows.items()
        if found
    ]


if __name__ == "__main__":
    main()
