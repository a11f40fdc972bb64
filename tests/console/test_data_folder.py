"""A page names files in one folder, and no others."""

import pytest
from starlette.applications import Starlette
from starlette.testclient import TestClient

from haploop.base.errors import ConfigurationError
from haploop.console.data_folder import DataFolder
from haploop.console.server.data_routes import data_routes


@pytest.mark.parametrize(
    "name",
    [
        "", "/etc/passwd", "../secret.h5", "recordings/../../secret.h5", "recordings//x.h5", ".hidden",
        "recordings/.P01.h5.lock", "C:/secret.h5", "recordings\\..\\..\\secret.h5", "a\0b", "<script>",
        "x" * 256 + ".h5", "é" * 128, "/".join(["folder"] * 900), "\ud800", None,
        ["recordings"],
    ],
)  # fmt: skip
def test_a_name_that_leads_elsewhere_is_refused(tmp_path, name):
    with pytest.raises(ConfigurationError, match="no file of the console's data folder"):
        DataFolder(tmp_path / "data", tmp_path / "history").path(name)


def test_no_route_fails_at_a_name_that_no_file_system_takes(tmp_path):
    routes = data_routes(DataFolder(tmp_path, tmp_path / "history"))
    page = TestClient(Starlette(routes=routes))
    for route in routes:
        for name in ("x" * 300 + ".h5", "a/" * 3000 + "b", ".", "\n"):
            for key in ("file", "check", "map", "study", "experiment"):
                answer = page.get(route.path, params={"file": "a.h5", key: name})
                assert answer.status_code in (200, 404, 409), (route.path, key, answer.text)


def test_a_name_and_its_path_lead_to_each_other(tmp_path):
    data = DataFolder(tmp_path, tmp_path / "history")
    assert data.path("recordings/P01-latch.h5") == tmp_path.resolve() / "recordings" / "P01-latch.h5"
    assert data.name(data.path("a study/recordings/P01.h5")) == "a study/recordings/P01.h5"
