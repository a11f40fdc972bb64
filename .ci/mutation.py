"""Change the code that keeps volts within limits and samples whole, one place at a time, and run its tests.

Usage: python .ci/mutation.py [MODULE...] [--sample N] [--seed S] [--out FILE] [--again FILE], on Linux, in an
environment with haploop[test] and cosmic-ray. MODULE is a path below, or a part of it; without one, all. A
mutant that no test notices is printed with its change. Each mutant is written into a copy of the tree, and
tested by a process of its own with limits on time, memory and the size of files. docs/explanation/safety.md
has the results.
"""

from __future__ import annotations

import argparse
import ast
import difflib
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from cosmic_ray import plugins
from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code

ROOT = Path(__file__).resolve().parents[1]
SAFETY, RECORDING = "tests/instruments/safety/test_", "tests/acquisition/recording/test_"
DRIVE = "tests/calibration/drive/test_"
PLAYED = tuple(
    f"{SAFETY}{name}.py"
    for name in ("permit", "limiter", "duty", "foreign_volts", "nothing_beyond_a_limit", "single_steps")
)
FILES = (
    "tests/acquisition/test_checksum.py",
    *(
        f"{RECORDING}{name}.py"
        for name in ("rows", "writer", "recording_files", "unfinished_files", "disks", "refusing_disks")
    ),
)
TESTS: dict[str, tuple[str, ...]] = {
    "instruments/limits.py": ("tests/instruments/test_limits.py", *PLAYED),
    "instruments/interlock.py": PLAYED,
    "instruments/safety/limiter.py": PLAYED,
    "instruments/safety/judge.py": PLAYED,
    "instruments/safety/safe_state.py": tuple(
        f"{SAFETY}{name}.py"
        for name in ("outputs", "foreign_volts", "single_steps", "taken", "ways_out", "other_clients")
    ),
    "instruments/rig/monitoring.py": (f"{SAFETY}single_steps.py", "tests/instruments/rig/test_gain_proof.py"),
    "acquisition/session/recorder.py": ("tests/acquisition/session/test_stream_reader.py",),
    "instruments/safety/duty.py": (f"{SAFETY}outputs.py", f"{SAFETY}duty.py"),
    "instruments/safety/lockout.py": (
        f"{SAFETY}lockout.py",
        f"{SAFETY}abort_monitor.py",
        f"{SAFETY}machine.py",
        f"{SAFETY}limiter.py",
    ),
    "instruments/safety/machine.py": (f"{SAFETY}machine.py", f"{SAFETY}duty.py"),
    "instruments/safety/abort_monitor.py": (f"{SAFETY}abort_monitor.py",),
    "base/checksum.py": FILES,
    "acquisition/recording/file_format.py": FILES,
    "acquisition/recording/rows.py": FILES,
    "acquisition/recording/recording.py": (f"{RECORDING}derived.py", *FILES),
    "acquisition/recording/writer.py": FILES,
    "acquisition/recording/salvage.py": (f"{RECORDING}salvage.py", *FILES),
    "acquisition/recording/recovery.py": (f"{RECORDING}salvage.py", *FILES),
    "acquisition/presses/segmentation.py": (
        "tests/acquisition/presses/test_by_hand.py",
        "tests/acquisition/presses/test_segmentation.py",
        "tests/acquisition/presses/test_quality.py",
    ),
    "experiments/contact/area.py": ("tests/experiments/contact/test_area_by_hand.py",),
    "calibration/drive/check.py": (f"{DRIVE}verdict_by_hand.py", f"{DRIVE}check.py"),
    "calibration/drive/checked.py": (f"{DRIVE}verdict_by_hand.py", f"{DRIVE}check.py"),
    "calibration/drive/verdict.py": (f"{DRIVE}verdict_by_hand.py",),
    "calibration/drive/agreement.py": (f"{DRIVE}verdict_by_hand.py",),
}
"""The tests that have to notice a change of each module: those that are run in a minute at most."""

