"""A new experiment from an example, with the digital buttons that the rig plays in it."""

from __future__ import annotations

import re
import shutil
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path

from ...base.errors import ConfigurationError
from ...base.files import beside, check_destination, new_file
from ...calibration import DigitalButton
from ..protocol import load_experiment


def new_experiment(folder: str | Path, example: str | Path, buttons: Sequence[str | Path] = ()) -> None:
    """Copy an example's file into a folder as `experiment.toml`, and its digital buttons beside it.

    With `buttons` the lines of the example that begin with "#:" are taken in: they make the rig play them.
    Each button must have the name of one that the example lists; if it lists one, any button will do.
    Raises ConfigurationError: other buttons than the example's, or a file that exists; DataError.
    """
    path, source = Path(folder) / "experiment.toml", load_experiment(example).path
    text = source.read_text(encoding="utf-8")
    found: dict[Path, Path] = {}
    if buttons:
        text = re.sub(r"^#: ?", "", text, flags=re.MULTILINE)
        named = {DigitalButton.load(one).press.button: Path(one) for one in buttons}
        listed = tomllib.loads(text).get("buttons", {})
        found = {
            beside(path.parent, file, str(source)): one
            for file, one in _matched(source, listed, named, len(buttons))
        }
    for file in (path, *found):
        check_destination(file)
    for file, one in found.items():
        with new_file(file) as part:
            shutil.copyfile(one, part)
    with new_file(path) as part:
        part.write_text(text, encoding="utf-8", newline="\n")


def _matched(
    source: Path, listed: Mapping[str, str], named: Mapping[str, Path], given: int
) -> list[tuple[str, Path]]:
    if len(listed) == given == 1:
        return [(next(iter(listed.values())), next(iter(named.values())))]
    if set(listed) != set(named) or len(named) != given:
        needed = f"one file of each of {', '.join(listed)}" if listed else "none"
        raise ConfigurationError(
            f"{source} plays other digital buttons than {', '.join(named)}: give {needed}, or change its "
            "levels and [buttons] in a copy."
        )
    return [(file, named[name]) for name, file in listed.items()]
