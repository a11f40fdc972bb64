"""Our fit beside scikit-rf's `VectorFitting.auto_fit`: `python benchmarks/fits.py`.

Prints Markdown: a measured beam, synthetic beams and plates, and with `--tables N` the carriers of simulated
tables, measured by sweeps and by the 2.05 s path. CPU is `time.process_time` in this process, the best of
three, with one thread for linear algebra. "Error" is the relative rms difference from the response as
measured.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from skrf import Frequency, Network
from skrf.vectorFitting import VectorFitting
from threadpoolctl import threadpool_limits

from benchmarks.synthetic_responses import Case, beam, generator, plate, response_of
from benchmarks.table import Row, ratios
from haploop.calibration import LinearSweep, Model, Multisine, fit, measure_response
from haploop.instruments import open_rig

BEAM = Path(__file__).parents[1] / "tests" / "data" / "beam_accelerance_point1.txt"
BEAM_HZ = np.array([51.5, 142.2, 278.7, 460.4, 687.2, 958.5])
"""Natural frequencies of the measured beam, read off its peaks."""


class Responses(Network):
    """Network without a test for passivity, which has no meaning here and would cost time."""

    def is_passive(self, *_: object) -> bool:
        return False


def auto_fit(f: np.ndarray, H: np.ndarray) -> np.ndarray:
    """Response of scikit-rf's fit with its default settings."""
    largest = np.abs(H).max()
    fitting = VectorFitting(
        Responses(frequency=Frequency.from_f(f, unit="hz"), s=(H / largest)[:, None, None])
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        fitting.auto_fit()
    return np.asarray(fitting.get_model_response(0, 0, f) * largest)


def timed(work: Callable[[], Any]) -> tuple[Any, float]:
    """Result, and the shortest CPU time of three runs (s)."""
    seconds = []
    for _ in range(3):
        start = time.process_time()
        result = work()
        seconds.append(time.process_time() - start)
    return result, min(seconds)


def found(model: Model, natural: np.ndarray) -> tuple[int, int]:
    """Number of natural frequencies with a resonance within 0.5 % of them, and of resonances without one."""
    named = np.array([r.frequency_hz for r in model.resonances])
    near = np.abs(named[:, None] - natural) <= 0.005 * natural
    return int(near.any(axis=0).sum()), int(len(named) - near.any(axis=0).sum())


def compare(name: str, cases: list[Case]) -> list[Row]:
    """Print one row: medians of the errors, sums of resonances and of CPU times. Nothing without cases."""
    if not cases:
        return []
    ours, theirs, true_ours, true_theirs, cpu, peers, hits, extra, pairs = ([] for _ in range(9))
    for case in cases:
        f, H = case.response.frequencies, case.response.velocity
        model, seconds = timed(lambda case=case: fit(case.response))
        peer, peer_seconds = timed(lambda f=f, H=H: auto_fit(f, H))

        def off(a: np.ndarray, b: np.ndarray) -> float:
            return float(np.linalg.norm(a - b) / np.linalg.norm(b))

        ours.append(off(model.velocity(f), H))
        theirs.append(off(peer, H))
        true_ours.append(off(model.velocity(f), case.truth))
        true_theirs.append(off(peer, case.truth))
        cpu.append(seconds)
        peers.append(peer_seconds)
        hit, more = found(model, case.natural)
        hits.append(hit)
        extra.append(more)
        pairs.append(int((model.poles.imag > 0).sum()))
    worse = sum(a > b for a, b in zip(ours, theirs, strict=True))
    known = len(cases) > 1
    print(
        f"| {name} | {len(cases)} | {np.median(ours):.2%} | {np.median(theirs):.2%} | {worse} | "
        + (f"{np.median(true_ours):.2%} | {np.median(true_theirs):.2%} | " if known else "| | ")
        + f"{sum(hits)} / {sum(len(c.natural) for c in cases)} | {sum(extra)} | {np.median(pairs):.0f} | "
        f"{1e3 * np.mean(cpu):.0f} ms | {sum(cpu) / sum(peers):.2f} |",
        flush=True,
    )
    peer = "scikit-rf, auto_fit"
    return [
        Row(f"fit, {name}: CPU", cpu, "s", peer, ratios(cpu, peers), "0.7 s"),
        Row(f"fit, {name}: error", [100 * one for one in ours], "%", peer, ratios(ours, theirs)),
    ]


def carriers(tables: int, name: str) -> None:
    """Print how far the carriers of simulated tables are from the plant's, by sweeps and from 2.05 s."""
    ways = {"sweeps": LinearSweep(), "multisine from rest": Multisine()}
    off: dict[str, list[float]] = {way: [] for way in ways}
    both = dict.fromkeys(ways, 0)
    for number in range(tables):
        seed = int(generator(name, number).integers(2**32))
        for way, excitation in ways.items():
            with open_rig("simulated", simulation={"seed": seed}) as rig:
                model = fit(measure_response(rig, excitation=excitation))
                off[way].append(abs(model.resonance_hz - rig.simulation.truth.resonance_hz))
            both[way] += len(model.carriers) > 1
            if off[way][-1] > 0.3:
                print(f"\nseed {seed}, {way}: {off[way][-1]:.2f} Hz off", flush=True)
        if (number + 1) % 50 and number + 1 < tables:
            continue
        for way, hz in off.items():
            print(
                f"\n{len(hz)} tables, {way}: carrier off by {1e3 * np.median(hz):.1f} mHz (median), "
                f"{1e3 * max(hz):.1f} (worst), more than 0.3 Hz on {sum(one > 0.3 for one in hz)}; "
                f"{both[way]} ambiguous.",
                flush=True,
            )


def main(words: Sequence[str] | None = None) -> list[Row]:
    """Print the table of fits, and the carriers; return the fits' figures, a round for each response."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=30, help="synthetic responses of each kind; 0: none")
    parser.add_argument("--tables", type=int, default=0, help="simulated tables to measure")
    parser.add_argument("--name", default="table", help="another name gives other tables")
    options = parser.parse_args(words)
    accelerance = np.array([complex(line) for line in BEAM.read_text().split()])
    f = np.arange(len(accelerance), dtype=np.float64)
    kept = f >= 10
    f, accelerance = f[kept], accelerance[kept]
    velocity = accelerance / (2j * np.pi * f)
    print(
        "| response | number | error | auto_fit | worse | from the truth | auto_fit | resonances | extra "
        "| pole pairs | CPU | over auto_fit |"
    )
    print("|" + "---|" * 12)
    count = options.count
    rows: list[Row] = []
    with threadpool_limits(1):
        for name, cases in {
            "measured beam, velocity": [Case(response_of(f, velocity), velocity, BEAM_HZ)],
            "measured beam, accelerance": [Case(response_of(f, accelerance), accelerance, BEAM_HZ)],
            "synthetic beams": [beam(n) for n in range(count)],
            "plates, 12 modes, 37 dB": [plate(n) for n in range(count)],
            "plates, 12 modes, 60 dB": [plate(n, snr_db=60) for n in range(count)],
            "plates, 12 modes, 17 dB": [plate(n, snr_db=17) for n in range(count)],
            "plates, 30 modes, 37 dB": [plate(n, modes=30) for n in range(count)],
        }.items():
            rows += compare(name, cases)
    if options.tables:
        carriers(options.tables, options.name)
    return rows


if __name__ == "__main__":
    main()
