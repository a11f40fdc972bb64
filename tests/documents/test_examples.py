"""Each name that the tab key finds has an example in its docstring; all run, in the order of a day's work."""

from __future__ import annotations

import doctest
from importlib.util import find_spec

import pytest

import haploop

NEEDS = {"analyse_thresholds": "psignifit"}
"""Packages that an example needs beside haploop."""


@pytest.mark.long
def test_each_example_runs(tmp_path, monkeypatch):
    """In one folder, empty at first: an example may use the files that those before it have written.

    `rig` is open; its table has the fewest modes, so that all of it takes seconds.
    """
    monkeypatch.chdir(tmp_path)
    runner, told = doctest.DocTestRunner(verbose=False), list[str]()
    with haploop.open_rig("simulated", simulation={"highest_hz": 843.2}) as rig:
        for name in haploop.__dir__():
            if name in NEEDS and find_spec(NEEDS[name]) is None:
                continue
            text = getattr(haploop, name).__doc__
            found = doctest.DocTestParser().get_doctest(
                text, {"haploop": haploop, "rig": rig}, name, None, None
            )
            assert found.examples, f"haploop.{name} has no example in its docstring."
            runner.run(found, out=told.append)
    assert runner.tries >= 100 and not told, "".join(told)