SWAPS = (
    *[
        "Binary:Add_Sub",
        "Binary:Sub_Add",
        "Binary:Mul_Div",
        "Binary:Div_Mul",
        "Binary:FloorDiv_Div",
        "Binary:Mod_Mul",
    ],
    *[
        "Comparison:Lt_LtE",
        "Comparison:LtE_Lt",
        "Comparison:Gt_GtE",
        "Comparison:GtE_Gt",
        "Comparison:Lt_GtE",
    ],
    *[
        "Comparison:Gt_LtE",
        "Comparison:Eq_NotEq",
        "Comparison:NotEq_Eq",
        "Comparison:Is_IsNot",
        "Comparison:IsNot_Is",
    ],
    *["Unary:USub_UAdd", "Unary:Delete_Not"],
)
"""One swap for each operator: the others (`-` to `<<`) are noticed by anything that runs the line."""
OPERATORS = (
    *(f"core/Replace{kind}Operator_{swap}" for kind, swap in (name.split(":") for name in SWAPS)),
    *(f"core/Replace{pair}" for pair in ("TrueWithFalse", "FalseWithTrue", "AndWithOr", "OrWithAnd")),
    *("core/ReplaceBreakWithContinue", "core/ReplaceContinueWithBreak", "core/ExceptionReplacer"),
    *("core/AddNot", "core/NumberReplacer", "core/ZeroIterationForLoop"),
)
OPTIONS = (
    *("-q", "-x", "-n0", "-p", "no:cacheprovider", "--assert=plain"),
    *("--hypothesis-seed=0", "--hypothesis-profile=noticed"),
)
MEMORY, LONGEST_FILE = 3 << 30, 1 << 30


def mutants(code: str) -> list[tuple[str, int]]:
    """(operator, occurrence) of each change of a module; operator "delete" is of a statement."""
    tree = get_ast(code)
    found = [("delete", number) for number in range(len(list(statements(code))))]
    for name in OPERATORS:
        operator = plugins.get_operator(name)()
        places = sum(1 for node in ast_nodes(tree) for _ in operator.mutation_positions(node))
        found += [(name, number) for number in range(places)]
    return found


def statements(code: str) -> Iterator[ast.stmt]:
    """Calls, raises, and assignments to what exists: what can be left out without a NameError."""
    for node in ast.walk(ast.parse(code)):
        called = isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)
        kept = isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Attribute | ast.Subscript)
        if called or kept or isinstance(node, ast.AugAssign | ast.Raise):
            yield node


def changed(code: str, operator: str, occurrence: int) -> str | None:
    """The module with one change; None where the change is none."""
    if operator != "delete":
        made = mutate_code(code, plugins.get_operator(operator)(), occurrence)
        return None if made is None or ast.dump(ast.parse(made)) == ast.dump(ast.parse(code)) else made
    node = list(statements(code))[occurrence]
    lines = code.encode().splitlines(keepends=True)
    first, last = node.lineno - 1, node.end_lineno - 1
    rest = lines[last][node.end_col_offset :]
    return b"".join(
        [*lines[:first], lines[first][: node.col_offset] + b"pass" + rest, *lines[last + 1 :]]
    ).decode()


def tested(tree: Path, tests: tuple[str, ...], seconds: float, log: Path) -> tuple[str, float]:
    """Run tests in a child that has imported what is not haploop's. Returns outcome and CPU seconds."""
    began, child = time.monotonic(), os.fork()
    if child == 0:
        os.setpgid(0, 0)
        os.chdir(tree / "haploop")
        os.environ.update(PYTHONPATH=str(tree), TMPDIR=str(log.parent), PYTHONDONTWRITEBYTECODE="1")
        tempfile.tempdir = None
        output = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(output, 1)
        os.dup2(output, 2)
        resource.setrlimit(resource.RLIMIT_CPU, (int(seconds) + 1,) * 2)
        resource.setrlimit(resource.RLIMIT_FSIZE, (LONGEST_FILE,) * 2)
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY,) * 2)
        sys.path.insert(0, str(tree))
        sys.dont_write_bytecode = True
        code = 99
        try:
            code = int(pytest.main([*OPTIONS, f"--basetemp={log.parent / 'pytest'}", *tests]))
        finally:
            os._exit(code)
    outcome, usage = "", None
    while not outcome:
        done, status, usage = os.wait4(child, os.WNOHANG)
        if done:
            outcome = "alive" if status == 0 else "killed"
        elif time.monotonic() - began > 10 * seconds + 60:
            outcome = "hung"
            os.killpg(child, signal.SIGKILL)
            _, _, usage = os.wait4(child, 0)
        else:
            time.sleep(0.05)
    with suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)  # what a test has started
    return outcome, usage.ru_utime + usage.ru_stime


