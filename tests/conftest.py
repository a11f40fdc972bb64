"""The plugin that haploop ships gives the rig; two of its things have shorter names in this suite."""

import gc
import hashlib
import importlib
import os
import re
import signal
import tempfile
import time
import warnings
from collections.abc import Iterator
from contextlib import suppress
from datetime import date
from itertools import count
from pathlib import Path

import hypothesis
import pytest
from filelock import FileLock
from platformdirs import user_cache_path

import haploop
from haploop.mocks.pytest_plugin import OpenRig
from haploop.terminal import progress
from tests.command_line import demo, no_columns, run

__all__ = ["OpenRig", "demo", "no_columns", "run"]

_LATE = "because no time was left"

# An example takes as long as the machine is loaded.
hypothesis.settings.register_profile("haploop", deadline=None)
hypothesis.settings.load_profile("haploop")


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--long`: minutes, in CI. `--night`: an hour, each night. `--full`: hours, at whole size."""
    parser.addoption("--full", action="store_true", help="run long experiments at their full size")
    parser.addoption(
        "--long", action="store_true", help="run what is dear, too: whole loops, other programs, worlds"
    )
    parser.addoption(
        "--night", action="store_true", help="--long, further worlds and studies, every page of the documents"
    )
    parser.addoption("--skipped", metavar="FILE", help="=FILE: write names of skipped tests to it")
    parser.addoption(
        "--until",
        type=float,
        metavar="TIME",
        help="skip what has not begun at this Unix time",
    )


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int | None:
    """Two workers a core, because tests wait: for programs that are killed, for real clocks, for disks, and
    on the wire client and server for one another. On hardware there is one program only."""
    return 2 * (os.cpu_count() or 1) if config.getoption("--rig") in ("twin", "wire") else 0


def pytest_configure(config: pytest.Config) -> None:
    """Stops reach the tests also where they are ignored (nohup, `&`, some CI); the mark of what would take
    minutes through the wire, and shows nothing there that others do not.

    Workers, and what they start, compute in one thread each: threads of BLAS would wait for one another.
    What they free they keep for what they allocate next, as the kernel takes its time to give out memory.
    They keep their bytecode, although a container may say that nobody does: a sixth of what a program costs
    that a test starts is compiling, and workers share what they compile."""
    for library in ("OMP", "OPENBLAS"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    for threshold in ("MMAP", "TRIM"):
        os.environ.setdefault(f"MALLOC_{threshold}_THRESHOLD_", str(2**30))  # glibc
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if hasattr(signal, "SIGHUP"):
        signal.signal(signal.SIGHUP, signal.SIG_DFL)
    gc.set_threshold(20_000)
    worker = getattr(config, "workerinput", {}).get("workerid")
    if (skipped := config.getoption("--skipped")) and worker in (None, "gw0"):
        config.pluginmanager.register(Skipped(Path(skipped), worker))
    config.addinivalue_line("markers", "many_plays: plays for minutes; on the wire with --full only")
    config.addinivalue_line("markers", "long: dear, and not the only test of what it tests; with --long")
    config.addinivalue_line("markers", "night: one more world, study or page; with --night")


class Skipped:
    """Writes the names of skipped tests to a file: for `pytest --long @FILE`, where nothing lacks.

    Files that are skipped whole are written by the first worker, which collects them all: of those that are
    skipped at one place, as all that need a browser are, xdist hands on the first only.
    """

    def __init__(self, path: Path, worker: str | None) -> None:
        self.path, self.worker = path, worker
        path.touch()

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        self._write(report)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if self.worker is None:
            self._write(report)

    def _write(self, report: pytest.CollectReport | pytest.TestReport) -> None:
        if report.skipped and not re.search(r"--(full|night)\b", report.longreprtext):
            with self.path.open("a", encoding="utf-8") as file:
                file.write(f"{report.nodeid}\n")


@pytest.hookimpl(tryfirst=True)
def pytest_collection(session: pytest.Session) -> None:
    """Each worker imports the tests from another file on, and finds those that others have compiled.

    From the same file on all would compile the same at the same time: a third of a worker's start."""
    worker = getattr(session.config, "workerinput", None)
    if worker is None or session.config.args != session.config.getini("testpaths"):
        return
    paths = sorted((session.config.rootpath / "tests").rglob("test_*.py"))
    first = len(paths) * int(worker["workerid"].removeprefix("gw")) // worker["workercount"]
    for path in paths[first:] + paths[:first]:
        # What cannot be imported, or skips all its tests, says so when it is collected.
        with suppress(Exception, pytest.skip.Exception):
            importlib.import_module(".".join(path.relative_to(session.config.rootpath).with_suffix("").parts))


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Long files first, and those that wait for a browser, so that no worker waits for them at the end;
    `many_plays` on the twin only, unless --full. With --until, other files come first each day."""
    if config.getoption("--until"):
        day = date.today().isoformat()
        items.sort(key=lambda item: hashlib.sha256(f"{day} {item.path.name}".encode()).digest())
    else:
        items.sort(key=lambda item: item.path.parent.name not in ("tests", "browser"))
    left_out = {}
    if config.getoption("--rig") == "wire":
        left_out["many_plays"] = "many plays: on the wire with --full only"
    if not config.getoption("--night"):
        left_out["night"] = "one more world, study or page: with --night"
        if not config.getoption("--long"):
            left_out["long"] = "dear, and not the only test of it: runs with --long, as CI does"
    for item in items if not config.getoption("--full") else ():
        for mark, reason in left_out.items():
            if item.get_closest_marker(mark):
                item.add_marker(pytest.mark.skip(reason=reason))
    for item in items:
        if any(map(item.get_closest_marker, ("long", "night"))) and not item.get_closest_marker("timeout"):
            item.add_marker(pytest.mark.timeout(1200))


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Begin no test after `--until`."""
    until = item.config.getoption("--until")
    if until and time.time() > until:
        pytest.skip(_LATE)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say how many tests were not begun for want of time."""
    skipped = terminalreporter.stats.get("skipped", [])
    if late := sum(_LATE in str(report.longrepr) for report in skipped):
        terminalreporter.write_line(f"NOT RUN: {late} tests, {_LATE}.")


def pytest_collection_finish() -> None:
    """Thousands of tests and all modules are looked through for garbage no more: a tenth of the time."""
    gc.freeze()


@pytest.fixture(scope="session")
def full(request: pytest.FixtureRequest) -> bool:
    """Whether a long experiment is to run at its full size, and not only far enough to see it work."""
    return bool(request.config.getoption("--full"))


@pytest.fixture(scope="session")
def mode(request: pytest.FixtureRequest) -> str:
    """What --rig names."""
    return str(request.config.getoption("--rig"))


@pytest.fixture(scope="session")
def common(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Path:
    """A folder of all workers, for what one of them makes and the others read."""
    base = tmp_path_factory.getbasetemp()
    folder = (base if worker_id == "master" else base.parent) / "common"
    folder.mkdir(exist_ok=True)
    return folder


@pytest.fixture(scope="session")
def made(common: Path) -> Path:
    """A folder with the digital buttons latch.h5 and push.h5, made in haste on the simulated table."""
    folder = common / "buttons"
    with FileLock(common / "buttons.lock"):
        if not folder.exists():
            _make_buttons(folder)
    return folder


def _make_buttons(folder: Path) -> None:
    unfinished = folder.with_name("unfinished-buttons")
    with haploop.open_rig("simulated") as rig:
        calibration = haploop.calibrate(rig, patch="A", point="button")
        for name in ("latch", "push"):
            recording = haploop.record(rig, button=name, participant="P01", presses=3, out=unfinished)
            press = haploop.representative([recording])
            button = haploop.build_button(rig, press, calibration, iterations=0)
            assert button.passed
            button.save(unfinished / f"{name}.h5")
    unfinished.rename(folder)


@pytest.fixture
def open(open_rig: OpenRig) -> OpenRig:
    """See `haploop.mocks.pytest_plugin.open_rig`."""
    return open_rig


@pytest.fixture
def unproved(monkeypatch: pytest.MonkeyPatch) -> None:
    """A session whose gain is taken as proved: for tests that look at every volt and line of one play."""
    monkeypatch.setattr("haploop.instruments.rig.playing.Playing._prove", lambda *_: None)


@pytest.fixture
def few_callbacks(monkeypatch: pytest.MonkeyPatch) -> None:
    """A simulated sound card that calls back for as many frames as it is late by: a third of the work."""
    for module in ("daq.sound_card", "player"):
        monkeypatch.setattr(f"haploop.mocks.{module}.FRAMES", 1152)


@pytest.fixture(scope="session", autouse=True)
def _state(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The user's own audit log, lockouts and catalogue are no test's; nor are the locks of another worker's
    rigs."""
    folder = tmp_path_factory.mktemp("state")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HAPLOOP_STATE", str(folder))
        # Its list of fonts takes seconds to make.
        patch.setenv("MPLCONFIGDIR", str(user_cache_path("matplotlib")))
        patch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
        for name in ("TMPDIR", "TEMP", "TMP"):
            patch.setenv(name, str(folder))
        patch.setattr(tempfile, "tempdir", None)
        yield folder


@pytest.fixture(autouse=True)
def _own_state(_state: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A rig that one test has locked out is not locked out for the next."""
    monkeypatch.setenv("HAPLOOP_STATE", str(_state / f"{next(_tests)}"))


@pytest.fixture(autouse=True)
def _no_bar_stays() -> Iterator[None]:
    """Bars that a test leaves would take every sentence of the tests after it: they go, and the test is named
    in the summary of warnings."""
    yield
    if progress._shown:
        progress._shown.clear()
        warnings.warn("a test leaves bars at the foot of a terminal", stacklevel=1)


_tests = count()
