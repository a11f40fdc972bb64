"""A study: many participants' presses of several buttons, recorded in as many sittings as it takes.

What has been recorded stands in the recordings and nowhere else: how far a study has come is read from
them (and from what is rejected of them) every time.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path

from acquisition.layout import Judged, file_name
from acquisition.recorder import Session, ignore, sit
from acquisition.recording import Recording
from acquisition.rejections import Rejection, add_rejections
from acquisition.scan import finish
from acquisition.study_file import StudyFile, load_study_file
from instruments import ConfigurationError, Consent, DataError, Ready, Rig
from instruments.lock import hold

__all__ = ["Standing", "Study", "load_study", "run_study"]

CONSENT = "consent"
"""Kind of the event that says, in every recording, that consent was confirmed."""


@dataclass(frozen=True, eq=False)
class Standing:
    """How far a participant has come with a button."""

    participant: str
    button: str
    of: int
    """How many presses are asked for."""
    recordings: tuple[Recording, ...]
    """One a sitting, in their order."""

    @cached_property
    def judged(self) -> tuple[Judged, ...]:
        """Every attempt at every press."""
        return tuple(press for recording in self.recordings for press in recording.judged)

    @cached_property
    def accepted(self) -> tuple[int, ...]:
        """Numbers of the presses that were accepted, in their order."""
        numbers = {press.number for press in self.judged if press.accepted and press.number <= self.of}
        return tuple(sorted(numbers))

    @property
    def missing(self) -> tuple[tuple[int, int], ...]:
        """Presses that are still to come: their numbers, and which attempt is next."""
        last = {
            number: max((press.attempt for press in self.judged if press.number == number), default=0)
            for number in range(1, self.of + 1)
            if number not in self.accepted
        }
        return tuple((number, attempt + 1) for number, attempt in last.items())

    @property
    def complete(self) -> bool:
        """Whether every press has been accepted."""
        return len(self.accepted) == self.of

    @property
    def bad(self) -> int:
        """How many attempts were judged bad when they were made."""
        return sum(not press.accepted and "rejected" not in press.flags for press in self.judged)

    @property
    def rejected(self) -> int:
        """How many presses the operator rejected."""
        return sum("rejected" in press.flags for press in self.judged)

    @property
    def interrupted(self) -> int:
        """How many sittings ended early."""
        return sum(not recording.complete for recording in self.recordings)

    @property
    def consented(self) -> bool:
        """Whether consent was confirmed at one of these sittings."""
        return any(event.kind == CONSENT for recording in self.recordings for event in recording.events)


class Study:
    """A study file, and the recordings beside it in the folder `recordings`."""

    def __init__(self, path: Path, file: StudyFile) -> None:
        self.path = path
        self.file = file

    @property
    def folder(self) -> Path:
        """Where its recordings are."""
        return self.path.parent / "recordings"

    def standing(self, participant: str, button: str) -> Standing:
        """How far a participant has come with a button. Raises ConfigurationError and DataError."""
        self._refuse(participant, button)
        recordings = []
        for path in self._parts(participant, button):
            recording = Recording.open(path)
            header = recording.header
            if (header.study, header.participant, header.button) != (self.file.name, participant, button):
                raise DataError(
                    f"{path} holds {header.button} by {header.participant} of the study {header.study!r}, "
                    f"and has no place in {self.file.name!r}: move it away."
                )
            recordings.append(recording)
        return Standing(participant, button, self.file.presses_of(button), tuple(recordings))

    def standings(self, participants: Collection[str] = ()) -> tuple[Standing, ...]:
        """All of them, or those of some participants: in the file's order, buttons as they come to them."""
        return tuple(
            self.standing(participant, button)
            for participant in self.file.participants
            if not participants or participant in participants
            for button in self.file.order_for(participant)
        )

    def recordings(self, button: str) -> tuple[Recording, ...]:
        """What there is of a button, of all participants, where any press was accepted.

        Raises ConfigurationError and DataError.
        """
        return tuple(
            recording
            for participant in self.file.participants
            for recording in self.standing(participant, button).recordings
            if recording.accepted
        )

    def reject(
        self, participant: str, button: str, numbers: Collection[int] = (), reason: str = ""
    ) -> tuple[Rejection, ...]:
        """Reject accepted presses, or all of a button, for a reason; the next run asks for them again.

        The recordings stay as they are. Raises ConfigurationError for a press that is not accepted, and
        DataError.
        """
        with self.hold():
            standing = self.standing(participant, button)
            wanted = tuple(dict.fromkeys(numbers)) or standing.accepted
            for number in wanted or (1,):
                if number not in standing.accepted:
                    raise ConfigurationError(
                        f"There is no accepted press {number} of {button} by {participant} to be rejected."
                    )
            now = datetime.now(UTC).isoformat(timespec="seconds")
            why = reason or "by the operator"
            new = tuple(
                Rejection(recording.path.name, recording.content_hash, press.number, press.attempt, why, now)
                for recording in standing.recordings
                for press in recording.accepted
                if press.number in wanted
            )
            add_rejections(self.folder, new)
            return new

    @contextmanager
    def hold(self) -> Iterator[None]:
        """Keep every other program that writes off this study, and finish what one left that was killed.

        Raises InstrumentError, which says who holds it, and DataError.
        """
        with hold({f"study {os.path.normcase(self.path.resolve())}"}, self.file.name):
            for participant in self.file.participants:
                for button in self.file.buttons:
                    for path in self._parts(participant, button):
                        if Recording.open(path).state == "recording":
                            finish(path, "interrupted")
            yield

    def next_file(self, participant: str, button: str) -> tuple[Path, int]:
        """Where the next sitting's recording goes, and which sitting it is."""
        parts = self._parts(participant, button)
        number = max((_sitting(path) for path in parts), default=0) + 1
        name = Path(file_name(participant, button))
        suffix = name.suffix if number == 1 else f".{number}{name.suffix}"
        return self.folder / name.with_suffix(suffix), number

    def _parts(self, participant: str, button: str) -> list[Path]:
        """The recordings of each sitting, in their order; what was recovered beside them is none."""
        stem = Path(file_name(participant, button)).stem
        found = [path for path in self.folder.glob(f"{stem}*.h5") if _PART.fullmatch(path.name[len(stem) :])]
        return sorted(found, key=_sitting)

    def _refuse(self, participant: str, button: str) -> None:
        for what, name, names in (
            ("participant", participant, self.file.participants),
            ("button", button, self.file.buttons),
        ):
            if name not in names:
                raise ConfigurationError(
                    f"The study {self.file.name!r} has no {what} {name!r}; it has {', '.join(names)}. "
                    f"Add the {what} in {self.path}."
                )


