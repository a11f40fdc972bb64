"""Process a study: every press as a row, the representative presses, statistics (`haploop study process`).

The study is cut into parts, a participant's presses of one button each, which any executor of
`concurrent.futures` can compute: processes of this computer, or a Dask cluster. A finished part is a file,
so that an interrupted run, or one after another session, computes only what is missing or has changed.
"""

from __future__ import annotations

import csv
import hashlib
import json
import os
from collections import defaultdict
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache, cached_property
from importlib import metadata
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from ...base import hdf5
from ...base.entry_points import optional
from ...base.errors import ConfigurationError, DataError, InstrumentError
from ...base.files import check_destination, new_file, private_files
from ...base.json_files import read_json, write_json
from ...base.marks import marked
from ...base.progress import Progress, silent
from ...base.workers import worker_pool
from ..presses import PRESS_COLUMNS, AverageMethod, Representative, press_rows, representative, write_rows
from ..recording import content_hash
from .study import Study, open_part, with_presses

_ALONE = 8
"""Tasks up to which one process computes them: starting others takes as long."""
_PART = "part of a study"
"""Kind of the file that says that a part was computed."""
_NEEDED = ("dtaidistance.dtw", "scipy.interpolate", "scipy.ndimage", "scipy.optimize")
"""What a part loads when it is computed: once for all workers, where they are forked."""
_AHEAD = 4
"""Tasks in the pool for each worker."""
_RESTARTS = 3
"""Times that killed worker processes are replaced without a finished part in between."""
_CONNECT = 10
"""Seconds in which a Dask scheduler must answer."""
_MEASURES = ("force_at_activation_n", "peak_force_n", "peak_acceleration", "rms_acceleration", "centroid_hz")
_Result = tuple[list[dict[str, Any]], Representative | None, str]


@dataclass(frozen=True)
class Processed:
    """What `process_study` wrote."""

    folder: Path
    presses: int
    """Rows of presses.csv."""
    computed: int
    """Parts computed in this run; the others were there."""
    parts: int
    """A part for each participant and button, and one for each button."""
    buttons: tuple[str, ...]
    """Buttons with a representative press, as BUTTON.h5."""


@private_files()
def process_study(
    study: Study,
    out: str | Path,
    *,
    workers: int | None = None,
    dask: str | None = None,
    progress: Progress = silent,
) -> Processed:
    """Process all recordings of a study into the folder `out`; a later run completes or renews it.

    Written are `presses.csv` (a row a press and attempt, as `haploop export`), `statistics.csv` (of the
    accepted presses, by participant and button), BUTTON.h5 (representative press of all participants, by the
    study's method), and in `parts/` the rows and the representative press of each participant and button.
    The bytes do not depend on who computed them. All files are readable by their owner only.

    `workers` is the number of processes, by default the number of cores; a script that uses more than one
    needs `if __name__ == "__main__":`. `dask` is the address of a Dask scheduler, whose workers see the
    study's folder under the same path and have this version of haploop.

    Raises ConfigurationError and DataError for a study that cannot be read, InUse while another program
    processes into the same folder, and InstrumentError when workers are killed again and again or cannot
    be reached.
    """
    folder = Path(out)
    parts, wholes = _tasks(study, folder)
    # Two programs would delete each other's files; the tables are named because they stand in the folder.
    with marked(folder / "presses.csv"):
        due = [task for task in (*wholes, *parts) if not task.done]
        for count, _ in enumerate(_computed(due, workers, dask), 1):
            progress("Process the study", count, len(due), "parts")
        presses = _write_presses(folder / "presses.csv", parts)
        _write_statistics(folder / "statistics.csv", parts)
    made = tuple(task.name for task in wholes if task.press.is_file())
    return Processed(folder, presses, len(due), len(parts) + len(wholes), made)


