"""`haploop` alone: what is in this folder, and what to do next."""

from __future__ import annotations

import re
import shlex
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..reports import contents, satellites
from ..terminal.progress import Steps, print_line
from . import public as haploop

if TYPE_CHECKING:
    from ..reports.catalogue import Entry

_LOOKED_FOR = ("*.h5", "*/*.h5", "*.toml", "*/experiment.toml")
_NAMED = (
    *("study", "experiment", "recording", "representative", "curve", "calibration", "map"),
    *("plan", "drive", "button", "check"),
)
"""Kinds of files that are counted, in this order."""
_GENERATION = re.compile(r"\d{4,}-\d{8}T\d{6}Z")
"""A folder in a history of calibrations: its files are copies."""
_MOST = 4
"""Files that a suggested command names; of more it names their folder."""

_NOTHING_DUE = ("Nothing is due. All of it, to look at in a browser", "haploop serve")


@dataclass(frozen=True)
class Found:
    """What lies in a folder, with names relative to it."""

    entries: Sequence[Entry] = ()
    rig: str = ""
    """The first rig file; "" where there is none."""
    due: Sequence[str] = ()
    """Participant and button of each session that the study in this folder still needs."""
    study: frozenset[str] = field(default_factory=frozenset)
    """Buttons of the study in this folder."""
    problem: str = ""
    """Why that study cannot be read."""
    sessions: Sequence[tuple[str, str]] = ()
    """Folder of an experiment, and the participant whose session was begun; "" where nobody has answered."""
    active: frozenset[str] = field(default_factory=frozenset)
    """Names of the buttons of the active calibration."""
    history: str = ""
    """Folder of the rig's history that holds an active calibration."""

    def of(self, kind: str, button: str = "") -> list[Entry]:
        """The entries of a kind, of one button if it is named."""
        return [one for one in self.entries if one.kind == kind and button in ("", one.button)]


def status() -> bool:
    """Print what is in this folder and what to do next; False where nothing of haploop is in it."""
    here = Path.cwd()
    some = any(path for pattern in _LOOKED_FOR for path in here.glob(pattern))
    if not some or here in (Path.home(), Path(here.anchor)):
        return False
    found = look(here)
    counts = Counter(entry.kind for entry in found.entries)
    if not counts and not found.rig:
        return False
    said = [f"rig file {found.rig}"] if found.rig else []
    said += [contents.counted(counts[kind], kind) for kind in _NAMED if counts[kind]]
    print_line(f"In this folder: {', '.join(said) or 'files of haploop'}.")
    for sentence, command in next_steps(found) or [_NOTHING_DUE]:
        print_line(f"\n{sentence}:\n    {command}")
    print_line("\nAll commands: haploop --help. What else is here: haploop list")
    return True


def look(here: Path) -> Found:
    """Read what is in a folder; files that cannot be read are entries of the kind "damaged"."""
    from ..calibration import History  # noqa: PLC0415

    with Steps() as steps:
        entries = [
            one
            for one in haploop.list_files([here], progress=steps)
            if not any(map(_GENERATION.fullmatch, Path(one.file).parts))
        ]
    rig = next(_rigs(here), "")
    due, study, problem = list[str](), frozenset[str](), ""
    if (here / "study.toml").is_file():
        try:
            opened = haploop.load_study(here)
            study = frozenset(opened.file.buttons)
            due = [f"{p.participant} {p.button}" for p in opened.progress() if len(p.accepted) < p.of]
        except haploop.HaploopError as error:
            problem = str(error)
    history, active = History.of_rig(here / rig if rig else "simulated", here), frozenset[str]()
    try:
        generation = history.active()
        active = frozenset(path.stem.partition("-")[0] for path in generation.paths("buttons"))
    except haploop.HaploopError:
        pass  # none yet
    return Found(
        entries=[replace(one, file=Path(one.file).relative_to(here).as_posix()) for one in entries],
        rig=rig,
        due=due,
        study=study,
        problem=problem,
        sessions=[*_sessions(entries, here)],
        active=active,
        history=history.folder.name if active else "",
    )


