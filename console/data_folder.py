"""What a page may name and send: files of the data folder, no other, and fields, which are bounded.

Beside the folder stands the rig's history of calibrations.
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from ..base.errors import ConfigurationError
from ..base.files import stamp
from ..calibration import History
from ..experiments import Store, load_experiment

_LONGEST = 255
"""Bytes of a name that every usual file system takes."""


class DataFolder:
    """A folder, and the only way from a name that a page sent to a path."""

    def __init__(self, root: Path, calibrations: Path) -> None:
        self.root = root.expanduser().resolve()
        self.history = History(calibrations.expanduser().resolve())
        """The history that `haploop recalibrate` keeps; it may lie elsewhere, and no page names it."""

    @property
    def sitting(self) -> Path:
        """File whose mark (`marked`) says that a server conducts a session of an experiment."""
        return self.root / "experiment-session"

    @property
    def calibrations(self) -> str:
        """A mark of the rig's history, another one after each activation and each verification of anybody."""
        folder = self.history.folder
        return f"{stamp(folder / 'activations.json')} {stamp(folder / 'looks.json')}"

    def path(self, name: object) -> Path:
        """Return the path of a name relative to this folder, with forward slashes.

        Raises ConfigurationError for a name that leads out of it, also by a symbolic link, and for hidden
        files.
        """
        text = name if isinstance(name, str) else ""
        parts = text.split("/")
        wrong = not text or any(
            part in ("", "..")
            or part.startswith(".")
            or set(part) & set('\\:*?"<>|\0')
            or len(part.encode("utf-8", "replace")) > _LONGEST
            for part in parts
        )
        path = self.root.joinpath(*parts) if not wrong else self.root
        try:
            inside = not wrong and path.resolve().is_relative_to(self.root)
            with suppress(FileNotFoundError, NotADirectoryError):
                path.lstat()  # `resolve` passes over a path that the system does not take
        except (OSError, RuntimeError, ValueError):
            inside = False
        if not inside:
            raise ConfigurationError(
                f"{text[:80]!r} is no file of the console's data folder {self.root}: name one below it."
            )
        return path

    def shown(self, path: Path) -> str:
        """Return the name of a path that was found below this folder; "" for one that `path` refuses."""
        name = path.relative_to(self.root).as_posix()
        try:
            self.path(name)
        except ConfigurationError:
            return ""
        return name

    def found(self, pattern: str) -> list[str]:
        """Return the names of what a glob pattern finds, in order, without those that `path` refuses."""
        return sorted(filter(None, map(self.shown, self.root.glob(pattern))))

    def name(self, path: Path) -> str:
        """Return the name of a path below this folder, with forward slashes.

        Raises ConfigurationError for one that a link leads out of it.
        """
        try:
            return path.resolve().relative_to(self.root).as_posix()
        except (OSError, RuntimeError, ValueError):
            raise ConfigurationError(
                f"{path} leads out of the console's data folder {self.root}: put a folder or file in place "
                "of the link."
            ) from None

    def study(self, name: object) -> Path:
        """Return the folder of a study, as `path`, in which no link leads out to other recordings."""
        folder = self.path(name)
        for part in (folder / "study.toml", *folder.glob("recordings"), *folder.glob("recordings/*.h5")):
            self.name(part)
        return folder


def store_of(data: DataFolder, name: object) -> Store:
    """Return the experiment in a folder of the data folder, with its answers. Raises HaploopError."""
    experiment = load_experiment(data.path(f"{name}/experiment.toml"))
    return Store(experiment, data.path(f"{name}/answers"))


_LONGEST_TEXT = 200
"""Bytes of a text that a page sends: what an event of a recording holds."""


def clean(text: object, what: str, least: int = 0) -> str:
    """Return a text of a page on one line. Raises ConfigurationError when it is too long or too short."""
    line = " ".join(str(text).split())
    if not least <= len(line) or len(line.encode()) > _LONGEST_TEXT:
        raise ConfigurationError(f"{what} must have {least} to {_LONGEST_TEXT} characters, not {len(line)}.")
    return line


def whole(value: object, what: str, least: int, most: int) -> int:
    """Read a whole number. Raises ConfigurationError."""
    try:
        number = int(str(value))
    except ValueError:
        number = least - 1
    if not least <= number <= most:
        raise ConfigurationError(
            f"{what} must be a whole number from {least} to {most}, not {str(value)[:20]!r}."
        )
    return number
