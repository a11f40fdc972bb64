"""One suite for twin, wire and hardware: `pytest --rig twin|wire|FILE`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import pytest

from instruments import Rig, open_rig

OpenRig = Callable[..., Rig]


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--rig", default="twin", help="twin, wire, or the rig file of a lab's own hardware")


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "rig: runs on an open rig, and so on whatever --rig names")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if "open" in getattr(item, "fixturenames", ()):
            item.add_marker("rig")


@pytest.fixture(scope="session")
def mode(request: pytest.FixtureRequest) -> str:
    """What --rig names."""
    return str(request.config.getoption("--rig"))


@pytest.fixture
def open(mode: str) -> Iterator[OpenRig]:  # noqa: A001
    """Opens a rig as --rig asks; its arguments choose another plant, which hardware cannot do."""
    with ExitStack() as stack:

        def opener(name: str = "simulated", **simulation: Any) -> Rig:
            if mode in ("twin", "wire"):
                rig = open_rig(name, simulate="wire" if mode == "wire" else "twin", simulation=simulation)
            elif simulation:
                pytest.skip("another plant exists in a simulation only")
            else:
                rig = open_rig(mode)
            return stack.enter_context(rig)

        yield opener
