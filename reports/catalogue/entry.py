"""What the catalogue knows of a file, and what the file states that it was made from."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ...base import hdf5
from ...base.checksum import opened
from ...base.errors import HaploopError

if TYPE_CHECKING:
    from ...acquisition import Recording, Representative
    from ...calibration import Calibration, Check, DigitalButton, Drive


_PLAYED = ("drive", "check", "button")


KINDS = (
    *("recording", "representative", "calibration", "waveforms", "drive", "learning", "check", "button"),
    *("plan", "curve", "map", "map point", "map modes", "study", "experiment", "damaged", "unreadable"),
)
"""What the kind of a file can be."""


@dataclass(frozen=True)
class Entry:
    """One file; what a kind of file does not have is empty. The order of the fields is that of the index."""

    file: str
    """Absolute path."""
    kind: str
    """"recording", "representative", "drive", "check", "calibration", "button", "map", "study",
    "experiment", another kind that haploop writes, "damaged", or "unreadable"."""
    participant: str = ""
    button: str = ""
    date: str = ""
    """When it was measured or made, ISO 8601."""
    verdict: str = ""
    """Of a check and a button: pass, fail, not shown. Of a recording: complete, incomplete."""
    presses: str = ""
    """Of a recording: accepted presses of those asked for, as 9/10."""
    rig: str = ""
    simulated: str = ""
    """yes, no, or empty where a file does not say."""
    study: str = ""
    patch: str = ""
    point: str = ""
    content_hash: str = ""
    problem: str = ""
    """One sentence on a file that cannot be read."""
    made_from: str = ""
    """What it states to be made from, as JSON: see `sources.Source`. Empty where it states nothing."""
    holds: str = ""
    """Content hashes of what other files name instead of this one, with spaces between: a button's drives,
    the calibration of waveforms."""

    @property
    def settled(self) -> bool:
        """False for what may still change: a recording that is not finished, a file that may not be read."""
        return self.verdict != "incomplete" and self.kind != "unreadable"


def entry_of(path: str) -> Entry | None:
    """Read a file's entry, verified by its content hash; None for a file that haploop did not write."""
    found = Path(path)
    try:
        named = {"map.json": _map, "study.toml": _study, "experiment.toml": _experiment}
        return named.get(found.name, _hdf5)(found)
    except HaploopError as error:
        return Entry(path, "damaged", problem=" ".join(str(error).split()))
    except FileNotFoundError:
        said = "it has gone, is a link that leads nowhere, or has a name that is not UTF-8"
        return Entry(path, "unreadable", problem=f"{path} cannot be read: {said}.")
    except OSError as error:
        return Entry(path, "unreadable", problem=f"{path} cannot be read: {error.strerror}.")


def _hdf5(path: Path) -> Entry | None:
    # Here, because a catalogue without new files needs none of it.
    from ...acquisition import Curve, Recording, Representative, content_hash  # noqa: PLC0415
    from ...calibration import Calibration  # noqa: PLC0415

    with path.open("rb") as file:
        start = file.read(1024)
    if b"\x89HDF" not in start:
        return Entry(str(path), "damaged", problem=f"{path} is no HDF5 file.")
    try:
        kind = hdf5.kind_of(path)
    except HaploopError as error:
        if "not written by this version of haploop" in str(error):
            return None
        raise
    if kind == "recording":
        return _recording(Recording.open(path))
    own = {"file": str(path), "kind": kind, "content_hash": content_hash(path)}
    entry = Entry(**own)
    if kind == "representative":
        press = Representative.load(path)
        made = packed(of_press(press))
        entry = Entry(**own, button=press.button, simulated=_yes(press.simulated), made_from=made)
    elif kind == "calibration":
        calibration = Calibration.load(path)
        response = calibration.response
        entry = Entry(
            **own,
            date=response.created,
            rig=response.rig,
            simulated=_yes(response.simulated),
            patch=response.patch,
            point=response.point,
            made_from=packed(of_calibration(calibration, own["content_hash"])),
        )
    elif kind == "waveforms":
        entry = _waveforms(path, own)
    elif kind == "curve":
        curve = Curve.load(path)
        made = packed([Source("original", curve.source, curve.source_sha256)])
        entry = Entry(**own, button=curve.button, simulated=_yes(curve.simulated), made_from=made)
    elif kind == "plan":
        entry = _plan(path, own)
    elif kind in _PLAYED:
        entry = _played(path, own)
    return entry


def _waveforms(path: Path, own: dict[str, str]) -> Entry:
    """Of all that was measured, what it says of itself; it holds the calibration that it was measured for."""
    with opened(path) as file:
        said = dict(file.attrs)
    patch, point, holds = (str(said[name]) for name in ("patch", "point", "calibration"))
    return Entry(**own, simulated=_yes(bool(said["simulated"])), patch=patch, point=point, holds=holds)


