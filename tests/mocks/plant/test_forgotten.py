"""A simulated world that nobody has any more is gone at once, not when Python next looks for cycles."""

import gc
import weakref
from collections.abc import Iterator

import numpy as np
import pytest

from haploop.instruments import open_rig
from haploop.mocks.plant import Plant


@pytest.fixture(autouse=True)
def _no_collection() -> Iterator[None]:
    gc.disable()
    yield
    gc.enable()


def plant_of_a_closed_rig(name: str) -> weakref.ref[Plant]:
    with open_rig(name, simulate="twin") as rig:
        t = np.arange(2000) / rig.table.rate_hz
        rig.excite(10 * np.sin(2 * np.pi * 250 * t) * np.hanning(2000), ["A"], ["laser"])
        return weakref.ref(rig.simulation.plant)


@pytest.mark.parametrize("name", ["simulated", "sound-card", "four-channel"])
def test_a_closed_rig_takes_its_plant_with_it(name):
    assert plant_of_a_closed_rig(name)() is None
