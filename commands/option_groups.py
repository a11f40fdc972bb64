"""Options that travel together: a command gets each group as one value.

`grouped` makes the decorator of a group from a dataclass and one option for each of its fields.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from ..reports import show
from . import public as haploop
from .options import AVERAGE, FINGER, FORCE, JSON, PATH, PLAYS, PLOT, FiniteRange, Names

if TYPE_CHECKING:
    from ..acquisition import AverageMethod, Protocol, Representative
    from ..calibration import Calibration
    from ..calibration.drive import Wanted
    from ..reports.contents import Contents
    from ..reports.figures import Columns


_Command = TypeVar("_Command", bound=Callable[..., Any])


def grouped(name: str, kind: type, *options: Callable[[Any], Any]) -> Callable[[_Command], _Command]:
    """Give a command `options` as one value, an instance of the dataclass `kind`, by the name `name`."""
    own = [field.name for field in fields(kind)]

    def decorate(command: _Command) -> _Command:
        @wraps(command)
        def called(**given: Any) -> Any:
            value = kind(**{field: given.pop(field) for field in own})
            return command(**{name: value}, **given)

        decorated: Any = called
        for option in reversed(options):
            decorated = option(decorated)
        return decorated  # type: ignore[no-any-return]

    return decorate


@dataclass(frozen=True)
class AskedPress:
    """Presses, and the calibrations of the patches that are to play them."""

    presses: Sequence[Path]
    calibrations: Sequence[Path]
    patches: Sequence[str] | None
    average: AverageMethod

    def load_calibrations(self) -> tuple[Calibration, ...]:
        """Read the calibrations."""
        return haploop.load_calibrations(self.calibrations, self.patches or ())

    def load_press(self) -> Representative:
        """Read the press, or average the recordings' presses."""
        return haploop.load_press(self.presses, self.average)


on_press = grouped(
    "asked",
    AskedPress,
    click.argument("presses", nargs=-1, required=True, type=PATH, metavar="PRESS..."),
    click.option(
        "--calibration",
        "-c",
        "calibrations",
        required=True,
        multiple=True,
        type=PATH,
        metavar="FILE",
        help="Calibration file written by `haploop calibrate`; repeatable, one for each patch.",
    ),
    click.option(
        "--patches",
        type=Names(),
        metavar="LIST",
        help="Patches to play at once, for example A,B,C,D; -c FILE.h5 then stands for FILE-A.h5, FILE-B.h5 "
        "and so on.  [default: those of the calibrations]",
    ),
    AVERAGE,
)


@dataclass(frozen=True)
class AskedPlays:
    """How often a drive is played for a check, and under whose finger, at which force (N)."""

    plays: int
    finger: str | None
    force: float | None

    def __post_init__(self) -> None:
        """Raises click.UsageError for a force of nobody's finger."""
        if self.finger is None and self.force is not None:
            raise click.UsageError("--force belongs to --finger PARTICIPANT.")


on_plays = grouped("played", AskedPlays, PLAYS, FINGER, FORCE)


@dataclass(frozen=True)
class AskedElsewhere:
    """What other points of the table are to do at the same time."""

    quiet_at: Sequence[str]
    also: Sequence[tuple[str, Path]]
    times: Sequence[tuple[str, float]]
    map_folder: Path | None

    def load_wanted(self, average: AverageMethod) -> Wanted:
        """Read the press of each point that plays one, and its size; None where it is silent."""
        return haploop.calibration.load_elsewhere(self.also, self.quiet_at, self.times, average)

    def load_calibrations(
        self, calibrations: Sequence[Calibration], points: Collection[str]
    ) -> tuple[Calibration, ...]:
        """Add to calibrations those of `points` that only the map has."""
        if self.map_folder is None:
            return tuple(calibrations)
        if not points:
            raise click.UsageError("--map belongs to --quiet-at and --also: it has what other points need.")
        return haploop.calibration.with_map(
            calibrations, haploop.calibration.VibrationMap.load(self.map_folder), points
        )


on_elsewhere = grouped(
    "elsewhere",
    AskedElsewhere,
    click.option(
        "--quiet-at",
        type=Names(),
        default=(),
        metavar="LIST",
        help="Grid points that are to be silent, for example 31,57.",
    ),
    click.option(
        "--also",
        type=(str, PATH),
        multiple=True,
        metavar="POINT PRESS",
        help="Grid point that is to play another press at the same time; repeatable. Points are no more than "
        "patches, the button's included.",
    ),
    click.option(
        "--times",
        type=(str, float),
        multiple=True,
        metavar="POINT SIZE",
        help="Size at which a press of --also is played, over that of the button's own, for example 57 0.5.  "
        "[default: 1]",
    ),
    click.option(
        "--map",
        "map_folder",
        type=PATH,
        metavar="DIR",
        help="Folder of `haploop map`, for points of --quiet-at and --also without a calibration.",
    ),
)


@dataclass(frozen=True)
class Prompts:
    """How a session prompts and waits; None is what its protocol says."""

    wait: float | None
    patience: float | None
    attempts: int | None

    def adapt(self, protocol: Protocol) -> Protocol:
        """Return `protocol` with what was asked for."""
        return replace(protocol, **{name: value for name, value in asdict(self).items() if value is not None})


on_prompts = grouped(
    "prompts",
    Prompts,
    click.option(
        "--wait",
        type=FiniteRange(0, 86_400),
        metavar="SECONDS",
        help="How long a session waits for a participant who is away, in all, before it ends.  "
        "[default: 600]",
    ),
    click.option(
        "--patience",
        type=FiniteRange(0, 600, min_open=True),
        metavar="SECONDS",
        help="How long each prompt has before it is repeated.  [default: 15]",
    ),
    click.option(
        "--attempts",
        type=click.IntRange(1, 100),
        help="Attempts at one press before the session ends.  [default: 5]",
    ),
)


@dataclass(frozen=True)
class Shown:
    """How a result with a figure is shown."""

    plot: Path | None
    columns: Columns
    as_json: bool

    def print(self, contents: Contents) -> None:
        """See `show.print_contents`."""
        show.print_contents(contents, self.as_json, self.plot, self.columns)


COLUMNS = click.option(
    "--columns",
    type=click.IntRange(1, 2),
    default=2,
    show_default=True,
    help="Width of the picture: one or two columns of a journal (88 or 180 mm).",
)
showing = grouped("shown", Shown, PLOT, COLUMNS, JSON)