def load_study(path: str | Path) -> Study:
    """A study by its file, or by the folder that holds its `study.toml`. Raises ConfigurationError."""
    path = Path(path)
    if path.is_dir():
        path = path / "study.toml"
    return Study(path, load_study_file(path))


def run_study(
    rig: Rig,
    study: Study,
    participants: Collection[str] = (),
    buttons: Collection[str] = (),
    progress: Callable[[str, str, int, int], None] = ignore,
    judged: Callable[[str, str, Judged], None] = ignore,
    notes: str = "",
) -> bool:
    """Record what a study still wants: of everybody, or of some participants and some buttons.

    It goes on exactly where it stopped, whatever stopped it: what was accepted stays accepted, and a
    sitting that was interrupted keeps its file. The operator confirms each participant's consent once,
    and says when a participant is ready for a button; False as an answer ends the run, which then
    returns False. `progress(participant, button, done, of)` and `judged(participant, button, press)`
    are called as in `record`. `notes` go into every recording that is made.

    Raises ConfigurationError for a name that the study does not have, DataError when a participant has
    not consented, and whatever `record` raises.
    """
    for participant in participants or study.file.participants:
        for button in buttons or study.file.buttons:
            study.standing(participant, button)
    _refuse_another_rig(rig, study)
    with study.hold():
        for participant in participants or study.file.participants:
            standings = study.standings([participant])
            consented = any(standing.consented for standing in standings)
            for standing in standings:
                button = standing.button
                if standing.complete or (buttons and button not in buttons):
                    continue
                if study.file.consent and not consented:
                    _ask_consent(rig, study.file, participant)
                    consented = True
                presses = len(standing.missing)
                words = study.file.prompts.ready.format(
                    participant=participant, button=button, presses=presses
                )
                if not rig.operator.confirm(Ready(participant, button, presses, words)):
                    return False
                session = _session(study, standing, consented, notes)
                tell = _telling(participant, button)
                sit(rig, session, study.file.protocol_for(button), tell(progress), tell(judged))
    return True


def _refuse_another_rig(rig: Rig, study: Study) -> None:
    """One study, one rig: above all, no simulated presses among real ones."""
    for standing in study.standings():
        for recording in standing.recordings:
            if (recording.rig, recording.simulated) != (rig.name, rig.simulated):
                raise ConfigurationError(
                    f"{recording.path} was recorded on {_called(recording.rig, recording.simulated)}, and "
                    f"this is {_called(rig.name, rig.simulated)}: a study stays on one rig."
                )


def _called(rig: str, simulated: bool) -> str:
    return f"the rig {rig!r}, {'simulated' if simulated else 'not simulated'}"


def _telling(participant: str, button: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Whoever is told of a press is told of whom and of what it is."""
    return lambda told: lambda *what: told(participant, button, *what)


def _ask_consent(rig: Rig, file: StudyFile, participant: str) -> None:
    words = file.prompts.consent.format(participant=participant)
    if not rig.operator.confirm(Consent(participant, words)):
        raise DataError(
            f"{participant} has not consented, so nothing of {participant} is recorded: go on with another "
            "participant."
        )


def _session(study: Study, standing: Standing, consented: bool, notes: str) -> Session:
    participant, button = standing.participant, standing.button
    path, number = study.next_file(participant, button)
    return Session(
        path=path,
        button=button,
        participant=participant,
        wanted=standing.missing,
        of=standing.of,
        study=study.file.name,
        number=str(number),
        consent=f"The operator confirmed that {participant} consented." if consented else "",
        notes=notes,
        words=study.file.words_for(button),
    )


_PART = re.compile(r"(\.[0-9]+)?\.h5")


def _sitting(path: Path) -> int:
    """Which sitting a recording's file name says: P01-latch.h5 is the first, P01-latch.2.h5 the second."""
    number = Path(path.stem).suffix
    return int(number[1:]) if number else 1
