"""Processing a study of 36 to 36,000 presses: CPU time and memory, in parts and of whole buttons.

    python benchmarks/corpus.py 36 360 3600

The recordings are those of a few simulated participants, with small noise of their own added, written by
haploop's writer under other pseudonyms: 0.07 MB a press.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from benchmarks.table import Row

BUTTONS, PRESSES = ("latch", "toggle", "push"), 10
_SEEDS = 4

# The peak of this program alone, on Linux: getrusage's begins with that of the program which started it.
WORK = """
import re, sys, time
from pathlib import Path
import haploop
from haploop.acquisition.session import processing
study = haploop.load_study(sys.argv[1])
parts, wholes = processing._tasks(study, Path(sys.argv[1], "out"))
tasks = parts if sys.argv[2] == "parts" else wholes
began = time.process_time()
for task in processing._computed(tasks, 1, None):
    pass
if sys.argv[2] == "parts":
    processing._write_presses(parts[0].mark.parents[1] / "presses.csv", parts)
    processing._write_statistics(parts[0].mark.parents[1] / "statistics.csv", parts)
peak = int(re.search(r"VmHWM:\\s*(\\d+)", Path("/proc/self/status").read_text())[1])
print(time.process_time() - began, peak / 1024)
"""


def recorded(folder: Path) -> dict[str, list[object]]:
    """Recordings of a few simulated participants."""
    import haploop

    found: dict[str, list[object]] = {}
    with haploop.open_rig("simulated") as rig:
        for number in range(1, _SEEDS + 1):
            for button in BUTTONS:
                made = haploop.record(rig, button, f"B{number:02d}", PRESSES, folder)
                found.setdefault(button, []).append(made)
    return found


def synthesise(source: dict[str, list[object]], folder: Path, participants: int) -> None:
    """Write a study of so many participants."""
    from haploop.acquisition.recording import Writer, finish
    from haploop.instruments import Block

    names = [f"P{number:04d}" for number in range(1, participants + 1)]
    (folder / "recordings").mkdir(parents=True)
    (folder / "study.toml").write_text(
        f'name = "corpus"\nbuttons = {list(BUTTONS)}\nparticipants = {names}\npresses = {PRESSES}\n'
        'order = "as-listed"\n'.replace("'", '"'),
        encoding="utf-8",
    )
    rng = np.random.default_rng(1)
    for index, name in enumerate(names):
        for button in BUTTONS:
            own = source[button][index % _SEEDS]
            header = replace(own.header, participant=name, study="corpus", session="1")  # type: ignore[attr-defined]
            volts = own.volts + rng.normal(0, 1e-4, own.volts.shape)  # type: ignore[attr-defined]
            path, step = folder / "recordings" / f"{name}-{button}.h5", 250
            overload = np.zeros(len(volts), dtype=np.bool_)
            with Writer(path, header, step, volts.shape[1] // step + 2) as writer:
                for first in range(0, volts.shape[1], step):
                    writer.write(Block(first, volts[:, first : first + step], overload), first / 5000)
                for verdict in own.verdicts:  # type: ignore[attr-defined]
                    writer.write_verdict(verdict)
            finish(path)


def main(words: Sequence[str] | None = None) -> list[Row]:
    """Process studies of each size, print what they took, and return the cost of a press."""
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as temporary:
        source = recorded(Path(temporary, "source"))
        print(f"{'presses':>8} {'work':>8} {'CPU s':>8} {'ms a press':>11} {'peak MB':>8}", flush=True)
        for presses in map(int, (sys.argv[1:] if words is None else words) or ["36", "360"]):
            folder = Path(temporary, str(presses))
            began = time.process_time()
            synthesise(source, folder, max(1, round(presses / PRESSES / len(BUTTONS))))
            real = len(list((folder / "recordings").glob("*.h5"))) * PRESSES
            print(f"{real:8d} {'written':>8} {time.process_time() - began:8.1f}", flush=True)
            for work in ("parts", "wholes"):
                done = subprocess.run(
                    [sys.executable, "-c", WORK, str(folder), work],
                    capture_output=True,
                    text=True,
                    check=True,
                )
                seconds, peak = map(float, done.stdout.split())
                print(
                    f"{real:8d} {work:>8} {seconds:8.1f} {1e3 * seconds / real:11.2f} {peak:8.0f}", flush=True
                )
                what = f"study of {real} presses, {work}"
                rows.append(Row(f"{what}: CPU a press", [1e3 * seconds / real], "ms"))
                rows.append(Row(f"{what}: memory", [peak], "MB"))
    return rows


if __name__ == "__main__":
    main()
