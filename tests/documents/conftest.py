"""Which pages run: README always, the others with `--pages`, as CI does."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.documents.pages import name_of

ALWAYS = ("README.md",)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if config.getoption("--pages"):
        return
    here = Path(__file__).parent
    for item in items:
        callspec = getattr(item, "callspec", None)
        path = callspec.params.get("path") if callspec and item.path.parent == here else None
        if path is not None and name_of(path) not in ALWAYS:
            item.add_marker(pytest.mark.skip(reason="runs with --pages"))
