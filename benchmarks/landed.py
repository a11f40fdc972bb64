"""Processor time of haploop's main jobs beside the last landed build, at the same time on this computer.

    python benchmarks/landed.py                             # a minute; not on Windows

`benchmarks/landed.txt` names that build's commit. A job that costs more than 1.10 times as much in every
round ends this program with exit code 1, unless a commit since then says why: "Costs: ..." begins a line of
its message.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.processes import haploop, in_rounds, spread  # noqa: E402

JOBS = {
    "start": ("--version", 12),
    "doctor": ("doctor", 4),
    "record": ("record latch -p P02 -n 2 --out NEW", 4),
    "demo (calibrate, make, check)": ("demo --out NEW", 2),
}
"""Words of each job, and its rounds: one of 0.25 s took 1.10 and 1.20 of the time in two rounds, when it
took 0.99 in the median of 23."""
DEARER = 1.10


def main() -> int:
    """Print the table; return the exit code."""
    landed = Path(__file__).with_suffix(".txt").read_text(encoding="utf-8").strip()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        builds = {"landed": landed, "now": "HEAD"}
        try:  # both alike, because a checkout starts otherwise than what is installed
            for build, commit in builds.items():
                _install(commit, folder / build, folder / "source" / build / "haploop")
        except (OSError, subprocess.CalledProcessError) as error:
            print(f"not compared: the build {landed} is not to be had here ({error})")
            return 0
        took = {}
        for job, (words, rounds) in JOBS.items():
            programs = {build: ["env", f"PYTHONPATH={folder / build}", *haploop(words)] for build in builds}
            took[job] = in_rounds(programs, rounds, folder, at_once=len(builds))
    print(f"| CPU, s | {landed} | now | ratio | rounds |\n|---|---|---|---|---|")
    dearer = []
    for job, (_, rounds) in JOBS.items():
        before, now = ([one.cpu for one in took[job][build]] for build in builds)
        ratios = [b / a for a, b in zip(before, now, strict=True)]
        print(f"| {job} | {median(before):.2f} | {median(now):.2f} | {spread(ratios)} | {rounds} |")
        if min(ratios) > DEARER:
            dearer.append(job)
    since = _git("log", "--format=%B", f"{landed}..HEAD").decode()
    why = [line for line in since.splitlines() if line.startswith("Costs: ")]
    print("\n".join(why))
    if dearer and not why:
        print(f"{', '.join(dearer)}: dearer; a commit says why ('Costs: ...'), or mends it.")
    return int(bool(dearer) and not why)


def _install(commit: str, into: Path, source: Path) -> None:
    """Install a commit with its own entry points, without what it needs, which is installed."""
    source.mkdir(parents=True)
    archive = _git("archive", commit)
    subprocess.run(["tar", "-x", "-C", str(source)], input=archive, check=True)
    install = ["-m", "pip", "install", "--quiet", "--no-deps", "--target", str(into), str(source)]
    subprocess.run([sys.executable, *install], check=True)


def _git(*words: str) -> bytes:
    return subprocess.run(["git", "-C", str(ROOT), *words], check=True, capture_output=True).stdout


if __name__ == "__main__":
    sys.exit(main())
