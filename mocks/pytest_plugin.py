"""Run the same tests on a twin, through the wire, and on hardware: `pytest --rig twin|wire|FILE`.

pytest loads this module in every run of an environment with haploop. It imports only lazily loaded
packages until a test requests a rig, and does not affect tests without one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NoReturn

import pytest

from .. import instruments
from ..base import errors
from ..nidaqmx_twin import pytest_plugin as of_cards

if TYPE_CHECKING:
    from ..instruments import Rig, RigFile
    from .tabled import Instrument

OpenRig = Callable[..., "Rig"]
OF_CARDS = "nidaqmx_twin"
"""Name of the plugin with the fixture `nidaqmx_twin`."""
_ALONE = pytest.StashKey[str]()
"""The sentence about workers that were taken away."""

pytest.register_assert_rewrite("haploop.instruments.conformance")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option `--rig` and the setting `rig_file`."""
    group = parser.getgroup("haploop")
    group.addoption(
        "--rig",
        default="twin",
        metavar="twin|wire|FILE",
        help="what the tests run on: a simulated rig, or the hardware that the rig file FILE describes",
    )
    parser.addini("rig_file", "rig file that --rig twin and --rig wire simulate", default="simulated")


def pytest_configure(config: pytest.Config) -> None:
    """Register the marks; check the rig that was asked for, and run the tests of hardware on one worker.

    Raises pytest.UsageError, which shows also where xdist distributes the tests: their workers cannot end the
    run with a reason.
    """
    config.addinivalue_line("markers", "rig: runs on an open rig, the one that --rig selects")
    config.addinivalue_line(
        "markers",
        "requires(name, ...): skipped on a rig without these parts: instruments or sensors by their "
        "rig-file names, 'table', or 'simulation'; in a conformance suite, one of its capabilities",
    )

    # The package nidaqmx_twin, installed by itself, brings the fixture under this name, of its own classes.
    if not config.pluginmanager.has_plugin(OF_CARDS):
        config.pluginmanager.register(of_cards, OF_CARDS)
    if not _is_worker(config) and _named(config) is not None:
        _check(config)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Say that the tests ran on one worker."""
    if sentence := config.stash.get(_ALONE, ""):
        terminalreporter.write_line(sentence)


def _is_worker(config: pytest.Config) -> bool:
    """True in a process that xdist has started to run tests."""
    return hasattr(config, "workerinput")


def _named(config: pytest.Config) -> Path | None:
    """The rig file that somebody has named, or None."""
    mode: str = config.getoption("--rig")
    if mode not in ("twin", "wire"):
        return _beside(config.invocation_params.dir, mode)
    simulated: str = config.getini("rig_file")
    return None if simulated == "simulated" else _beside(config.rootpath, simulated)


def _check(config: pytest.Config) -> None:
    """Load the rig file; of hardware, see that it is free, and take all workers but one away."""
    try:
        file = instruments.load_rig_file(_named(config) or "simulated")
        if config.getoption("--rig") in ("twin", "wire") or file.simulate or config.option.collectonly:
            return
        with instruments.reserve(instruments.hardware(file, None), f"The rig {file.name!r}"):
            pass  # whoever runs the tests reserves it again
    except errors.HaploopError as error:
        raise pytest.UsageError(str(error)) from None
    workers: list[str] = config.getoption("tx", []) or []  # xdist's, if it is there
    if len(workers) > 1:
        config.option.tx = workers[:1]
        config.stash[_ALONE] = (
            f"The rig {file.name!r} is hardware, which one program uses at a time: all tests ran on one "
            f"worker, and not on {len(workers)}."
        )


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark each test that opens a rig with `rig`."""
    for item in items:
        if "rigs" in getattr(item, "fixturenames", ()) and _ours(item):
            item.add_marker("rig")