@dataclass(frozen=True)
class _Task:
    """Rows and representative press of some recordings; without rows, of all participants."""

    name: str
    study: str
    paths: tuple[Path, ...]
    method: AverageMethod
    rows: bool
    mark: Path
    """JSON file that is there when the task is done: key of the input, rows, and why there is no press."""
    press: Path

    @cached_property
    def key(self) -> str:
        """Digest of all that the result depends on; a recording is known by its size and time."""
        beside = {path.parent / "rejections.json" for path in self.paths}
        files = [*self.paths, *(path for path in beside if path.is_file())]
        seen = [(path.name, path.stat().st_size, path.stat().st_mtime_ns) for path in files]
        return hashlib.sha256(json.dumps([_version(), self.method, seen]).encode()).hexdigest()

    @property
    def begun(self) -> bool:
        """True where an earlier run of this study has left a mark, even one that was damaged since."""
        try:
            return bool(read_json(self.mark, _PART, dict).get("study") == self.study)
        except DataError:
            return self.mark.exists()

    @property
    def done(self) -> bool:
        try:
            said = read_json(self.mark, _PART, dict)
            made = said["press"] is None or content_hash(self.press) == said["press"]
        except (DataError, LookupError):
            return False
        return made and bool(said["key"] == self.key)

    def save(self, result: _Result) -> None:
        """Write the result: a press is there only beside its mark, which tells one that was cut off."""
        for path in (self.press, self.mark):
            path.unlink(missing_ok=True)
        rows, press, problem = result
        made = None if press is None else hdf5.digest_of(press)
        said = {"study": self.study, "key": self.key, "press": made, "problem": problem, "rows": rows}
        write_json(self.mark, _PART, said)
        if press is not None:
            press.save(self.press)

    def load_rows(self) -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = read_json(self.mark, _PART, dict)["rows"]
        return found


def _tasks(study: Study, folder: Path) -> tuple[list[_Task], list[_Task]]:
    """A task for each participant and button, and one for each button."""
    files = {pair: tuple(path.resolve() for path in paths) for pair, paths in study.parts().items()}
    if not any(files.values()):
        raise DataError(
            f"The study {study.file.name!r} has no recording yet: record some with `haploop study run`."
        )
    inside, method = folder / "parts", study.file.method
    parts, every = [], defaultdict[str, list[Path]](list)
    for (participant, button), paths in files.items():
        if paths:
            name = f"{participant}-{button}"
            parts.append(
                _Task(
                    name,
                    study.file.name,
                    paths,
                    method,
                    True,
                    inside / f"{name}.json",
                    inside / f"{name}-press.h5",
                )
            )
            every[button] += paths
    wholes = [
        _Task(
            button,
            study.file.name,
            tuple(paths),
            method,
            False,
            inside / f"{button}.whole.json",
            folder / f"{button}.h5",
        )
        for button, paths in every.items()
    ]
    # Only what an earlier run has written is replaced: latch.h5 may be somebody's digital button.
    new = [task.press for task in wholes if not task.begun]
    tables = [folder / name for name in ("presses.csv", "statistics.csv") if len(new) == len(wholes)]
    for path in (*tables, *new):
        check_destination(path)
    inside.mkdir(parents=True, exist_ok=True)
    return parts, wholes


def _work(study: str, paths: tuple[Path, ...], method: AverageMethod, rows: bool) -> _Result:
    """What a worker does: rows, the representative press, and why there is none."""
    recordings = [open_part(path, study) for path in paths]
    table = list(press_rows(recordings)) if rows else []
    try:
        return table, representative(list(with_presses(recordings)), method=method), ""
    except (ConfigurationError, DataError) as error:
        return table, None, str(error)


