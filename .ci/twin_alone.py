"""nidaqmx_twin by itself: installed from its folder into an empty environment, where its own tests and the
blocks of its README run; and its source distribution, from which the same is installed.
`python .ci/twin_alone.py SOURCE`, a clone: a build leaves files behind.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

FENCE = re.compile(r"^```(\w+)\n(?:# ([\w.]+)\n)?(.*?)^```$", re.MULTILINE | re.DOTALL)
CONFTEST = """import signal

import pytest

signal.signal(signal.SIGINT, signal.default_int_handler)  # what a shell starts in the background ignores it


@pytest.fixture(scope="session")
def full():
    return False
"""
SETTINGS = (
    "[pytest]\naddopts = --import-mode=importlib\npythonpath = .\nfilterwarnings = error\ntimeout = 900\n"
    "markers = long\n"
)
NOTHING_OF_HAPLOOP = (
    "import importlib.util, nidaqmx_twin as t; assert importlib.util.find_spec('haploop') is None; t.NiTwin"
)


def copy_tests(source: Path, target: Path) -> None:
    """Copy the tests, which name the package and `base` as haploop has them."""
    shutil.copytree(source, target / "tests" / "nidaqmx_twin", ignore=shutil.ignore_patterns("__pycache__"))
    for path in (target / "tests").rglob("*.py"):
        text = path.read_text(encoding="utf-8").replace("haploop.nidaqmx_twin", "nidaqmx_twin")
        path.write_text(text.replace("haploop.base", "nidaqmx_twin.base"), encoding="utf-8")
    (target / "tests" / "__init__.py").touch()
    (target / "tests" / "conftest.py").write_text(CONFTEST, encoding="utf-8")
    (target / "pytest.ini").write_text(SETTINGS, encoding="utf-8")


def same_from_sources(folder: Path, python: Path, work: Path) -> None:
    """Build the source distribution of `folder`, and compare what it installs with what the folder did."""
    build = "import sys; from setuptools import build_meta; build_meta.build_sdist(sys.argv[1])"
    subprocess.run([sys.executable, "-c", build, work], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    (made,) = work.glob("*.tar.gz")
    other = work / "other"
    install = [python, "-m", "pip", "--quiet", "install", "--no-deps", "--target", other, made]
    subprocess.run(install, check=True)
    where = "import nidaqmx_twin as t; print(t.__path__[0])"
    found = subprocess.run([python, "-c", where], cwd=work, check=True, capture_output=True, text=True)
    first, second = (
        {path.relative_to(top): path.read_bytes() for path in top.rglob("*.*") if path.suffix != ".pyc"}
        for top in (Path(found.stdout.strip()), other / "nidaqmx_twin")
    )
    assert first == second, f"{made.name} installs other files: {first.keys() ^ second.keys()}"


def main(source: Path) -> None:
    """Install, test, and follow the README."""
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        venv.create(work / "empty", with_pip=True)
        python = work / "empty" / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
        names = f"{source.resolve() / 'nidaqmx_twin'}[test]"
        subprocess.run([python, "-m", "pip", "--quiet", "install", names], check=True)
        subprocess.run([python, "-c", NOTHING_OF_HAPLOOP], cwd=work, check=True)
        same_from_sources(source / "nidaqmx_twin", python, work)
        copy_tests(source / "tests" / "nidaqmx_twin", work)
        subprocess.run([python, "-m", "pytest", "-q"], cwd=work, check=True)
        page = work / "page"
        page.mkdir()
        path = os.pathsep.join([str(python.parent), os.environ["PATH"]])
        for language, name, text in FENCE.findall((source / "nidaqmx_twin" / "README.md").read_text("utf-8")):
            if name:
                (page / name).write_text(text, encoding="utf-8")
            elif language == "sh" and "pip install" not in text:
                subprocess.run(["bash", "-ec", text], cwd=page, env={**os.environ, "PATH": path}, check=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
