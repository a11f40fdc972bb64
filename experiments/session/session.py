"""A session that runs: what is due, and every event into its log. Without any user interface.

A page, a terminal or a simulated participant drives it: show `due`, call `presented` when the stimulus
begins, and `answer` with what the participant chose.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from typing import Any, Protocol

from ...base.clock import Clock
from ...base.errors import ConfigurationError, DataError
from ..protocol import Answer, Assignment, Course, Step, right_answer, session_levels, valid
from .store import Event, EventLog, Store


class Answerer(Protocol):
    """Who answers: a person at a terminal, or a simulated participant."""

    def answer(self, step: Step) -> Any:
        """Do a step, and return its answer."""
        ...

    def told(self, step: Step, right: bool) -> None:
        """Learn whether the answer was right."""
        ...


class Presents(Protocol):
    """What presents the stimuli: a rig, with the participant's finger on its surface."""

    def presents(self, step: Step) -> bool:
        """Whether it has a part in this step."""
        ...

    def present(self, session: Session, step: Step) -> None:
        """Present it, and log what happened."""
        ...


AGAIN = "again"
"""Answer of an `Answerer` who wants a stimulus once more."""


class Session:
    """A session in progress. See `open_session`."""

    def __init__(self, store: Store, assignment: Assignment, log: EventLog) -> None:
        self.assignment = assignment
        self._file = store.experiment.file
        self._log = log
        self._answers: list[tuple[Step, Answer]] = []
        self._presented = False
        self._course = Course(self._file, assignment)
        self.due: Step | None = self._course.due(())

    @property
    def events(self) -> Sequence[Event]:
        """All events so far, also of earlier runs."""
        return tuple(self._log.events)

    def presented(self, **details: Any) -> None:
        """Log that the stimulus of the step that is due begins; again when it is repeated."""
        step = self._step()
        self._log.add("presented", block=step.block, trial=step.number, **details)
        self._presented = True

    def event(self, kind: str, **details: Any) -> None:
        """Log anything else: an activation, a drive that was played, a remark."""
        if kind in ("start", "presented", "answer", "resumed", "complete"):
            raise ConfigurationError(
                f"An event cannot be called {kind!r}: the log has such events of its own."
            )
        self._log.add(kind, **details)

    def answer(self, answer: Any) -> bool | None:
        """Log an answer; then the next step is `due`. Returns whether it was right, if that is told.

        Raises DataError for an answer that the step does not allow; the step stays due.
        """
        step = self._step()
        if not self._presented:
            raise DataError(f"Step {step.number} of the block {step.block!r} was not presented yet.")
        value = valid(step, answer)
        right = right_answer(step)
        correct = None if right is None else value == right
        stored: Any = value
        if isinstance(value, Mapping):
            stored = {pair: asdict(one) for pair, one in value.items()}
        self._log.add("answer", block=step.block, trial=step.number, answer=stored, correct=correct)
        self._answers.append((step, value))
        self._presented = False
        self.due = self._course.due(self._answers)
        self._seal()
        return correct if step.feedback else None

    def _step(self) -> Step:
        if self.due is None:
            raise DataError("The session is complete: no step is due.")
        return self.due

    def _restore(self, answers: list[tuple[Step, Answer]], due: Step | None) -> None:
        self._answers, self.due = answers, due
        self._seal()  # killed after the last answer

    def _seal(self) -> None:
        if self.due is None:
            self._log.add("complete")


@contextmanager
def open_session(
    store: Store,
    participant: str,
    clock: Clock,
    session: int | None = None,
    *,
    simulated: bool = False,
    consent: Callable[[], bool] = lambda: True,
) -> Iterator[Session]:
    """Begin a session, or continue one that was interrupted, at the very step that was due.

    `session`: its number; by default the first that is not complete. `simulated`: True when no person
    answers; people and simulated participants are not mixed in one folder. `consent` is asked once, before a
    participant's first session.

    Raises ConfigurationError: no such session, all complete, an earlier one is not; DataError: no consent, a
    log that is damaged or of another version of the experiment; ConfigurationError: another program runs one.

    For example:

        >>> from haploop import experiments
        >>> store = experiments.Store(experiments.load_experiment("matching"), "matching/answers")
        >>> with experiments.open_session(store, "P09", haploop.RealClock(), simulated=True) as session:
        ...     session.due.number  # of the trial that comes next
        1
    """
    file = store.experiment.file
    with store.hold(f"The experiment {file.name!r} in {store.folder}"):
        due = store.next_session(participant)
        if due is None:
            raise ConfigurationError(f"{participant} has completed all {file.sessions} sessions.")
        if session not in (None, due):
            raise ConfigurationError(f"Session {session} of {participant} is not due, but session {due} is.")
        _refuse_mixture(store, simulated)
        stored = store.session(participant, due)
        assignment = stored.assignment if stored else store.assign(participant, due)
        if file.consent and due == 1 and stored is None and not consent():
            raise DataError(f"{participant} has not consented, so nothing was begun.")
        log = EventLog(store.path_of(participant, due), clock, durable=not simulated)
        try:
            running = Session(store, assignment, log)
            if stored:
                running._restore([one[:2] for one in stored.answers], stored.due)
            else:
                log.add(
                    "start",
                    participant=participant,
                    slot=assignment.slot,
                    group=assignment.group,
                    session=due,
                    levels=session_levels(file, assignment),
                    name=file.name,
                    experiment=store.experiment.content_hash,
                    seed=file.seed,
                    consent=file.consent,
                    simulated=simulated,
                )
            yield running
        finally:
            log.close()


def run_session(session: Session, who: Answerer, rig: Presents | None = None) -> None:
    """Do the steps that are due until the session is complete.

    `rig` presents the stimuli that it has a part in; without one, somebody else does. One who answers may
    answer `AGAIN` to such a stimulus.

    For example:

        >>> from haploop import experiments
        >>> store = experiments.Store(experiments.load_experiment("matching"), "matching/answers")
        >>> somebody = haploop.mocks.SimulatedParticipant(haploop.mocks.ParticipantModel(), "P01", 1)
        >>> with experiments.open_session(store, "P01", haploop.RealClock(), simulated=True) as session:
        ...     experiments.run_session(session, somebody)
        >>> experiments.export_answers(store, "matching.csv")  # how many answers
        30
    """
    while (step := session.due) is not None:
        session.presented()
        answer: Any = "done"
        if rig is None or not rig.presents(step):
            answer = who.answer(step)
        else:
            rig.present(session, step)
            while step.kind != "finger" and (answer := who.answer(step)) == AGAIN:
                session.presented()
                rig.present(session, step)
        told = session.answer(answer)
        if told is not None:
            who.told(step, told)


def _refuse_mixture(store: Store, simulated: bool) -> None:
    for head in store.heads().values():
        if head["simulated"] != simulated:
            kind = "simulated participants" if head["simulated"] else "people"
            raise ConfigurationError(
                f"{store.folder} holds answers of {kind}: use another folder (--data), so that they are "
                "not mixed."
            )