def _computed(tasks: Sequence[_Task], workers: int | None, dask: str | None) -> Iterator[_Task]:
    """Compute and save the tasks; yield each when it is on the disk."""
    if dask is not None:
        with _dask_pool(dask) as pool:
            yield from _through(pool, tasks, _AHEAD * 64)
        return
    count = min(workers or _cores(), len(tasks))
    if count <= 1 or (workers is None and len(tasks) <= _ALONE):
        for task in tasks:
            task.save(_work(task.study, task.paths, task.method, task.rows))
            yield task
        return
    left, broken = list(tasks), 0
    while left:
        before = len(left)
        with worker_pool(count, __name__, *_NEEDED) as pool:
            try:
                for task in _through(pool, left.copy(), _AHEAD * count):
                    left.remove(task)
                    yield task
            except BrokenProcessPool:
                broken = broken + 1 if len(left) == before else 1
                if broken > _RESTARTS:
                    raise InstrumentError(
                        f"Worker processes were killed {broken} times without finishing a part; is there "
                        "enough memory? Use fewer (--workers), and run the same command again."
                    ) from None


def _through(pool: Executor, tasks: Sequence[_Task], most: int) -> Iterator[_Task]:
    """Keep at most `most` tasks in the pool, so that neither tasks nor results fill the memory."""
    waiting: dict[Future[_Result], _Task] = {}
    following = iter(tasks)
    while True:
        for task in islice(following, most - len(waiting)):
            waiting[pool.submit(_work, task.study, task.paths, task.method, task.rows)] = task
        if not waiting:
            return
        done, _ = wait(waiting, return_when=FIRST_COMPLETED)
        for future in done:
            task = waiting.pop(future)
            task.save(future.result())
            yield task


@contextmanager
def _dask_pool(address: str) -> Iterator[Executor]:
    distributed = optional("distributed", "dask", "Processing on a cluster (--dask)")
    try:
        client = distributed.Client(address, timeout=_CONNECT)
    except (OSError, ValueError) as error:
        raise InstrumentError(
            f"No Dask scheduler answers at {address} ({error}): start one, or correct --dask."
        ) from None
    with client:
        try:
            yield client.get_executor(pure=False)
        except (distributed.KilledWorker, distributed.comm.CommClosedError, CancelledError) as error:
            # The scheduler gives a task up after several workers died over it, or it has itself gone away.
            raise InstrumentError(
                f"The Dask cluster at {address} lost its work ({type(error).__name__}); is there enough "
                "memory on its workers? What is finished is kept: run the same command again."
            ) from None
        except ModuleNotFoundError as error:
            raise InstrumentError(
                f"A worker of the Dask cluster at {address} has no module {error.name}: install this version "
                "of haploop there too."
            ) from None


@cache
def _version() -> str:
    """That of haploop, which is read from a file: once, and not for each part."""
    return metadata.version("haploop")


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _write_presses(path: Path, parts: Sequence[_Task]) -> int:
    """Write the rows of all parts, one part in memory at a time; return their number."""
    count = 0
    path.unlink(missing_ok=True)
    with new_file(path) as new, new.open("w", encoding="utf-8", newline="") as file:
        for task in parts:
            rows = task.load_rows()
            write_rows(file, PRESS_COLUMNS, rows, headings=count == 0 and task is parts[0])
            count += len(rows)
    return count


def _write_statistics(path: Path, parts: Sequence[_Task]) -> None:
    """Mean and standard deviation of accepted presses: by participant, and of the participants' means."""
    means: dict[tuple[str, str], list[tuple[int, float]]] = defaultdict(list)
    path.unlink(missing_ok=True)
    with new_file(path) as new, new.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["participant", "button", "measure", "count", "mean", "deviation"])
        for task in parts:
            rows = [row for row in task.load_rows() if row["accepted"]]
            for measure in _MEASURES:
                values = [row[measure] for row in rows if row[measure] is not None]
                if values:
                    button = str(rows[0]["button"])
                    writer.writerow([rows[0]["participant"], button, measure, *_moments(values)])
                    means[button, measure].append((len(values), float(np.mean(values))))
        for (button, measure), found in means.items():
            writer.writerow(["", button, measure, *_moments([mean for _, mean in found])])


def _moments(values: Sequence[float]) -> tuple[int, str, str]:
    deviation = f"{np.std(values, ddof=1):.9g}" if len(values) > 1 else ""
    return len(values), f"{np.mean(values):.9g}", deviation
