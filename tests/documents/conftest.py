"""Which pages run: README and tutorial always, the others with `--pages`, as CI does."""

from __future__ import annotations

import pytest

from tests.documents.pages import name_of

ALWAYS = ("README.md", "docs/tutorial.md")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if config.getoption("--pages"):
        return
    for item in items:
        path = getattr(item, "callspec", None) and item.callspec.params.get("path")
        if path and name_of(path) not in ALWAYS:
            item.add_marker(pytest.mark.skip(reason="runs with --pages"))
