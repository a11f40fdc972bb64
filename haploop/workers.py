"""Processes that work through a list of files side by side."""

from __future__ import annotations

import multiprocessing
from concurrent.futures import ProcessPoolExecutor

__all__ = ["worker_pool"]


def worker_pool(count: int | None, *needs: str) -> ProcessPoolExecutor:
    """Create a pool of `count` processes, None for one a core, that have these modules loaded.

    Each worker is forked from a process that has loaded them and does nothing else: spawned, each would
    load them anew (on Windows they are). Not from this one, because a fork would take the threads' locks of
    the HDF5 library along.
    """
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return ProcessPoolExecutor(count, multiprocessing.get_context("spawn"))
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([*needs])
    return ProcessPoolExecutor(count, context)
