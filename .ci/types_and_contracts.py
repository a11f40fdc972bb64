"""Run the type checker and the import contracts on an installed copy of the tree.

Usage: python .ci/types_and_contracts.py, in an environment with haploop[test]. The rooms are folders at the
root and are imported as `haploop.instruments` and so on. mypy and import-linter find a module by its path, so
they run where path and import name agree: in a folder into which haploop was installed.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LIST_FILES = ("git", "ls-files", "-z", "--cached", "--others", "--exclude-standard")


def copy_sources(target: Path) -> None:
    """Copy every file that git tracks or would track. A build would leave files behind in the checkout."""
    names = subprocess.run(LIST_FILES, cwd=ROOT, check=True, capture_output=True).stdout.decode().split("\0")
    for name in names:
        source = ROOT / name
        if name and source.is_file():  # a file that was deleted is listed until the deletion is staged
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(source, target / name)


def main() -> int:
    """Build the tree, run both tools even if the first one fails, and return 1 if one of them did."""
    with tempfile.TemporaryDirectory() as folder:
        source, tree = Path(folder, "source"), Path(folder, "tree")
        copy_sources(source)
        pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", tree, source]
        subprocess.run(pip, check=True)
        shutil.copy(ROOT / "pyproject.toml", tree)
        lint_imports = shutil.which("lint-imports", path=sysconfig.get_path("scripts"))
        if lint_imports is None:
            raise SystemExit('lint-imports is not installed: python -m pip install -e ".[test]"')
        commands = ([sys.executable, "-m", "mypy"], [lint_imports])
        codes = [subprocess.run(command, cwd=tree, check=False).returncode for command in commands]
    return int(any(codes))


if __name__ == "__main__":
    raise SystemExit(main())
