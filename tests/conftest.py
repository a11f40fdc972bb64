"""The plugin that haploop ships gives the rig; two of its things have shorter names in this suite."""

from __future__ import annotations

import pytest

from haploop.pytest_plugin import OpenRig

__all__ = ["OpenRig"]


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--full`: experiments at their whole size, which takes hours, not minutes."""
    parser.addoption("--full", action="store_true", help="run long experiments at their full size")


@pytest.fixture(scope="session")
def full(request: pytest.FixtureRequest) -> bool:
    """Whether a long experiment is to run at its full size, and not only far enough to see it work."""
    return bool(request.config.getoption("--full"))


@pytest.fixture(scope="session")
def mode(request: pytest.FixtureRequest) -> str:
    """What --rig names."""
    return str(request.config.getoption("--rig"))


@pytest.fixture
def open(open_rig: OpenRig) -> OpenRig:
    """See `haploop.pytest_plugin.open_rig`."""
    return open_rig
