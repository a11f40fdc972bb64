"""Our fit beside scikit-rf's `VectorFitting.auto_fit`, scipy's AAA and pyEMA: `python benchmarks/fits.py`.

Prints Markdown: a measured beam, synthetic beams and plates. CPU is `time.process_time` in this process, the
best of three, with one thread for linear algebra. "Error" is the relative rms difference from the response
as measured. AAA is told to stop at 2 %; pyEMA is told every natural frequency, which the others find.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.util
import io
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
import scipy
from skrf import Frequency, Network
from skrf.vectorFitting import VectorFitting
from threadpoolctl import threadpool_limits

from benchmarks.synthetic_responses import Case, beam, plate, response_of
from benchmarks.table import Row, ratios
from haploop.calibration import Model, fit

BEAM = Path(__file__).parents[1] / "tests" / "data" / "beam_accelerance_point1.txt"
BEAM_HZ = np.array([51.5, 142.2, 278.7, 460.4, 687.2, 958.5])
"""Natural frequencies of the measured beam, read off its peaks."""


class Responses(Network):
    """Network without a test for passivity, which has no meaning here and would cost time."""

    def is_passive(self, *_: object) -> bool:
        return False


def auto_fit(case: Case) -> np.ndarray:
    """Response of scikit-rf's fit with its default settings."""
    f, H = case.response.frequencies, case.response.velocity
    largest = np.abs(H).max()
    fitting = VectorFitting(
        Responses(frequency=Frequency.from_f(f, unit="hz"), s=(H / largest)[:, None, None])
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        fitting.auto_fit()
    return np.asarray(fitting.get_model_response(0, 0, f) * largest)


def aaa(case: Case) -> np.ndarray:
    """Response of scipy's AAA, which interpolates noise where it may use more terms."""
    from scipy.interpolate import AAA

    s = 2j * np.pi * case.response.frequencies
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return np.asarray(AAA(s, case.response.velocity, rtol=0.02)(s))


def pyema(case: Case) -> np.ndarray:
    """Response of pyEMA's poles and modal constants (LSCF, LSFD), near the natural frequencies given."""
    import pyEMA

    f = case.response.frequencies
    s = 2j * np.pi * f
    receptance = case.response.velocity / s
    said = io.StringIO()
    with warnings.catch_warnings(), contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
        warnings.simplefilter("ignore")
        band: dict[str, Any] = {"lower": f[0], "upper": f[-1]}
        model = pyEMA.Model(receptance[None], f, **band, pol_order_high=60, frf_type="receptance")
        model.get_poles(show_progress=False)
        model.select_closest_poles(list(case.natural))
        _, constants = model.get_constants()
    a, damping = np.ravel(constants), np.asarray(model.nat_xi)
    pole = 2 * np.pi * np.asarray(model.nat_freq) * (-damping + 1j * np.sqrt(1 - damping**2))
    modal = (a / (s[:, None] - pole) + a.conj() / (s[:, None] - pole.conj())).sum(axis=1)
    # Its residual terms. Its own sum of all has another grid than a response that begins above 0 Hz.
    rest = np.stack([s**-2, np.ones_like(s)], axis=1)
    return np.asarray(s * (modal + rest @ np.linalg.lstsq(rest, receptance - modal, rcond=None)[0]))


PEERS: dict[str, Callable[[Case], np.ndarray]] = {"scikit-rf, auto_fit": auto_fit}
if hasattr(scipy.interpolate, "AAA"):
    PEERS["scipy, AAA"] = aaa
if importlib.util.find_spec("pyEMA"):
    PEERS["pyEMA, told the frequencies"] = pyema


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
    """Print one row for each peer: medians of the errors, sums of resonances and of CPU times.

    Nothing without cases.
    """
    if not cases:
        return []
    cpu, hits, extra, pairs = ([] for _ in range(4))
    seconds: dict[str, list[float]] = {peer: [] for peer in PEERS}
    off: dict[str, list[float]] = {peer: [] for peer in ("", *PEERS)}
    true: dict[str, list[float]] = {peer: [] for peer in ("", *PEERS)}
    for case in cases:
        f, H = case.response.frequencies, case.response.velocity
        model, taken = timed(lambda case=case: fit(case.response))
        cpu.append(taken)
        fitted = {"": model.velocity(f)}
        for peer, work in PEERS.items():
            fitted[peer], taken = timed(lambda case=case, work=work: work(case))
            seconds[peer].append(taken)
        for peer, found_ in fitted.items():
            off[peer].append(float(np.linalg.norm(found_ - H) / np.linalg.norm(H)))
            true[peer].append(float(np.linalg.norm(found_ - case.truth) / np.linalg.norm(case.truth)))
        hit, more = found(model, case.natural)
        hits.append(hit)
        extra.append(more)
        pairs.append(int((model.poles.imag > 0).sum()))
    known = len(cases) > 1
    rows = []
    for peer in PEERS:
        worse = sum(a > b for a, b in zip(off[""], off[peer], strict=True))
        print(
            f"| {name} | {len(cases)} | {peer} | {np.median(off['']):.2%} | {np.median(off[peer]):.2%} "
            f"| {worse} | "
            + (f"{np.median(true['']):.2%} | {np.median(true[peer]):.2%} | " if known else "| | ")
            + f"{sum(hits)} / {sum(len(c.natural) for c in cases)} | {sum(extra)} | {np.median(pairs):.0f} | "
            f"{1e3 * np.mean(cpu):.0f} ms | {sum(cpu) / sum(seconds[peer]):.2f} |",
            flush=True,
        )
        rows += [
            Row(f"fit, {name}: CPU", cpu, "s", peer, ratios(cpu, seconds[peer]), "0.7 s"),
            Row(f"fit, {name}: error", [100 * one for one in off[""]], "%", peer, ratios(off[""], off[peer])),
        ]
    return rows


def main(words: Sequence[str] | None = None) -> list[Row]:
    """Print the table, and return its figures, a round for each response."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=30, help="synthetic responses of each kind; 0: none")
    options = parser.parse_args(words)
    accelerance = np.array([complex(line) for line in BEAM.read_text().split()])
    f = np.arange(len(accelerance), dtype=np.float64)
    kept = f >= 10
    f, accelerance = f[kept], accelerance[kept]
    velocity = accelerance / (2j * np.pi * f)
    print(
        "| response | number | beside | error | peer's | worse | from the truth | peer's | resonances "
        "| extra | pole pairs | CPU | over the peer's |"
    )
    print("|" + "---|" * 13)
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
    return rows


if __name__ == "__main__":
    main()
