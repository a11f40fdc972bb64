"""Error and speed of methods for the representative press: `python -m benchmarks.representative`.

Errors are against the template that the presses were made from. Each row is one method over all seeds:
user time per 120 presses as a ratio to the paper's two-level barycentre, root mean square of the error
as a ratio to what true warps would leave, shape error (once the best smooth warp is taken away), and the
error of the third-octave spectrum.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib.util
import platform
import sys
import time
import warnings
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
from dtaidistance import dtw_barycenter
from threadpoolctl import threadpool_limits

from benchmarks.synthetic_presses import (
    FAMILIES,
    RATE,
    Curve,
    Presses,
    chance,
    error,
    shape_error,
    spectrum_error,
)
from benchmarks.table import Row, ratios
from haploop.acquisition.presses.averaging import BARYCENTRE, REGISTRATION, average
from haploop.acquisition.presses.barycentre import barycentre
from haploop.acquisition.presses.registration import WarpModel, register

CHOSEN = "**haploop**: both, and the choice"
PACKAGES = {BARYCENTRE: "dtaidistance, two levels (the paper's)"}
WINDOW = WarpModel().window(RATE)
_ROUNDS = 5
"""Of the other libraries' barycentres."""


def mean(curves: Curve) -> Curve:
    """Of presses that are aligned at their activation, as they come."""
    return np.asarray(curves.mean(axis=(0, 1)))


def correlated(curves: Curve) -> Curve:
    """The mean of presses that are moved as a whole to where they correlate best with it, three times."""
    presses = curves.reshape(-1, curves.shape[-1])
    middle = presses.mean(axis=0)
    for _ in range(3):
        product = np.fft.irfft(np.fft.rfft(presses) * np.conj(np.fft.rfft(middle)), presses.shape[1])
        near = np.concatenate([np.arange(-WINDOW, 0), np.arange(WINDOW + 1)])
        lags = near[np.argmax(product[:, near], axis=1)]
        middle = np.mean([np.roll(p, -lag) for p, lag in zip(presses, lags, strict=True)], axis=0)
    return np.asarray(middle)


def two_levels(one: Callable[[Curve], Curve]) -> Callable[[Curve], Curve]:
    """A method for each participant's presses, and again for what that gave."""
    return lambda curves: one(np.stack([one(presses) for presses in curves]))


def paper(curves: Curve) -> Curve:
    """The paper's barycentre by dtaidistance, in as many rounds as the other libraries'."""
    near = curves[int(np.argmin(np.sum((curves - curves.mean(axis=0)) ** 2, axis=1)))]
    rows = [row.copy() for row in curves]
    return np.asarray(dtw_barycenter.dba_loop(rows, near.copy(), _ROUNDS, 1e-4, window=WINDOW, use_c=True))


def registered(curves: Curve) -> Curve:
    """The product's registration alone."""
    return register(curves[:, None], RATE, None, barycentre(curves, WINDOW)).template[0]


def chosen(curves: Curve) -> Curve:
    """The product: both methods, their scores, and the better one."""
    return average(list(curves[:, :, None]), RATE).template[0]


def unseen(family: str, kind: str, number: int) -> Presses:
    """Presses whose seed, amount and noise come from a hash. Ten of one person, and six of each of four."""
    seed = int(hashlib.sha256(f"{family} {kind} {number}".encode()).hexdigest()[:8], 16)
    rng = np.random.default_rng(seed)
    made = chance(rng) if family == "chance" else FAMILIES[family]
    noise = float(rng.choice([0.01, 0.03, 0.08]))
    people = (1, 10) if number % 2 else (4, 6)
    if kind == "jittered":
        return made.jittered(seed, *people, jitter=float(np.exp(rng.uniform(-6.2, -4.6))), noise=noise)
    return made.warped(seed, *people, stretch=float(rng.uniform(0.02, 0.08)), noise=noise)


def peers() -> Iterator[tuple[str, Callable[[Curve], Curve]]]:
    """Barycentres of other libraries, where they are installed."""
    share = WINDOW / 2000
    if importlib.util.find_spec("aeon"):
        from aeon.clustering.averaging import elastic_barycenter_average

        yield (
            "aeon, two levels",
            two_levels(lambda c: elastic_barycenter_average(c[:, None], window=share, max_iters=_ROUNDS)[0]),
        )
    if importlib.util.find_spec("tslearn"):
        from tslearn.barycenters import dtw_barycenter_averaging

        yield (
            "tslearn, two levels",
            two_levels(
                lambda c: dtw_barycenter_averaging(
                    c[..., None], max_iter=_ROUNDS, metric_params={"sakoe_chiba_radius": WINDOW}
                )[:, 0]
            ),
        )


def main(words: Sequence[str] | None = None) -> list[Row]:
    """Print the table, in Markdown, and return the product's figures beside every other method's."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seeds", type=int, nargs="+", default=[100, 101, 102])
    parser.add_argument("--families", nargs="+", default=list(FAMILIES))
    parser.add_argument("--noise", type=float, default=0.05)
    args = parser.parse_args(words)
    methods = {
        "mean at activation": mean,
        "cross-correlation mean": correlated,
        BARYCENTRE: two_levels(paper),
        REGISTRATION: two_levels(registered),
        CHOSEN: chosen,
        **dict(peers()),
    }
    print(f"{platform.machine()}, Python {platform.python_version()}, numpy {np.__version__}; ", end="")
    print(f"12 x 10 presses of 0.4 s, noise {args.noise:.0%}, seeds {args.seeds}\n")
    print("| presses | method | user time, ratio | error / limit | shape error | spectrum error |")
    print("|---|---|---|---|---|---|")
    every: dict[str, list[tuple[float, ...]]] = defaultdict(list)
    for family in args.families:
        for kind in ("warped", "jittered"):
            rows = defaultdict(list)
            for seed in args.seeds:
                presses = getattr(FAMILIES[family], kind)(seed, noise=args.noise)
                limit = error(presses.limit, presses.template)
                for name, method in methods.items():
                    with threadpool_limits(1), warnings.catch_warnings():
                        warnings.simplefilter("ignore")
                        begin = time.process_time()
                        found = method(presses.curves)
                        taken = time.process_time() - begin
                    rows[name].append(
                        (
                            taken,
                            error(found, presses.template),
                            limit,
                            shape_error(found, presses.template),
                            spectrum_error(found, presses.template),
                        )
                    )
            unit = np.mean([row[0] for row in rows[BARYCENTRE]])
            for name, measured in rows.items():
                every[name] += measured
                taken, mine, limits, shape, spectrum = np.sqrt(np.mean(np.square(measured), axis=0))
                print(
                    f"| {family}, {kind} | {name} | {taken / unit:.2f} ({taken:.1f} s) "
                    f"| {mine / limits:.2f} | "
                    f"{shape:.3f} | {spectrum:.3f} |",
                    flush=True,
                )
    found: list[Row] = []
    for place, what, unit in ((0, "CPU", "s"), (3, "shape error", "")):
        ours = [one[place] for one in every[CHOSEN]]
        for name, measured in every.items():
            if name not in (CHOSEN, REGISTRATION):
                goal = "2.5" if name == BARYCENTRE and not place else ""
                beside = ratios(ours, [one[place] for one in measured])
                what_ = f"representative press of 12 x 10 presses: {what}"
                found.append(Row(what_, ours, unit, PACKAGES.get(name, name), beside, goal))
    return found


if __name__ == "__main__":
    main()
