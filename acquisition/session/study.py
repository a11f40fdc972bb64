"""A study: presses of several buttons by many participants, recorded in any number of sessions.

The progress of a study is stored nowhere else: it is read from the recordings (and their rejections)
every time.
"""

from __future__ import annotations

import os
import re
from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property, partial
from itertools import chain
from pathlib import Path

from ...base.errors import ConfigurationError, DataError, InstrumentError
from ...base.progress import Progress, silent
from ...instruments import Consent, Ready, Request, Rig
from ...instruments.safety import hold
from ..presses import AverageMethod, Protocol, Representative, representative
from ..recording import PressVerdict, Recording, Rejection, add_rejections, file_name, finish
from .recorder import run_session
from .session_run import Listeners, Session, ignore
from .study_file import StudyFile, load_study_file

CONSENT = "consent"
"""Kind of the event that states in each recording that consent was confirmed."""


@dataclass(frozen=True, eq=False)
class StudyProgress:
    """Progress of one participant with one button."""

    participant: str
    button: str
    of: int
    """Number of presses requested."""
    recordings: tuple[Recording, ...]
    """One recording for each session, in order."""

    @property
    def verdicts(self) -> tuple[PressVerdict, ...]:
        """Verdict on every attempt at every press."""
        return self._said[0]

    @cached_property
    def _said(self) -> tuple[tuple[PressVerdict, ...], bool]:
        """Verdicts, and whether consent was confirmed. No recording keeps its samples in memory for them."""
        verdicts: list[PressVerdict] = []
        consented = False
        for recording in self.recordings:
            verdicts += recording.verdicts
            consented |= any(event.kind == CONSENT for event in recording.events)
            recording.forget()
        return tuple(verdicts), consented

    @cached_property
    def accepted(self) -> tuple[int, ...]:
        """Numbers of the accepted presses, sorted."""
        numbers = {press.number for press in self.verdicts if press.accepted and press.number <= self.of}
        return tuple(sorted(numbers))

    @property
    def missing(self) -> tuple[tuple[int, int], ...]:
        """Presses still due: (number, next attempt) of each."""
        last = {
            number: max((press.attempt for press in self.verdicts if press.number == number), default=0)
            for number in range(1, self.of + 1)
            if number not in self.accepted
        }
        return tuple((number, attempt + 1) for number, attempt in last.items())

    @property
    def complete(self) -> bool:
        """True when every press has been accepted."""
        return len(self.accepted) == self.of

    @property
    def bad(self) -> int:
        """Number of attempts that failed the quality check."""
        return sum(not press.accepted and "rejected" not in press.flags for press in self.verdicts)

    @property
    def rejected(self) -> int:
        """Number of presses rejected by the operator."""
        return sum("rejected" in press.flags for press in self.verdicts)

    @property
    def interrupted(self) -> int:
        """Number of sessions that ended early."""
        return sum(not recording.complete for recording in self.recordings) - self.in_progress

    @property
    def in_progress(self) -> int:
        """Number of sessions being recorded by a running program (0 or 1)."""
        return sum(recording.in_progress for recording in self.recordings)

    @property
    def consented(self) -> bool:
        """True when consent was confirmed in one of these sessions."""
        return self._said[1]