class Rigs:
    """Opens the rig that `--rig` selects, and skips the test when it is not available."""

    def __init__(self, config: pytest.Config) -> None:
        self.mode: str = config.getoption("--rig")
        """Value of `--rig`."""
        self._project = config.rootpath
        self._here = config.invocation_params.dir
        self._simulated: str = config.getini("rig_file")
        self._stack = ExitStack()
        self._held = False
        self._worker = _is_worker(config)

    def open(
        self,
        node: pytest.Item | pytest.Collector,
        name: str | None = None,
        plant: Mapping[str, Any] = MappingProxyType({}),
    ) -> Rig:
        """Open a rig for the test `node` (`request.node`); other arguments as in the fixture `open_rig`."""
        simulate = self.mode if self.mode in ("twin", "wire") else None
        file = (
            instruments.load_rig_file(_beside(self._project, name))
            if simulate and name
            else self._asked_for()
        )
        simulated = bool(simulate or file.simulate)
        if plant and not simulated:
            pytest.skip("needs simulation settings, which hardware does not have")
        for mark in node.iter_markers("requires"):
            for needed in mark.args:
                if not _has(file, needed, simulated):
                    pytest.skip(f"the rig {file.name!r} has no {needed}")
        if simulated:
            settings = dict(plant)
            # A plant's name is a key like any other; an object replaces the plant.
            given = None if isinstance(plant.get("plant"), str) else settings.pop("plant", None)
            return instruments.open_rig(file, simulate=simulate, simulation=settings, plant=given)
        self._hold()
        try:
            return instruments.open_rig(file)
        except (errors.ConfigurationError, errors.InstrumentError) as error:
            pytest.skip(f"the rig {self.mode} could not be opened: {error}")

    def close(self) -> None:
        """Release the hardware for other programs."""
        self._stack.close()

    @property
    def _path(self) -> Path:
        if self.mode in ("twin", "wire"):
            return _beside(self._project, self._simulated)
        return _beside(self._here, self.mode)

    def _asked_for(self) -> RigFile:
        try:
            return instruments.load_rig_file(self._path)
        except errors.ConfigurationError as error:
            # An error in the file is not missing hardware: it must not cause skipped tests.
            self._end(error)

    def _end(self, error: Exception) -> NoReturn:
        if self._worker:  # it cannot end the run
            pytest.fail(str(error), pytrace=False)
        pytest.exit(str(error), pytest.ExitCode.USAGE_ERROR)

    def _hold(self) -> None:
        if not self._held:
            file = self._asked_for()
            try:
                self._stack.enter_context(
                    instruments.reserve(instruments.hardware(file, None), f"The rig {file.name!r}")
                )
            except errors.InstrumentError as error:
                self._end(error)
            self._held = True


@pytest.fixture(scope="session")
def rigs(request: pytest.FixtureRequest) -> Iterator[Rigs]:
    """Session-wide `Rigs`, for fixtures of a wider scope; tests use `rig` or `open_rig`."""
    opener = Rigs(request.config)
    yield opener
    opener.close()


@pytest.fixture
def open_rig(rigs: Rigs, request: pytest.FixtureRequest) -> Iterator[OpenRig]:
    """Function that opens a rig as --rig selects: `open_rig(name=None, **simulation)`.

    `name` is a rig file to simulate instead of pytest's setting `rig_file`; `simulation` holds keys of
    `[simulation]`, where `plant` may also be an object. On hardware, the file of --rig is opened and `name`
    is ignored; a test with simulation settings is skipped, and so is every test whose hardware cannot be
    opened. The rigs are closed after the test.
    """
    with ExitStack() as stack:

        def opener(name: str | None = None, **simulation: Any) -> Rig:
            return stack.enter_context(rigs.open(request.node, name, simulation))

        yield opener


@pytest.fixture
def rig(open_rig: OpenRig) -> Rig:
    """An open rig, as --rig selects; it reaches its safe state after the test."""
    return open_rig()


@pytest.fixture
def instrument_twin(request: pytest.FixtureRequest) -> Iterator[Callable[..., Instrument]]:
    """Function that serves an instrument of a table: `instrument_twin("COM3", {"*IDN?": "ACME"})`.

    The name is a serial port, a VISA resource, "http://HOST" or "HOST:PORT", which unchanged code opens by
    pyserial, PyVISA or a socket; no other port or resource is opened. The table is a mapping of commands to
    answers with `state`, `error` and `end`, or a file in pytest's root folder: see `haploop.mocks.tabled`.
    What came is in order in `received`. A command that the table does not have fails the test, unless it has
    an `error`.
    """
    from .tabled import InstrumentTwins  # noqa: PLC0415

    with InstrumentTwins(request.config.rootpath) as bench:
        yield bench.serve
    if unknown := bench.unknown():
        pytest.fail("\n".join(unknown), pytrace=False)


def _beside(folder: Path, name: str) -> Path:
    """Path of a file in a folder, or the bare name of a shipped rig."""
    return folder / name if (folder / name).is_file() else Path(name)


def _ours(item: pytest.Item) -> bool:
    """True when `rigs` is the fixture above, not one of the same name in another project."""
    found = item.session._fixturemanager.getfixturedefs("rigs", item) or ()
    return [f.func.__module__ for f in found][-1:] == [__name__]


def _has(file: RigFile, needed: str, simulated: bool) -> bool:
    """True when a rig has an instrument, a sensor, a table, or (when simulated) a plant."""
    from ..instruments.config import roles  # noqa: PLC0415

    parts: dict[str, object] = {role: getattr(file, role, None) for role in roles()}
    parts |= {name: sensor or None for name, sensor in file.sensors}
    parts |= {"table": file.table, "simulation": simulated or None}
    if needed not in parts:
        pytest.fail(f"requires() does not know {needed!r}; it accepts {', '.join(parts)}", pytrace=False)
    return parts[needed] is not None
