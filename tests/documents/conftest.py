"""Which pages run: README always, the tutorial with `--long`, as in CI, all with `--pages`, as each night."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.documents.pages import name_of


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    here = Path(__file__).parent
    for item in items:
        callspec = getattr(item, "callspec", None)
        path = callspec.params.get("path") if callspec and item.path.parent == here else None
        name = "" if path is None else name_of(path)
        if name == "docs/tutorial.md":
            item.add_marker(pytest.mark.long)
        elif name not in ("", "README.md") and not config.getoption("--pages"):
            item.add_marker(pytest.mark.skip(reason="runs with --pages"))