class Study:
    """A study file, and the recordings beside it in the folder `recordings`."""

    def __init__(self, path: Path, file: StudyFile) -> None:
        self.path = path
        self.file = file

    @property
    def folder(self) -> Path:
        """Folder of its recordings."""
        return self.path.parent / "recordings"

    def progress_of(self, participant: str, button: str) -> StudyProgress:
        """Progress of one participant with one button. Raises ConfigurationError and DataError."""
        self._refuse(participant, button)
        recordings = tuple(open_part(path, self.file.name) for path in self._parts(participant, button))
        return StudyProgress(participant, button, self.file.presses_of(button), recordings)

    def progress(self, participants: Collection[str] = ()) -> tuple[StudyProgress, ...]:
        """Progress of all or some participants with each button, in the order in which they are recorded."""
        return tuple(
            self.progress_of(participant, button)
            for participant in self.file.participants
            if not participants or participant in participants
            for button in self.file.order_for(participant)
        )

    def recordings(self, button: str) -> tuple[Recording, ...]:
        """Recordings of a button by all participants that hold an accepted press.

        Raises ConfigurationError and DataError.
        """
        return tuple(
            recording
            for participant in self.file.participants
            for recording in with_presses(self.progress_of(participant, button).recordings)
        )

    def representative(
        self, button: str, method: AverageMethod | None = None, progress: Progress = silent
    ) -> Representative:
        """Representative press of a button, by the study file's method or by `method`.

        Raises the errors of `recordings` and of `haploop.representative`.
        """
        recordings = self.recordings(button)
        if not recordings:
            raise DataError(
                f"The study {self.file.name!r} has no accepted press of {button} yet: record some with "
                "`haploop study run`."
            )
        return representative(recordings, method=method or self.file.method, progress=progress)

    def reject(
        self, participant: str, button: str, numbers: Collection[int] = (), reason: str = ""
    ) -> tuple[Rejection, ...]:
        """Reject accepted presses of a button, by number or all; the next run asks for them again.

        The recordings stay as they are. Raises ConfigurationError for a press that is not accepted, and
        DataError.
        """
        with self.hold():
            entry = self.progress_of(participant, button)
            numbers = tuple(dict.fromkeys(numbers)) or entry.accepted
            for number in numbers or (1,):
                if number not in entry.accepted:
                    raise ConfigurationError(
                        f"{participant} has no accepted press {number} of {button}: "
                        "`haploop study status` shows which presses there are."
                    )
            now = datetime.now(UTC).isoformat(timespec="seconds")
            why = reason or "by the operator"
            new = tuple(
                Rejection(recording.path.name, recording.content_hash, press.number, press.attempt, why, now)
                for recording in entry.recordings
                for press in recording.accepted
                if press.number in numbers
            )
            add_rejections(self.folder, new)
            return new

    @contextmanager
    def hold(self) -> Iterator[None]:
        """Lock the study against other programs, and finish the recordings of a killed program.

        Raises InstrumentError, which names the process with the lock, and DataError.
        """
        with hold({f"study {os.path.normcase(self.path.resolve())}"}, self.file.name):
            for path in chain.from_iterable(self.parts().values()):
                recording = Recording.open(path)
                if recording.in_progress:
                    raise InstrumentError(
                        f"{path} is being recorded by another program: wait until it has ended."
                    )
                if recording.state == "recording":
                    finish(path, "interrupted")
            yield

    def next_file(self, participant: str, button: str) -> tuple[Path, int]:
        """Path of the next session's recording, and the session's number."""
        parts = self._parts(participant, button)
        number = max((_session_number(path) for path in parts), default=0) + 1
        name = Path(file_name(participant, button))
        suffix = name.suffix if number == 1 else f".{number}{name.suffix}"
        return self.folder / name.with_suffix(suffix), number

    def parts(self) -> dict[tuple[str, str], list[Path]]:
        """Paths of the recordings of each (participant, button), in the order in which they are recorded.

        The folder is read once, for studies with thousands of files. Nothing is opened.
        """
        names: dict[str, list[Path]] = defaultdict(list)
        for path in self.folder.glob("*.h5"):
            stem = path.name.partition(".")[0]
            if _PART.fullmatch(path.name[len(stem) :]):
                names[stem].append(path)
        return {
            (participant, button): sorted(names[f"{participant}-{button}"], key=_session_number)
            for participant in self.file.participants
            for button in self.file.order_for(participant)
        }

    def _parts(self, participant: str, button: str) -> list[Path]:
        """Paths of the recordings of all sessions, in order, without recovered files."""
        stem = Path(file_name(participant, button)).stem
        found = [path for path in self.folder.glob(f"{stem}*.h5") if _PART.fullmatch(path.name[len(stem) :])]
        return sorted(found, key=_session_number)

    def _refuse(self, participant: str, button: str) -> None:
        for what, name, names in (
            ("participant", participant, self.file.participants),
            ("button", button, self.file.buttons),
        ):
            if name not in names:
                raise ConfigurationError(
                    f"The study {self.file.name!r} has no {what} {name!r}, only {', '.join(names)}: "
                    f"add the {what} in {self.path}."
                )


def open_part(path: Path, study: str) -> Recording:
    """Open a recording of the study of this name. Raises DataError for another's, or under a false name."""
    recording = Recording.open(path)
    header = recording.header
    if header.study != study or path.name.partition(".")[0] != f"{header.participant}-{header.button}":
        raise DataError(
            f"{path} belongs to the study {header.study!r} (button {header.button}, participant "
            f"{header.participant}), not to {study!r}: move it away."
        )
    return recording


def with_presses(recordings: Iterable[Recording]) -> Iterator[Recording]:
    """Those that hold an accepted press; none keeps the samples in memory that were read to see that.

    A study's hundred recordings would take gigabytes.
    """
    for recording in recordings:
        accepted = recording.accepted
        recording.forget()
        if accepted:
            yield recording


