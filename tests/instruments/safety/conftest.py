"""Hardware that is served from a plant in real time, and the place where this computer keeps its locks."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from haploop.instruments import load_rig_file
from haploop.mocks.simulation import Simulation
from tests.instruments.safety.lab import serve


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Path]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("haploop.instruments.safety.machine._place", lambda: tmp_path / "place")
        yield tmp_path / "place"


@pytest.fixture
def lab(tmp_path: Path) -> Iterator[tuple[Path, Simulation]]:
    """A rig file of hardware, and the plant behind that."""
    path = tmp_path / "lab.toml"
    world, at = serve(load_rig_file("haptable"), dead_man=1.0)
    path.write_text(
        f'base = "haptable"\nname = "lab"\n[daq]\nserver = "{at["server"]}"\n'
        f'[relay]\nhub = "{at["hub"]}"\ndead_man = 1.0\n'
    )
    yield path, world
    world.close()
