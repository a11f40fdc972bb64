"""Builds the package by itself, with `base` copied into it. All else is in pyproject.toml."""

import re
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py
from setuptools.command.sdist import sdist

HERE = Path(__file__).parent
CLONE = HERE.parent
INSIDE = (HERE / "PKG-INFO").is_file()
"""True in an unpacked source distribution, which has `base` and its version in it."""
if not INSIDE and not (CLONE / "base" / "errors.py").is_file():
    sys.exit("Build nidaqmx_twin in a clone of haploop: the folder base, which it needs, is not beside it.")

WRITTEN, PATTERN = (
    (HERE / "PKG-INFO", r"^Version: (.*)$") if INSIDE else (CLONE / "__init__.py", r'^__version__ = "(.*)"$')
)
VERSION = re.search(PATTERN, WRITTEN.read_text(encoding="utf-8"), re.MULTILINE)
TO_BASE = re.compile(r"^(\s*from \.+)\.(?=base\b)", re.MULTILINE)
"""An import from `base`, which is a folder lower here than in haploop."""


class Modules(build_py):
    """The modules of each package without this file, with their imports from `base` as they are here."""

    def find_package_modules(self, package: str, package_dir: str) -> list[tuple[str, str, str]]:
        """Return (package, module, file) of each module."""
        return [found for found in super().find_package_modules(package, package_dir) if found[1] != "setup"]

    def build_module(self, module: str, module_file: str, package: str) -> object:
        """Copy a module."""
        built = super().build_module(module, module_file, package)
        copy = Path(built[0])
        copy.write_text(TO_BASE.sub(r"\1", copy.read_text(encoding="utf-8")), encoding="utf-8")
        return built


class Sources(sdist):
    """A source distribution with `base` in it."""

    def make_release_tree(self, base_dir: str, files: Sequence[str]) -> None:
        """Copy the files; those of a folder beside this one would be copied beside the distribution."""
        super().make_release_tree(base_dir, [file for file in files if not file.startswith("..")])
        beside = HERE / "base" if INSIDE else CLONE / "base"
        shutil.copytree(
            beside, Path(base_dir) / "base", ignore=shutil.ignore_patterns("__pycache__"), dirs_exist_ok=True
        )


setup(
    version=VERSION[1] if VERSION else "0",
    packages=["nidaqmx_twin", "nidaqmx_twin.redirect", "nidaqmx_twin.base"],
    package_dir={"nidaqmx_twin": ".", "nidaqmx_twin.base": "base" if INSIDE else "../base"},
    cmdclass={"build_py": Modules, "sdist": Sources},
)
