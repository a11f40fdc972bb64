"""Hook of mkdocs (mkdocs.yml): the reference reads docstrings from the checkout, under the name haploop.

The root is the package, and Griffe finds a module by its path; a checkout may be called otherwise.
"""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.plugins import event_priority

ROOT = Path(__file__).resolve().parents[1]
_SKIPPED = ("__pycache__", ".*", "tests", "benchmarks", "examples", "docs", "site", "build")
_TREES: list[tempfile.TemporaryDirectory[str]] = []


@event_priority(100)  # before mkdocstrings reads its own
def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Copy the sources to a folder called haploop, and let mkdocstrings search it."""
    _TREES.append(tempfile.TemporaryDirectory())  # removed when the program ends
    package = Path(_TREES[-1].name) / "haploop"
    skipped = shutil.ignore_patterns(
        "__pycache__", ".*", "tests", "benchmarks", "examples", "docs", "site", "build"
    )
    shutil.copytree(ROOT, package, ignore=skipped)
    config.plugins["mkdocstrings"].config["handlers"]["python"]["paths"] = [str(package.parent)]
    return config
