"""Finds the packages: every folder at the root with an `__init__`, as a part of `haploop`. All else is in
pyproject.toml.
"""

from setuptools import find_packages, setup
from setuptools.command.build_py import build_py

ROOMS = find_packages(exclude=["tests", "tests.*"])


class Modules(build_py):
    """The modules of each package, without this file, which lies in the folder of `haploop` itself."""

    def find_package_modules(self, package: str, package_dir: str) -> list[tuple[str, str, str]]:
        """Return (package, module, file) of each module."""
        return [found for found in super().find_package_modules(package, package_dir) if found[1] != "setup"]


setup(packages=["haploop", *(f"haploop.{room}" for room in ROOMS)], cmdclass={"build_py": Modules})
