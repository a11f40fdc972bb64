"""Options and contexts that several commands use."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click
from click.core import ParameterSource

from .. import instruments
from ..reports import outputs
from ..terminal.exits import CommandState
from ..terminal.progress import note
from . import public as haploop

if TYPE_CHECKING:
    from ..instruments import Rig, RigFile
    from ..instruments.driver import Mode
    from ..instruments.tape import Player

RIG = click.option(
    "--rig",
    "-r",
    default="simulated",
    show_default=True,
    metavar="FILE",
    help="Rig file, or the name of a shipped rig.",
)

JSON = click.option("--json", "as_json", is_flag=True, help="Print one JSON object on standard output.")
ONLY = click.option(
    "--only",
    nargs=2,
    multiple=True,
    metavar="COLUMN VALUE",
    help="Take only lines with this value, for example: --only timing possible --only complete true.",
)
NOTES = click.option("--notes", default="", help="Notes; stored in the recording.")


_LARGEST = 1e6


class FiniteRange(click.FloatRange):
    """A range of numbers that also refuses NaN, which passes every comparison."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Convert a value; raise click.BadParameter for NaN or a value out of range."""
        if math.isnan(found := super().convert(value, param, ctx)):
            self.fail(f"{value!r} is not a number.", param, ctx)
        return found


class _Named(click.Path):
    """A file or a folder, which "" names none of: a script's variable that is not set."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Convert a value; raise click.BadParameter for an empty one."""
        if not str(value):
            self.fail("an empty name is no file or folder: name one, such as . for this folder.", param, ctx)
        return super().convert(value, param, ctx)


PATH = _Named(path_type=Path)


class Measure(click.ParamType):  # type: ignore[type-arg, unused-ignore]  # not generic before 8.3
    """A number with or without its unit, times a factor."""

    name = "number"

    def __init__(self, unit: str, factor: float = 1.0) -> None:
        self._unit, self._factor = unit, factor

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """The number in the program's unit."""
        if isinstance(value, float):
            return value
        text = str(value).strip().lower().removesuffix(self._unit.lower()).strip()
        try:
            number = float(text)
        except ValueError:
            number = float("nan")
        if not abs(number) < _LARGEST:
            self.fail(f"{value!r} is no number of {self._unit}: for example 5.", param, ctx)
        return self._factor * number


class Names(click.ParamType):  # type: ignore[type-arg, unused-ignore]  # not generic before 8.3
    """Names with commas between them."""

    name = "list"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, ...]:
        """Convert a value; raise click.BadParameter for no name, or one that is there twice."""
        if isinstance(value, tuple):
            return value
        names = tuple(name.strip() for name in str(value).split(","))
        if not all(names) or len(set(names)) < len(names):
            self.fail(f"{value!r} is no list of names: write them as A,B,C,D, each once.", param, ctx)
        return names


class NewFile(click.Path):
    """A file to write: one that does not exist, in a folder that does, with one of `suffixes`, if any."""

    def __init__(self, *suffixes: str) -> None:
        super().__init__(path_type=Path)
        self._suffixes = suffixes

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Convert a value; raise ConfigurationError if it cannot be written."""
        path = Path(str(super().convert(value, param, ctx)))
        outputs.check_new_file(path, self._suffixes)
        return path


TAPE = "tape:"
"""See `haploop.instruments.driver.TAPE`, which takes a fifth of a second to import."""


class _Simulation(click.ParamType):  # type: ignore[type-arg, unused-ignore]  # not generic before 8.3
    """twin, wire, or a tape."""

    name = "twin|wire|tape:FILE"

    def __init__(self, tapes: bool) -> None:
        self._tapes = tapes
        self._known = "twin, wire or tape:FILE" if tapes else "twin or wire"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Convert a value; raise click.BadParameter for another word."""
        if value not in ("twin", "wire") and not (self._tapes and value.startswith(TAPE) and value != TAPE):
            self.fail(f"{value!r} is not {self._known}.", param, ctx)
        return str(value)


_SIMULATED = (
    "Simulate the rig. twin: simulated instruments in process. wire: the real drivers talk to simulated "
)
SIMULATE = click.option("--simulate", type=_Simulation(False), metavar="MODE", help=_SIMULATED + "devices.")
_SIMULATE = click.option(
    "--simulate",
    type=_Simulation(True),
    metavar="MODE",
    help=_SIMULATED + "devices. tape:FILE: they talk to a tape, on the rig that it holds.",
)
TAPED = click.option(
    "--tape",
    type=NewFile(".tape"),
    metavar="FILE.tape",
    help="Record every call between haploop and the devices, to be played back by --simulate tape:FILE.tape.",
)
NEW = NewFile()
PICTURE = NewFile(".png", ".pdf", ".svg", ".csv")
PLOT = click.option(
    "--plot", type=PICTURE, metavar="OUT.png", help="Also draw a figure (PNG, PDF, SVG; CSV: its numbers)."
)
PLAYS = click.option(
    "--plays",
    type=click.IntRange(3, 1000),
    default=8,
    show_default=True,
    help="Number of plays. A check plays up to eight times as many where these do not tell the verdict.",
)
EXITS = {"pass": 0, "fail": 1, "not shown": 4}
"""Exit code of a verdict: what cannot be told is neither passed nor out of tolerance."""
FINGER = click.option(
    "--finger",
    metavar="PARTICIPANT",
    help="While this participant's fingertip rests on the point: when asked, rest it and hold still.",
)
FORCE = click.option(
    "--force",
    type=FiniteRange(0.1, 20),
    metavar="N",
    help="Force of that finger (N).  [default: 1, or the calibration's]",
)
_Command = TypeVar("_Command", bound=Callable[..., Any])
_AVERAGES = ("automatic", "barycentre", "registration", "mean")


