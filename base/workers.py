"""Processes that work through a list of files side by side."""

from __future__ import annotations

import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor
from threading import Thread


def worker_pool(count: int | None, *needs: str) -> ProcessPoolExecutor:
    """Create a pool of `count` processes, None for one a core, that have these modules loaded.

    Each worker is forked from a process that has loaded them and does nothing else: spawned, each would
    load them anew (on Windows they are). Not from this one, because a fork would take the threads' locks of
    the HDF5 library along. Workers end when this process does, however it ends.
    """
    forks = "forkserver" in multiprocessing.get_all_start_methods()
    context = multiprocessing.get_context("forkserver" if forks else "spawn")
    if forks:
        context.set_forkserver_preload([*needs])
    return ProcessPoolExecutor(count, context, initializer=_begin)


def _begin() -> None:
    Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)
