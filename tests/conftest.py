"""The plugin that haploop ships gives the rig; two of its things have shorter names in this suite."""

from __future__ import annotations

import pytest

from haploop.pytest_plugin import OpenRig

__all__ = ["OpenRig"]


@pytest.fixture(scope="session")
def mode(request: pytest.FixtureRequest) -> str:
    """What --rig names."""
    return str(request.config.getoption("--rig"))


@pytest.fixture
def open(open_rig: OpenRig) -> OpenRig:
    """See `haploop.pytest_plugin.open_rig`."""
    return open_rig
