"""Check that a wheel of haploop installs one import name, with every file, beside a lab's own modules.

Usage: python .ci/one_name.py SOURCE. Builds a wheel of the checkout SOURCE, installs it into an empty
virtual environment, and runs a script beside which lie a lab's own `calibration.py`, `instruments.py`
and so on.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import venv
import zipfile
from pathlib import Path

ROOMS = ("instruments", "acquisition", "calibration", "mocks", "nidaqmx_twin", "commands", "reports", "rigs")
SCRIPT = """
import calibration
import haploop

assert calibration.OURS == "the lab's own", calibration.__file__
with haploop.open_rig("simulated") as rig:
    recording = haploop.record(rig, button="push", participant="P01", presses=1, out="data")
print(recording.path.name, haploop.__version__)
"""


def compare_files(source: Path, installed: set[Path]) -> None:
    """Compare the wheel with the files of every folder of the source that is a package."""
    rooms = {init.parent.name for init in source.glob("*/__init__.py")} - {"tests"}
    alone = {
        source / "nidaqmx_twin" / name for name in ("LICENSE", "README.md", "pyproject.toml", "setup.py")
    }
    wanted = {
        Path("haploop") / path.relative_to(source)
        for room in rooms
        for path in (source / room).rglob("*")
        if path.is_file() and path.suffix != ".pyc" and path not in alone
    }
    wanted |= {
        Path("haploop") / name
        for name in (
            "__init__.py",
            "__init__.pyi",
            "__main__.py",
            "py.typed",
        )
    }
    found = {path for path in installed if path.parts[0] == "haploop"}
    if missing := wanted - found:
        raise SystemExit(
            f"The wheel lacks {', '.join(map(str, sorted(missing)))}: name it in [package-data]."
        )
    if more := found - wanted:
        raise SystemExit(f"The wheel would also install {', '.join(map(str, sorted(more)))}.")


def main(source: Path) -> None:
    """Build, install, look at the top-level names, run the script."""
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        pip = [sys.executable, "-m", "pip", "--quiet"]
        subprocess.run([*pip, "wheel", "--no-deps", "--wheel-dir", work, source], check=True)
        (wheel,) = work.glob("haploop-*.whl")
        installed = {Path(name) for name in zipfile.ZipFile(wheel).namelist()}
        surplus = {
            path.parts[0]
            for path in installed
            if path.parts[0] != "haploop" and path.parts[0][-10:] != ".dist-info"
        }
        if surplus:
            raise SystemExit(f"The wheel would install {', '.join(sorted(surplus))} beside haploop.")
        compare_files(source, installed)

        # This environment's pip installs, and what the script imports is compiled then: one of its own, and
        # every module compiled, would take longer than all else here.
        venv.create(work / "empty")
        python = work / "empty" / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
        subprocess.run([*pip, "--python", python, "install", "--no-compile", wheel], check=True)
        lab = work / "lab"
        lab.mkdir()
        for room in ROOMS:
            (lab / f"{room}.py").write_text('OURS = "the lab\'s own"\n', encoding="utf-8")
        (lab / "script.py").write_text(SCRIPT, encoding="utf-8")
        subprocess.run([python, "script.py"], cwd=lab, check=True)
    print("One import name: haploop.")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
