"""Run the type checker and the import contracts on a copy of the tree.

Usage: python .ci/types_and_contracts.py, in an environment with haploop[test]. The rooms are folders at the
root and are imported as `haploop.instruments` and so on. mypy and import-linter find a module by its path, so
they run in a folder where path and import name agree.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import sysconfig
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LIST_FILES = ("git", "ls-files", "-z", "--cached", "--others", "--exclude-standard")


def copy_sources(tree: Path) -> None:
    """Copy every file that git tracks or would track to where it is imported from."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    rooms = {
        folder: package.replace(".", "/")
        for package, folder in project["tool"]["setuptools"]["package-dir"].items()
    }
    names = subprocess.run(LIST_FILES, cwd=ROOT, check=True, capture_output=True).stdout.decode().split("\0")
    for name in names:
        top, _, within = name.partition("/")
        source, target = ROOT / name, tree / rooms.get(top, top) / within
        if name and source.is_file():  # a file that was deleted is listed until the deletion is staged
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(source, target)


def main() -> int:
    """Run both tools even if the first one fails, and return 1 if one of them did."""
    lint_imports = shutil.which("lint-imports", path=sysconfig.get_path("scripts"))
    if lint_imports is None:
        raise SystemExit('lint-imports is not installed: python -m pip install -e ".[test]"')
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder)
        copy_sources(tree)
        commands = ([sys.executable, "-m", "mypy"], [lint_imports])
        codes = [subprocess.run(command, cwd=tree, check=False).returncode for command in commands]
    return int(any(codes))


if __name__ == "__main__":
    raise SystemExit(main())
