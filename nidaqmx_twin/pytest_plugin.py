"""The fixture `nidaqmx_twin`, and the mark that names its cards."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from .twin import NiTwin

MARK = (
    'nidaqmx(Dev1="PCIe-6363", ..., time="virtual"): cards of the fixture nidaqmx_twin; '
    'nidaqmx("cards.ini"): those of a text export of NI MAX'
)


def pytest_configure(config: pytest.Config) -> None:
    """Register the mark."""
    config.addinivalue_line("markers", MARK)


@pytest.fixture
def nidaqmx_twin(request: pytest.FixtureRequest) -> Iterator[NiTwin]:
    """Simulated NI cards, which `nidaqmx.Task()` and `System.local()` use in code that is unchanged.

    The mark `nidaqmx` names them: `@pytest.mark.nidaqmx(Dev1="PCIe-6363")`; without it there is that one.
    """
    from .twin import NiTwin  # noqa: PLC0415

    mark = request.node.get_closest_marker("nidaqmx")
    words = dict(mark.kwargs) if mark else {}
    time = words.pop("time", "virtual")
    listed = request.config.rootpath / mark.args[0] if mark and mark.args else None
    with NiTwin(listed or words or {"Dev1": "PCIe-6363"}, time=time) as twin:
        yield twin
