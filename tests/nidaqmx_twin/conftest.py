"""The devices of an export behind the wire, and tasks of the real nidaqmx on them."""

from collections.abc import Iterator

import nidaqmx
import pytest

from haploop.nidaqmx_twin import NiServer, devices_from_ini
from tests.nidaqmx_twin.ni_client import EXPORT, connected


@pytest.fixture(scope="module")
def server() -> Iterator[NiServer]:
    with NiServer(devices_from_ini(EXPORT)) as server:
        yield server


@pytest.fixture(scope="module")
def options(server: NiServer) -> Iterator[nidaqmx.GrpcSessionOptions]:
    with connected(server) as options:
        yield options


@pytest.fixture
def task(options: nidaqmx.GrpcSessionOptions) -> Iterator[nidaqmx.Task]:
    with nidaqmx.Task(grpc_options=options) as task:
        yield task


@pytest.fixture
def other(options: nidaqmx.GrpcSessionOptions) -> Iterator[nidaqmx.Task]:
    with nidaqmx.Task(grpc_options=options) as task:
        yield task