def _plan(path: Path, own: dict[str, str]) -> Entry:
    from ...calibration import ButtonPlan  # noqa: PLC0415 - of a recording nothing of it is loaded

    plan = ButtonPlan.load(path)
    made = packed(Source("recording", name, content) for name, content in plan.sources)
    return Entry(**own, button=plan.button, rig=plan.rig, simulated=_yes(plan.simulated), made_from=made)


def _played(path: Path, own: dict[str, str]) -> Entry:
    """A drive, or what holds one."""
    from ...calibration import Check, DigitalButton, Drive  # noqa: PLC0415

    kind = own["kind"]
    kinds: dict[str, type[Drive | Check | DigitalButton]] = {
        "drive": Drive,
        "check": Check,
        "button": DigitalButton,
    }
    made = kinds[kind].load(path)
    drive = made if isinstance(made, Drive) else made.drive
    if isinstance(made, DigitalButton):
        found, holds = of_button(made), " ".join(drives_in(made))
    else:
        found, holds = of_check(made) if isinstance(made, Check) else of_drive(made), ""
    return Entry(
        **own,
        button=drive.button,
        date=made.created if isinstance(made, DigitalButton) else "",
        verdict="" if isinstance(made, Drive) else made.verdict,
        rig=drive.rig,
        simulated=_yes(made.simulated),
        patch=drive.patch,
        point=drive.point,
        made_from=packed(found),
        holds=holds,
    )


def _recording(recording: Recording) -> Entry:
    header = recording.header
    # Samples would be unpacked for nothing: their bytes have a checksum.
    verdicts, content = recording.outline()
    numbers = {press.number for press in verdicts if press.accepted}
    return Entry(
        file=str(recording.path),
        kind="recording",
        participant=recording.participant,
        button=recording.button,
        date=header.started,
        verdict="complete" if recording.complete else "incomplete",
        presses=f"{len(numbers)}/{header.presses}",
        rig=recording.rig,
        simulated=_yes(recording.simulated),
        study=header.study,
        content_hash=content,
        made_from=packed(of_recording(recording)),
    )


def _map(path: Path) -> Entry:
    from ...calibration.map import MapFolder  # noqa: PLC0415

    folder = path.parent
    plan = MapFolder.open(folder).plan
    patches, simulated = " ".join(plan.patches), _yes(plan.simulated)
    return Entry(
        str(folder), "map", rig=plan.rig, simulated=simulated, patch=patches, content_hash=plan.digest
    )


def _study(path: Path) -> Entry:
    from ...acquisition import load_study  # noqa: PLC0415

    return Entry(str(path), "study", study=load_study(path).file.name)


def _experiment(path: Path) -> Entry | None:
    from ...instruments import load_rig_file  # noqa: PLC0415
    from ..loading import FOLDERS  # noqa: PLC0415

    try:
        experiment = FOLDERS["experiment.toml"]()(path)
    except HaploopError:
        with suppress(HaploopError):
            load_rig_file(path)
            return None  # a rig's file may have any name
        raise
    made = packed(of_experiment(experiment))
    return Entry(str(path), "experiment", study=experiment.file.name, made_from=made)


def _yes(value: bool) -> str:
    return "yes" if value else "no"


# What a file states that it was made from: kinds, names and content hashes, as its own fields hold them.

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
    return (Source("drive", "", hdf5.digest_of(check.drive), of_drive(check.drive)),)


def of_button(button: DigitalButton) -> tuple[Source, ...]:
    """Its presses and calibrations, and what these were made from."""
    presses = [
        Source("representative", "", hdf5.digest_of(one), of_press(one))
        for one in (button.press, *button.others)
    ]
    fingers = [Source("calibration", "", one.calibration) for one in _pressed(button) if not one.patches[1:]]
    return (*presses, *map(_calibration, button.calibrations), *fingers)


def of_experiment(experiment: Any) -> tuple[Source, ...]:
    """The digital buttons that it plays, by their paths."""
    names = (*experiment.file.buttons.values(), *experiment.file.surface.releases.values())
    folder = experiment.path.parent.resolve()
    return tuple(Source("button", str(folder / name), "") for name in dict.fromkeys(names))


def drives_in(button: DigitalButton) -> tuple[str, ...]:
    """Content hashes of the drives that a button holds, by which a check names it."""
    return tuple(map(hdf5.digest_of, (button.drive, *_pressed(button))))


def _pressed(button: DigitalButton) -> tuple[Drive, ...]:
    return tuple(one.drive for one in button.pressed_checks)


def _calibration(calibration: Calibration) -> Source:
    response, content = calibration.response, calibration.digest
    place = f"patch {response.patch} at {response.point}"
    # What a map gives of a point is in no file of its own; any other calibration is, or is missing.
    sources = tuple(one for one in of_calibration(calibration, content) if one.kind == "map")
    return Source("calibration", place, content, sources)
