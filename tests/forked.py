"""Processes that begin with everything imported, so that they cost what they do, and are killed in it."""

from __future__ import annotations

import importlib
import multiprocessing
import tempfile
from multiprocessing.context import BaseContext
from pathlib import Path

import pytest

__all__ = ["context"]

_IMPORTED = (
    "haploop.acquisition.session.processing", "scipy.signal", "pytest", "tests.acquisition.recording.pattern",
    "tests.acquisition.session.studying",
)  # fmt: skip


def context() -> BaseContext:
    """The one server of this worker's tests, whoever is first, forks them; spawned where there is none."""
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    found = multiprocessing.get_context("forkserver")
    found.set_forkserver_preload([*_IMPORTED])
    with pytest.MonkeyPatch.context() as patch:
        # Before 3.13 it is not told sys.path.
        patch.setenv("PYTHONPATH", str(Path(__file__).parents[1]))
        # Its socket outlives this session's temporary folder.
        for name in ("TMPDIR", "TEMP", "TMP"):
            patch.delenv(name, raising=False)
        patch.setattr(tempfile, "tempdir", None)
        importlib.import_module("multiprocessing.forkserver").ensure_running()
    return found