def made_tree(folder: Path) -> Path:
    """A copy of the files that git knows, in a folder called haploop, which is the package."""
    tree = folder / "tree"
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True)
    for name in listed.stdout.decode().split("\0"):
        if name and (source := ROOT / name).is_file():
            target = tree / "haploop" / name
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(source, target)
    return tree


def main() -> int:
    """Return 1 if any mutant has lived."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("modules", nargs="*")
    parser.add_argument("--sample", type=int, default=40, help="mutants of a module, at random; 0 for all")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, help="a JSON line for each mutant")
    parser.add_argument("--again", type=Path, help="only those that lived in a file of --out")
    asked = parser.parse_args()
    lived_before: dict[str, list[tuple[str, int]]] = {}
    for line in asked.again.read_text(encoding="utf-8").splitlines() if asked.again else ():
        if (said := json.loads(line))["outcome"] == "alive":
            lived_before.setdefault(said["module"], []).append((said["operator"], said["occurrence"]))
    names = [name for part in asked.modules or [""] for name in TESTS if part in name]
    if asked.again:
        names = [name for name in names if name in lived_before]
    lived = 0
    with tempfile.TemporaryDirectory() as folder:
        tree, log = made_tree(Path(folder)), Path(folder, "run", "log")
        log.parent.mkdir()
        for name in names:
            path, tests = tree / "haploop" / name, TESTS[name]
            code = path.read_text(encoding="utf-8")
            outcome, seconds = tested(tree, tests, 600, log)
            if outcome != "alive":
                raise SystemExit(f"The tests of {name} fail on unchanged code:\n{log.read_text()[-3000:]}")
            every = lived_before.get(name) or mutants(code)
            count = len(every) if asked.again else min(asked.sample or len(every), len(every))
            chosen = random.Random(f"{asked.seed} {name}").sample(every, count)
            counts: Counter[str] = Counter()
            for operator, occurrence in chosen:
                mutant = changed(code, operator, occurrence)
                if mutant is None:
                    continue
                for compiled in (path.parent / "__pycache__").glob(f"{path.stem}.*"):
                    compiled.unlink()
                path.write_text(mutant, encoding="utf-8")
                outcome, spent = tested(tree, tests, 3 * seconds + 10, log)
                counts[outcome] += 1
                diff = "\n".join(
                    list(difflib.unified_diff(code.split("\n"), mutant.split("\n"), n=1, lineterm=""))[2:]
                )
                if outcome == "alive":
                    lived += 1
                    print(f"\n{name}: {operator} {occurrence}\n{diff}", flush=True)
                if asked.out:
                    said = {
                        "module": name,
                        "operator": operator,
                        "occurrence": occurrence,
                        "outcome": outcome,
                    }
                    with asked.out.open("a", encoding="utf-8") as file:
                        file.write(json.dumps({**said, "cpu": round(spent, 1), "diff": diff}) + "\n")
            path.write_text(code, encoding="utf-8")
            tried = sum(counts.values())
            print(f"{name}: {tried - counts['alive']} of {tried} noticed, {len(every)} in all", flush=True)
    return int(lived > 0)


if __name__ == "__main__":
    # Imported once, and by every child at no cost.
    import h5py  # noqa: F401
    import hypothesis
    import numpy as np  # noqa: F401
    import pydantic  # noqa: F401
    import pytest
    import scipy.optimize
    import scipy.signal  # noqa: F401

    # A failure is enough: its smallest example is not looked for.
    phases = (hypothesis.Phase.explicit, hypothesis.Phase.generate)
    hypothesis.settings.register_profile("noticed", phases=phases, database=None, deadline=None)
    raise SystemExit(main())
