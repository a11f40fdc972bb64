"""Error and speed of methods for the representative press: `python -m benchmarks.representative`.

Errors are against the template that the presses were made from. Each row is one method over all seeds:
user time per 120 presses as a ratio to the paper's two-level barycentre, root mean square of the error
as a ratio to what true warps would leave, shape error (once the best smooth warp is taken away), and the
error of the third-octave spectrum.
"""

from __future__ import annotations

import argparse
import importlib.util
import platform
import time
import warnings
from collections import defaultdict
from collections.abc import Callable, Iterator

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.synthetic_presses import FAMILIES, RATE, Curve, error, shape_error, spectrum_error
from haploop.acquisition.presses.averaging import BARYCENTRE, average, barycentre
from haploop.acquisition.presses.registration import WarpModel, register

WINDOW = WarpModel().window(RATE)


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


def registered(curves: Curve) -> Curve:
    """The product's registration alone."""
    return register(curves[:, None], RATE, None, barycentre(curves, WINDOW)).template[0]


def chosen(curves: Curve) -> Curve:
    """The product: both methods, their scores, and the better one."""
    return average(list(curves[:, :, None]), RATE).template[0]


def peers() -> Iterator[tuple[str, Callable[[Curve], Curve]]]:
    """Barycentres of other libraries, where they are installed."""
    share = WINDOW / 2000
    if importlib.util.find_spec("aeon"):
        from aeon.clustering.averaging import elastic_barycenter_average

        yield (
            "aeon, two levels",
            two_levels(lambda c: elastic_barycenter_average(c[:, None], window=share, max_iters=5)[0]),
        )
    if importlib.util.find_spec("tslearn"):
        from tslearn.barycenters import dtw_barycenter_averaging

        yield (
            "tslearn, two levels",
            two_levels(
                lambda c: dtw_barycenter_averaging(
                    c[..., None], max_iter=5, metric_params={"sakoe_chiba_radius": WINDOW}
                )[:, 0]
            ),
        )


def main() -> None:
    """Print the table, in Markdown."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seeds", type=int, nargs="+", default=[100, 101, 102])
    parser.add_argument("--families", nargs="+", default=list(FAMILIES))
    parser.add_argument("--noise", type=float, default=0.05)
    args = parser.parse_args()
    methods = {
        "mean at activation": mean,
        "cross-correlation mean": correlated,
        BARYCENTRE: two_levels(lambda c: barycentre(c, WINDOW)),
        "two-level registration": two_levels(registered),
        "**haploop**: both, and the choice": chosen,
        **dict(peers()),
    }
    print(f"{platform.machine()}, Python {platform.python_version()}, numpy {np.__version__}; ", end="")
    print(f"12 x 10 presses of 0.4 s, noise {args.noise:.0%}, seeds {args.seeds}\n")
    print("| presses | method | user time, ratio | error / limit | shape error | spectrum error |")
    print("|---|---|---|---|---|---|")
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
                taken, mine, limits, shape, spectrum = np.sqrt(np.mean(np.square(measured), axis=0))
                print(
                    f"| {family}, {kind} | {name} | {taken / unit:.2f} ({taken:.1f} s) "
                    f"| {mine / limits:.2f} | "
                    f"{shape:.3f} | {spectrum:.3f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
