"""Names the packages: the folders at the root, as parts of `haploop`. All else is in pyproject.toml."""

from setuptools import find_packages, setup

_CLIENTS = ("tests", "benchmarks", "examples", "docs")

_ROOMS = find_packages(exclude=[pattern for name in _CLIENTS for pattern in (name, f"{name}.*")])

setup(packages=["haploop", *(f"haploop.{room}" for room in _ROOMS)])
