"""Which pages run: README always, all others with `--night`."""

from pathlib import Path

import pytest

from tests.documents.pages import name_of


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    here = Path(__file__).parent
    for item in items:
        callspec = getattr(item, "callspec", None)
        path = callspec.params.get("path") if callspec and item.path.parent == here else None
        if path is not None and name_of(path) != "README.md":
            item.add_marker(pytest.mark.night)