def average_option(default: str | None = "automatic") -> Callable[[_Command], _Command]:
    """Option for the average of the presses; None is the default of a study's file."""
    return click.option(
        "--average",
        "-a",
        type=click.Choice(_AVERAGES),
        default=default,
        help="Average of the presses. barycentre: the paper's dynamic time warping, per participant and then "
        "over participants. registration: smooth warps. mean: aligned at the activation only. automatic: "
        "the one with the smaller error on held-out presses.  "
        f"[default: {default or 'as the study says'}]",
    )


AVERAGE = average_option()


@dataclass(frozen=True)
class ChosenRig:
    """The rig that a command was told to use, and how it is simulated."""

    name: str | None
    """Path of a rig file, or the name of a shipped rig; None for the rig on the tape."""
    simulate: Mode | None
    state: CommandState
    taped: bool = False
    """True when the session is recorded on a tape."""

    def load(self) -> RigFile:
        """Read the rig file."""
        if self.name is None:
            return haploop.instruments.tape_rig(str(self.simulate).removeprefix(TAPE))
        return haploop.load_rig_file(self.name)

    @contextmanager
    def reserved(self) -> Iterator[RigFile]:
        """Load the rig file, and reserve its hardware for this program."""
        file = self.load()
        if self.taped:
            instruments.check_recordable(file, self.simulate or file.simulate)
        if self.simulate or file.simulate:
            yield file
            return
        with instruments.reserve(instruments.hardware(file, None), f"The rig {file.name!r}"):
            yield file

    @contextmanager
    def open(self, file: RigFile, real_time: bool = False) -> Iterator[Rig]:
        """Open the rig, publish it for `haploop live`, and print a note when it is simulated."""
        from .live_views import published  # noqa: PLC0415

        with haploop.open_rig(file, self.simulate, real_time=real_time) as opened, published(opened):
            self.state.rig_opened, self.state.at_rest = True, file.at_rest
            if opened.simulated:
                note(f"Everything here is simulated ({_world(opened)}).")
            yield opened

    @contextmanager
    def opened(self, real_time: bool = False) -> Iterator[Rig]:
        """Reserve the rig, and open it; a simulated one in `real_time` for a person who watches."""
        with self.reserved() as file, self.open(file, real_time) as opened:
            yield opened


def on_rig(
    option: Callable[[Any], Any] = RIG, opens: bool = True
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Options --rig, as `option` has it, and --simulate: the command gets a `ChosenRig` as `rig`.

    A command that opens the rig records its session on a tape, or plays one.
    """

    def decorate(command: Callable[..., Any]) -> Callable[..., Any]:
        @click.pass_context
        @wraps(command)
        def chosen(
            ctx: click.Context, /, *, rig: str, simulate: Mode | None, tape: Path | None = None, **others: Any
        ) -> Any:
            with tape_session(simulate, tape) as player:
                own = player is not None and ctx.get_parameter_source("rig") is ParameterSource.DEFAULT
                chosen = ChosenRig(None if own else rig, simulate, ctx.obj, tape is not None)
                return command(rig=chosen, **others)

        decorated: Callable[..., Any] = option(_SIMULATE(TAPED(chosen)) if opens else SIMULATE(chosen))
        return decorated

    return decorate


@contextmanager
def tape_session(simulate: Mode | None, tape: Path | None) -> Iterator[Player | None]:
    """Record or play the session of a command; give what plays."""
    if simulate is not None and simulate.startswith(TAPE):
        if tape is not None:
            raise click.UsageError("A session that is played back is on a tape already: leave out --tape.")
        with haploop.instruments.played(simulate.removeprefix(TAPE)) as player:
            if not player.whole:
                note(f"{player.path} was cut off: it holds its first {player.calls} calls.")
            yield player
            note(f"{player.answered} of the tape's {player.calls} calls were asked for.")
    elif tape is not None:
        from ..instruments.tape import recording_of  # noqa: PLC0415

        with recording_of(tape) as recorder:
            try:
                yield None
            finally:
                said = f"{tape} holds {recorder.calls} calls." if recorder.calls else "No call was recorded."
                note(said)
    else:
        yield None


def _world(rig: Rig) -> str:
    if rig.mode is None:
        return "by its DAQ cards"
    return rig.mode if rig.mode.startswith(TAPE) else f"{rig.mode}, seed {rig.file.simulation.seed}"


def on_table(rig: Rig, point: str) -> None:
    """Raise ConfigurationError for a point that is not on the rig's table."""
    points = rig.table.rows * rig.table.columns
    if point != "button" and point not in map(str, range(points)):
        raise haploop.ConfigurationError(
            f"The table has no point {point!r}: use 'button', or a number from 0 to {points - 1}."
        )
