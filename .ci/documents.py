"""Hook of mkdocs (mkdocs.yml): the reference reads docstrings in a tree where path and import name agree.

The rooms are folders at the root and are imported as `haploop.instruments` and so on. Griffe finds a module
by its path, as mypy does; the sources are copied into such a tree, and nothing is built or installed.
"""

from __future__ import annotations

import shutil
import tempfile
import tomllib
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.plugins import event_priority

ROOT = Path(__file__).resolve().parents[1]
_TREES: list[tempfile.TemporaryDirectory[str]] = []


@event_priority(100)  # before mkdocstrings reads its own
def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Lay out the sources as they are imported, and let mkdocstrings search them."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    _TREES.append(tempfile.TemporaryDirectory())  # removed when the program ends
    tree = Path(_TREES[-1].name)
    places = {"haploop": "haploop", **project["tool"]["setuptools"]["package-dir"]}
    for name, folder in places.items():
        target = tree / name.replace(".", "/")
        shutil.copytree(ROOT / folder, target, ignore=shutil.ignore_patterns("__pycache__"))
    config.plugins["mkdocstrings"].config["handlers"]["python"]["paths"] = [str(tree)]
    # The decisions, in the order of their numbers: a new one needs no other entry.
    pages = sorted(page.name for page in (ROOT / "docs" / "decisions").glob("[0-9]*.md"))
    for part in config.nav or []:
        if "Decisions" in part:
            part["Decisions"] += [f"decisions/{name}" for name in pages]
    return config