def _sessions(entries: Sequence[Entry], here: Path) -> Iterator[tuple[str, str]]:
    """See `Found.sessions`; an experiment that cannot be read is left to `haploop experiment status`."""
    for folder in (Path(entry.file).parent for entry in entries if entry.kind == "experiment"):
        name = folder.relative_to(here).as_posix()
        try:
            yield from ((name, participant) for participant in satellites.owned("due experiment")(folder))
        except haploop.HaploopError:
            continue


def _rigs(here: Path) -> Iterator[str]:
    for path in sorted(here.glob("*.toml")):
        try:
            haploop.load_rig_file(path)
        except haploop.HaploopError:
            continue
        yield path.name


def next_steps(found: Found) -> list[tuple[str, str]]:
    """Each thing that is not finished as a sentence, and the command that goes on with it, in their order."""
    rig = f" --rig {shlex.quote(found.rig)}" if found.rig else ""
    steps = [
        (f"{one.file} is damaged", f"haploop verify {shlex.quote(one.file)}") for one in found.of("damaged")
    ]
    if found.problem:
        steps.append((found.problem.removesuffix("."), "haploop study status"))
    if found.due:
        named = ", ".join(found.due[:3]) + (f" and {len(found.due) - 3} more" if len(found.due) > 3 else "")
        steps.append((f"The study is not complete: {named} due", "haploop study run"))
    recorded = [one for one in found.of("recording") if one.verdict == "complete"]
    known = dict.fromkeys(e.button for k in ("recording", "representative", "button") for e in found.of(k))
    asked = [*found.due, *found.of("experiment")]
    if not known and not asked:
        steps.append(("No button is recorded", f"haploop record latch -p P01{rig}"))
    calibrations = found.of("calibration")
    for name in known:
        steps += _of_button(found, name, [one for one in recorded if one.button == name], rig)
    if known and not calibrations:
        steps.append(("The table is not calibrated", f"haploop calibrate{rig}"))
    for folder, who in found.sessions:
        said = f"{who}'s session of {folder} is not complete" if who else f"Nobody has answered {folder}"
        steps.append((said, f"haploop experiment run {shlex.quote(folder)} --participant {who or 'P01'}"))
    if found.history:
        steps.append(
            (f"The table's calibration is in {found.history}; each night", f"haploop recalibrate{rig}")
        )
    return steps


def _of_button(found: Found, name: str, recorded: Sequence[Entry], rig: str) -> Iterator[tuple[str, str]]:
    presses, made, checked = (
        found.of("representative", name),
        found.of("button", name),
        found.of("check", name),
    )
    quoted = shlex.quote(name)
    if not presses and not made and not checked and recorded:
        files = [shlex.quote(one.file) for one in recorded]
        how = f"haploop represent {' '.join(files)} -o {quoted}-press.h5"
        if name in found.study or len(files) > _MOST:
            how = f"haploop study represent {quoted} --out {quoted}-press.h5"
        yield f"{contents.counted(recorded, 'recording')} of {name}, none averaged", how
    elif presses and not made and not checked and found.of("calibration"):
        press, calibration = (shlex.quote(one[0].file) for one in (presses, found.of("calibration")))
        how = f"haploop button make {press} -c {calibration} -o {quoted}.h5{rig}"
        yield f"The press of {name} is not made digital yet", how
    for one in made[:1]:
        if one.verdict != "pass":
            how = f"haploop report {shlex.quote(one.file)}"
            yield f"The digital {name} did not pass ({one.verdict}): look at why", how
        elif name not in found.active:
            how = f'haploop calibrations adopt {shlex.quote(one.file)} --reason "first"{rig}'
            yield f"The digital {name} passes, and is not the active one", how
