"""A rig's session on tape: what a recorder must know of each opening, and the world that a tape plays."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ...base import entry_points
from ...base.clock import Clock
from ...base.errors import ConfigurationError, DataError
from ..config import Device, RigFile
from ..driver import Driver, Mode, is_arithmetic, settings_of
from ..operator import Operator, Request, UnansweredError
from ..tape import Failure, Player, Recorder, TapedLine, current, on_line, taped_line
from .rig import Rig

_UNANSWERED = (Failure(UnansweredError),)


class PlayedWorld:
    """See `haploop.instruments.driver.Simulation`: the real drivers, answered by a tape."""

    truth: Any = None

    def __init__(self, player: Player) -> None:
        """Go on to the tape's next rig. Raises DataError when this version cannot read it."""
        self.player = player
        self.opening, clock = player.begin()
        self.clock: Clock = clock
        self.state = Path(tempfile.mkdtemp(prefix="haploop-tape-"))
        """Folder of the log and the lockouts."""

    @property
    def file(self) -> RigFile:
        """The rig file on the tape. Raises DataError when this version cannot read it."""
        return _rig_of(self.opening.rig, self.player.path)

    def instrument(self, role: str, device: Device, driver: Driver, mode: Mode) -> Any:
        """Open a driver, answered by the tape. Raises ConfigurationError for one that is not taped."""
        if role == "operator":
            return TapedOperator(None, self._line(role))
        _check_taped(role, device, driver, "played")
        settings = settings_of(driver, device, role, "the tape")
        changes = self.opening.changes.get(role, {})
        with on_line(self.player, role):
            return driver.open(settings.model_copy(update=dict(changes)), self.clock)

    def close(self) -> None:
        """Remove the log."""
        shutil.rmtree(self.state, ignore_errors=True)

    def _line(self, role: str) -> TapedLine:
        return TapedLine(self.player, role)


def tape_rig(path: str | Path) -> RigFile:
    """The rig that was first opened while a tape was written.

    Raises ConfigurationError, DataError.
    """
    session = current()
    found = session if isinstance(session, Player) and session.path == Path(path) else Player(Path(path))
    return _rig_of(found.openings[0].rig, found.path)


def _rig_of(text: str, path: Path) -> RigFile:
    try:
        return RigFile.model_validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"]))
        raise DataError(
            f"The rig file on the tape {path} cannot be read ({key}: {first['msg']}): give it by --rig."
        ) from None


class TapedOperator(Operator):
    """A person whose answers go on a tape, or come from one."""

    def __init__(self, person: Operator | None, line: TapedLine) -> None:
        self._person, self._line = person, line

    def tell(self, request: Request) -> None:
        """See `Operator.tell`."""
        self._asked("tell", lambda person: person.tell(request), request)

    def confirm(self, request: Request) -> bool:
        """See `Operator.confirm`."""
        return bool(self._asked("confirm", lambda person: person.confirm(request), request))

    def rejects(self) -> bool:
        """See `Operator.rejects`."""
        return bool(self._asked("rejects", lambda person: person.rejects()))

    def paused(self) -> bool:
        """See `Operator.paused`."""
        return bool(self._asked("paused", lambda person: person.paused()))

    def notes(self) -> Sequence[str]:
        """See `Operator.notes`."""
        return tuple(map(str, self._asked("notes", lambda person: tuple(person.notes()))))

    def _asked(self, what: str, ask: Callable[[Operator], Any], *given: Any) -> Any:
        def make() -> Any:
            assert self._person is not None, "a player calls nobody"
            return ask(self._person)

        return self._line.call(what, make, *given, failures=_UNANSWERED)


class _Noted:
    """A driver that tells a recorder with what settings it is opened: a wire's have its address."""

    def __init__(self, driver: Driver, recorder: Recorder, role: str, settings: Any) -> None:
        self._driver, self._recorder, self._role, self._settings = driver, recorder, role, settings

    def __getattr__(self, name: str) -> Any:
        return getattr(self._driver, name)

    def open(self, settings: Any, clock: Clock) -> Any:
        """See `Driver.open`."""
        before, now = self._settings.model_dump(mode="json"), settings.model_dump(mode="json")
        changes = {key: value for key, value in now.items() if before.get(key) != value}
        if changes:
            self._recorder.opening(self._role, changes)
        return self._driver.open(settings, clock)


@contextmanager
def recording(rig: Rig, role: str, device: Device, driver: Any) -> Iterator[tuple[Any, TapedLine]]:
    """Give the driver to open, and its line: to the session's recorder, if it has one."""
    deck = current()
    if not isinstance(deck, Recorder) or isinstance(rig.simulation, PlayedWorld):
        yield driver, TapedLine(None, role)
        return
    with on_line(deck, role):
        settings = settings_of(driver, device, role, rig.name)
        yield _Noted(driver, deck, role, settings), taped_line()


def is_of_hardware(world: object) -> bool:
    """True for a tape of a session on hardware, which is opened by the same calls."""
    return isinstance(world, PlayedWorld) and world.opening.mode is None


def check_recordable(file: RigFile, mode: Mode | None) -> None:
    """Raise ConfigurationError for a rig whose calls no tape would hold, whole."""
    if mode == "twin":
        raise ConfigurationError(
            "A twin makes no calls that a tape could hold: record one with --simulate wire, or on hardware."
        )
    for role, device in file.devices.items():
        if role != "operator":
            _check_taped(role, device, entry_points.driver_class(device.driver, role), "recorded")


def _check_taped(role: str, device: Device, driver: Any, what: str) -> None:
    if not is_arithmetic(driver) and not getattr(driver, "taped", False):
        raise ConfigurationError(
            f"The {role} cannot be {what} on a tape: its driver {device.driver!r} calls its device past it. "
            "Take it out of the rig file for this session."
        )
