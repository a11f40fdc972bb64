"""What a file states that it was made from: kinds, names and content hashes, as its own fields hold them."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ...base import hdf5
from ...base.checksum import opened

if TYPE_CHECKING:
    from ...acquisition import Recording, Representative
    from ...calibration import Calibration, Check, DigitalButton, Drive
    from ...experiments import Experiment

_IMPORTED = re.compile(r"imported from (.+), sha256 ([0-9a-f]{64})")
_MAPPED = re.compile(r"map, SHA-256 ([0-9a-f]{16})")


class Source(NamedTuple):
    """One source of a file."""

    kind: str
    """As `Entry.kind`; "original" for a file of another program, of which a hash over its bytes is known."""
    name: str
    """File name at that time; empty where none was stated."""
    content: str
    """Content hash, or its beginning; empty for a file that is named by its path."""
    sources: tuple[Source, ...] = ()
    """What it was made from itself, where it need not be a file: a press of recordings, say."""


def packed(sources: Iterable[Source]) -> str:
    """Sources as the text that an index keeps; empty for none."""
    found = [*dict.fromkeys(sources)]
    return json.dumps(found) if found else ""


def stated(text: str) -> tuple[Source, ...]:
    """The sources in a text of `packed`."""
    return _read(json.loads(text)) if text else ()


def _read(rows: list[Any]) -> tuple[Source, ...]:
    return tuple(Source(kind, name, content, _read(own)) for kind, name, content, own in rows)


def of_recording(recording: Recording) -> tuple[Source, ...]:
    """The file that it was imported from."""
    said = recording.imported
    return (Source("original", said["file"], said["sha256"]),) if said else ()


def of_press(press: Representative) -> tuple[Source, ...]:
    """The recordings that it stands for, or the file that it was imported from."""
    kind = "original" if press.method == "imported" else "recording"
    return tuple(Source(kind, name, content) for name, content in press.sources)


def of_calibration(calibration: Calibration, content: str) -> tuple[Source, ...]:
    """Its waveforms, the map, or the file that it was imported from."""
    said = calibration.response.source
    if imported := _IMPORTED.fullmatch(said):
        return (Source("original", imported[1], imported[2]),)
    if mapped := _MAPPED.fullmatch(said):
        return (Source("map", "", mapped[1]),)
    return (Source("waveforms", "", content),)


def of_drive(drive: Drive) -> tuple[Source, ...]:
    """The recordings of its presses, and its calibration; of several, their common hash names no file."""
    stated_by = (drive.sources, *(one.sources for one in drive.elsewhere))
    recordings = [Source("recording", name, content) for some in stated_by for name, content in some]
    alone = len(drive.patches) * len(drive.points) == 1
    name = "" if alone else f"of patches {drive.patch}, at {', '.join(drive.points)}"
    return (*recordings, Source("calibration" if alone else "calibrations", name, drive.calibration))


def of_check(check: Check) -> tuple[Source, ...]:
    """Its drive."""
    return (Source("drive", "", _digest(check.drive), of_drive(check.drive)),)


def of_button(button: DigitalButton) -> tuple[Source, ...]:
    """Its presses and calibrations, and what these were made from."""
    presses = [
        Source("representative", "", _digest(one), of_press(one)) for one in (button.press, *button.others)
    ]
    fingers = [Source("calibration", "", one.calibration) for one in _pressed(button) if not one.patches[1:]]
    return (*presses, *map(_calibration, button.calibrations), *fingers)


def of_experiment(experiment: Experiment) -> tuple[Source, ...]:
    """The digital buttons that it plays, by their paths."""
    names = (*experiment.file.buttons.values(), *experiment.file.surface.releases.values())
    folder = experiment.path.parent.resolve()
    return tuple(Source("button", str(folder / name), "") for name in dict.fromkeys(names))


def drives_in(button: DigitalButton) -> tuple[str, ...]:
    """Content hashes of the drives that a button holds, by which a check names it."""
    return tuple(map(_digest, (button.drive, *_pressed(button))))


def _pressed(button: DigitalButton) -> tuple[Drive, ...]:
    return tuple(one.drive for one in button.pressed_checks)


def _calibration(calibration: Calibration) -> Source:
    response, content = calibration.response, calibration.digest
    place = f"patch {response.patch} at {response.point}"
    # What a map gives of a point is in no file of its own; any other calibration is, or is missing.
    sources = tuple(one for one in of_calibration(calibration, content) if one.kind == "map")
    return Source("calibration", place, content, sources)


def _digest(value: Any) -> str:
    return hdf5.digest(hdf5.flatten(value))


def measured_for(path: Path) -> str:
    """Content hash of the calibration that waveforms were measured for."""
    with opened(path) as file:
        return str(file.attrs["calibration"])