def load_study(path: str | Path) -> Study:
    """Load a study from its file, or from the folder of its `study.toml`. Raises ConfigurationError.

    For example:

        >>> lines = ['name = "small"', 'buttons = ["push"]', 'participants = ["P01"]', "presses = 2"]
        >>> with open("study.toml", "w") as file:
        ...     print(*lines, sep=chr(10), file=file)
        >>> study = haploop.load_study("study.toml")
        >>> [(one.participant, one.button, len(one.missing)) for one in study.progress()]
        [('P01', 'push', 2)]
    """
    path = Path(path)
    if path.is_dir():
        path = path / "study.toml"
    return Study(path, load_study_file(path))


def run_study(
    rig: Rig,
    study: Study,
    participants: Collection[str] = (),
    buttons: Collection[str] = (),
    *,
    progress: Progress = silent,
    on_verdict: Callable[[str, str, PressVerdict], None] = ignore,
    on_request: Callable[[Request], None] = ignore,
    notes: str = "",
    adapt: Callable[[Protocol], Protocol] = lambda protocol: protocol,
) -> bool:
    """Record the presses still due in a study, of all or of some participants and buttons.

    A run continues where the last one stopped: accepted presses stay accepted, and an interrupted session
    keeps its file. The operator confirms each participant's consent once, and before each button that the
    participant is ready; the answer False ends the run, which then returns False. `progress` is called for
    each session ("P01, latch"), `on_verdict(participant, button, press)` for each press and `on_request` for
    each request of a session, as in `record`. `notes` are stored in every recording of this run. `adapt` may
    change the study file's protocol for a button: `lambda protocol: replace(protocol, patience=30)`.

    Raises ConfigurationError for a name that the study does not have, DataError when a participant has
    not consented, and the errors of `record`.

    For example:

        >>> haploop.run_study(rig, haploop.load_study("study.toml"))
        True
        >>> [one.complete for one in haploop.load_study("study.toml").progress()]
        [True]
    """
    for participant in participants or study.file.participants:
        for button in buttons or study.file.buttons:
            study.progress_of(participant, button)
    _refuse_another_rig(rig, study)
    with study.hold():
        for participant in participants or study.file.participants:
            entries = study.progress([participant])
            consented = any(entry.consented for entry in entries)
            for entry in entries:
                button = entry.button
                if entry.complete or (buttons and button not in buttons):
                    continue
                if study.file.consent and not consented:
                    _ask_consent(rig, study.file, participant)
                    consented = True
                presses = len(entry.missing)
                words = study.file.prompts.ready.format(
                    participant=participant, button=button, presses=presses
                )
                if not rig.operator.confirm(Ready(participant, button, presses, words)):
                    return False
                session = _session(study, entry, consented, notes)
                told = Listeners(progress, partial(on_verdict, participant, button), on_request)
                run_session(rig, session, adapt(study.file.protocol_for(button)), told)
    return True


def _refuse_another_rig(rig: Rig, study: Study) -> None:
    """Refuse a second rig, so that simulated and real presses are never mixed."""
    for entry in study.progress():
        for recording in entry.recordings:
            if (recording.rig, recording.simulated) != (rig.name, rig.simulated):
                raise ConfigurationError(
                    f"{recording.path} was recorded on {_called(recording.rig, recording.simulated)}, but "
                    f"this is {_called(rig.name, rig.simulated)}: record a study on one rig only."
                )


def _called(rig: str, simulated: bool) -> str:
    return f"the rig {rig!r}, {'simulated' if simulated else 'not simulated'}"


def _ask_consent(rig: Rig, file: StudyFile, participant: str) -> None:
    words = file.prompts.consent.format(participant=participant)
    if not rig.operator.confirm(Consent(participant, words)):
        raise DataError(
            f"{participant} has not consented, so nothing was recorded: continue with another participant "
            "(--participant)."
        )


def _session(study: Study, entry: StudyProgress, consented: bool, notes: str) -> Session:
    participant, button = entry.participant, entry.button
    path, number = study.next_file(participant, button)
    return Session(
        path=path,
        button=button,
        participant=participant,
        pending=entry.missing,
        of=entry.of,
        study=study.file.name,
        number=str(number),
        consent=f"The operator confirmed that {participant} consented." if consented else "",
        notes=notes,
        words=study.file.prompt_for(button),
        about=study.file.participant.get(participant, {}),
    )


_PART = re.compile(r"(\.[0-9]+)?\.h5")


def _session_number(path: Path) -> int:
    """Session number in a recording's file name: 1 for P01-latch.h5, 2 for P01-latch.2.h5."""
    number = Path(path.stem).suffix
    return int(number[1:]) if number else 1
