"""What a report says of each file or folder: its facts, its verdicts, and what it was read from."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import mean, stdev
from typing import Any

from ...acquisition import Recording, Representative, Study, content_hash, load_study
from ...calibration import Calibration, Check, DigitalButton, Drive
from ...calibration.map import VibrationMap
from ...experiments import Identification, Ratings
from ...instruments import DataError
from ...terminal.progress import rows_of
from ..show import file_contents

__all__ = ["Section", "Verdict", "section"]

Loaded = (
    Recording
    | Representative
    | Calibration
    | Drive
    | Check
    | DigitalButton
    | VibrationMap
    | Study
    | Identification
    | Ratings
)


@dataclass(frozen=True)
class Verdict:
    """One row of the table of verdicts."""

    subject: str
    said: str
    """For example "pass", "fail", "not shown", "accepted"."""
    good: bool
    measured: str
    why: str = ""


@dataclass(frozen=True, eq=False)
class Section:
    """One file or folder, as a report shows it."""

    name: str
    """Name of the file or folder, without the path, so that a report is the same wherever it is made."""
    title: str
    simulated: bool
    rig: str
    facts: Sequence[tuple[str, str]]
    verdicts: Sequence[Verdict]
    sources: Sequence[tuple[str, str]]
    """Name and SHA-256 of the content of each file that was read."""
    loaded: Loaded

    @property
    def short_hash(self) -> str:
        """The first source with the beginning of its hash, as it stands in a caption."""
        name, digest = self.sources[0]
        more = f" and {len(self.sources) - 1} more files" if len(self.sources) > 1 else ""
        return f"{name} (SHA-256 {digest[:12]}…){more}"


def section(path: Path) -> Section:
    """Read a recording, study, calibration, map, digital button, or what a check writes. Raises DataError."""
    if path.suffix == ".toml" or (path.is_dir() and (path / "study.toml").is_file()):
        return _study(load_study(path))
    contents = file_contents(path)
    loaded, values = contents.loaded, contents.values
    sources = _files_of_map(path) if path.is_dir() else [(path.name, content_hash(path))]
    return Section(
        name=path.resolve().name,
        title=str(contents.table.title),
        simulated=bool(values["simulated"]),
        rig=_rig(loaded),
        facts=[(str(name), str(text)) for name, text in rows_of(contents.table)],
        verdicts=_verdicts(loaded, values),
        sources=sources,
        loaded=loaded,
    )


def _files_of_map(folder: Path) -> list[tuple[str, str]]:
    """One hash over the content of all measurements, whose number says nothing to a reader."""
    files = sorted(path for path in folder.glob("*.h5") if not path.name.startswith("modes-"))
    digests = "".join(content_hash(path) for path in files)
    return [(f"{folder.resolve().name}, {len(files)} files", hashlib.sha256(digests.encode()).hexdigest())]


def _rig(loaded: Loaded) -> str:
    match loaded:
        case Recording():
            return loaded.rig
        case Calibration():
            return loaded.response.rig
        case Drive():
            return loaded.rig
        case Check() | DigitalButton():
            return loaded.drive.rig
        case VibrationMap():
            return loaded.plan.rig
        case _:
            return ""


def _verdicts(loaded: Loaded, values: dict[str, Any]) -> list[Verdict]:
    match loaded:
        case Recording():
            return _of_recording(loaded)
        case Check():
            return [_of_check(f"Check of the {loaded.drive.button} button", loaded)]
        case DigitalButton():
            return [_of_check(f"Digital {loaded.press.button} button", loaded.check)]
        case Calibration():
            model, response = loaded.model, loaded.response
            lowest = values["coherence_min"]
            coherence = "not measured" if lowest is None else f"at least {lowest:.3f}"
            return [
                Verdict(
                    f"Calibration, patch {response.patch} at {response.point}",
                    "stable" if model.stable else "unstable",
                    bool(model.stable),
                    f"model {100 * model.error:.1f} % from the response; coherence {coherence}",
                )
            ]
        case VibrationMap():
            done, planned = values["points_measured"], values["points_planned"]
            return [
                Verdict(
                    "Vibration map",
                    "complete" if done == planned else "incomplete",
                    done == planned,
                    f"{done} of {planned} points; residual {100 * values['residual']:.1f} %",
                    " ".join(f"Point {point}: {reason}" for point, reason in loaded.skipped),
                )
            ]
        case _:
            return []


def _of_recording(recording: Recording) -> list[Verdict]:
    subject = f"{recording.participant}, {recording.button}"
    good = len(recording.accepted)
    bad = [press for press in recording.verdicts if not press.accepted]
    whole = Verdict(
        subject,
        "complete" if recording.complete else "incomplete",
        bool(recording.complete),
        f"{good} presses accepted, {len(bad)} not",
    )
    return [
        whole,
        *(
            Verdict(subject, "not accepted", False, f"press {p.number}, attempt {p.attempt}", p.reason)
            for p in bad
        ),
    ]


def _of_check(subject: str, check: Check) -> Verdict:
    low, high = check.wideband_interval
    return Verdict(
        subject,
        check.verdict,
        check.passed,
        f"error {100 * check.wideband_nrmse:.1f} % ({100 * low:.1f} to {100 * high:.1f} %) of at most "
        f"{100 * check.tolerance:.0f} %, n = {check.plays} plays",
        " ".join((*check.reasons, *check.notes)),
    )


def _study(study: Study) -> Section:
    progress = study.progress()
    recordings = [recording for one in progress for recording in one.recordings]
    if not recordings:
        raise DataError(
            f"The study {study.file.name!r} has no recording yet: `haploop study run` makes them."
        )
    verdicts = [
        Verdict(
            f"{one.participant}, {one.button}",
            "complete" if one.complete else "incomplete",
            one.complete,
            f"{len(one.accepted)} of {one.of} presses accepted",
            _asides(one.bad, one.rejected, one.interrupted),
        )
        for one in progress
    ]
    done, of = sum(len(one.accepted) for one in progress), sum(one.of for one in progress)
    facts = [
        ("Participants", f"{len(study.file.participants)}: {', '.join(study.file.participants)}"),
        ("Buttons", f"{', '.join(study.file.buttons)}, in {study.file.order} order"),
        ("Presses", f"{done} of {of} accepted, in {len(recordings)} recordings"),
        *_columns(recordings),
    ]
    return Section(
        name=study.file.name,
        title=f"Study {study.file.name}",
        simulated=any(recording.simulated for recording in recordings),
        rig=recordings[0].rig,
        facts=facts,
        verdicts=verdicts,
        sources=[(recording.path.name, recording.content_hash) for recording in recordings],
        loaded=study,
    )


def _columns(recordings: Sequence[Recording]) -> list[tuple[str, str]]:
    """Summarise what the recordings say of their participants; the latest of each participant counts."""
    about = {recording.participant: recording.about for recording in recordings}
    columns = dict.fromkeys(column for mine in about.values() for column in mine)
    facts = []
    for column in columns:
        values = [mine[column] for mine in about.values() if column in mine]
        numbers = [v for v in values if isinstance(v, int | float) and not isinstance(v, bool)]
        if len(numbers) == len(values):
            spread = f", standard deviation {stdev(numbers):.1f}" if len(numbers) > 1 else ""
            told = (
                f"{min(numbers):g} to {max(numbers):g}, mean {mean(numbers):.1f}{spread} (n = {len(values)})"
            )
        else:
            counts = Counter("yes" if v is True else "no" if v is False else str(v) for v in values)
            told = ", ".join(f"{value}: {count}" for value, count in sorted(counts.items()))
        facts.append((column.capitalize(), told))
    return facts


def _asides(bad: int, rejected: int, interrupted: int) -> str:
    counts = ((bad, "bad"), (rejected, "rejected"), (interrupted, "interrupted"))
    return ", ".join(f"{count} {word}" for count, word in counts if count)
