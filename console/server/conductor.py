"""A session of an experiment on the console's pages: the operator conducts it, the participant answers.

The session is the engine's (`haploop.experiments.Session`): each event is on the disk before a page shows
what comes next. So a page that is reloaded shows the same step, and after a server that was killed the
operator begins the same participant again, at the very step that was due.
"""

from __future__ import annotations

import secrets
import threading
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from typing import Any

from ...acquisition import file_name
from ...base.clock import RealClock
from ...base.errors import ConfigurationError, DataError, HaploopError, InstrumentError
from ...base.marks import marked
from ...experiments import ExperimentFile, Session, Step, Store, open_session, played_by_rig, session_levels
from ..data_folder import DataFolder, store_of

Worker = Callable[[str, Mapping[str, Any]], tuple[int, dict[str, Any]]]
"""Sends the worker a command; returns status and answer. Raises InstrumentError."""


@dataclass
class _Sitting:
    """The session that runs, and what the pages know of it."""

    name: str
    store: Store
    session: Session
    open: ExitStack
    turn: str = ""
    """Word of the step that waits for an answer: an answer to another one is refused. "" while none does."""
    playing: bool = False
    """Whether the rig presents the stimulus now: it waits for the finger, or plays."""
    noted: int = 0
    """Events of this presentation that are in the log."""
    problem: str = ""
    """Why the rig could not present it, as a sentence."""
    paused: bool = False
    last: dict[str, Any] | None = None
    """The last answer, for the operator."""
    told: dict[str, Any] | None = None
    """What the participant is told of it; None where the experiment gives no confirmation."""

    def failed(self, sentence: str) -> None:
        """Note that the stimulus was not presented: nobody can answer it, and it is to be presented again."""
        self.playing, self.turn, self.problem = False, "", sentence


class Conductor:
    """At most one session at a time. For any thread; `operator` and `participant` are what pages show."""

    def __init__(self, data: DataFolder, worker: Worker) -> None:
        self._data, self._worker = data, worker
        self._surface: Mapping[str, Any] | None = None
        """What the worker's board says of a rig that plays digital buttons."""
        self._changing = threading.Lock()
        self._sitting: _Sitting | None = None
        self.operator: dict[str, Any] | None = None
        self.participant: dict[str, Any] | None = None
        self.completed: Callable[[str, str], None] = lambda _experiment, _participant: None
        """Called with the experiment and the participant of a session that is complete."""

    # Commands of the operator's page; each raises a HaploopError when it cannot be done

    def begin(self, values: Mapping[str, Any], rig: Mapping[str, Any]) -> None:
        """Begin the session that is due, or continue it. `rig` is noted in the session's log.

        A day that begins within 12 hours of the one before must be named. Raises what `open_session` raises,
        and ConfigurationError while another session runs.
        """
        participant, number = str(values.get("participant", "")), values.get("session") or None
        file_name(participant, "x")  # refuses what is no pseudonym
        if number is not None and not isinstance(number, int):
            raise ConfigurationError(f"The day is a whole number, not {str(number)[:20]!r}.")
        with self._changing:
            if self._sitting is not None:
                raise ConfigurationError("A session runs already: end it first.")
            store, consent = store_of(self._data, values.get("experiment")), values.get("consent") is True
            with ExitStack() as stack:
                self._hold(stack, str(values.get("experiment")), participant)
                if number is None:
                    _refuse_too_soon(store, participant)
                session = stack.enter_context(
                    open_session(store, participant, RealClock(), number, consent=lambda: consent)
                )
                session.event("page", **rig)
                self._sitting = _Sitting(str(values.get("experiment")), store, session, stack.pop_all())
            self._show()

    def _hold(self, stack: ExitStack, experiment: str, participant: str) -> None:
        """Keep the rig and the participant's page for this session. Raises HaploopError when taken."""
        try:
            stack.enter_context(marked(self._data.sitting))
        except InstrumentError:
            raise ConfigurationError(
                "A session of an experiment runs on another `haploop serve` of this data folder: end it "
                "there first."
            ) from None
        self._ask_for_rig(experiment, participant)
        stack.callback(self._let_go)

    def _ask_for_rig(self, experiment: str, participant: str) -> None:
        status, answer = self._worker("hold", {"experiment": experiment, "participant": participant})
        if status != 200:
            raise ConfigurationError(str(answer.get("error", "The worker refused.")))

    def _let_go(self) -> None:
        with suppress(InstrumentError):  # a worker that has died holds nothing
            self._worker("let_go", {})

    def present(self, values: Mapping[str, Any]) -> None:
        """Log that the stimulus of the step that is due begins, or is repeated; and ask the participant.

        `turn` is that of the repeated step, or "", so that a double click presents nothing twice.
        """
        with self._changing:
            sitting = self._running()
            if values.get("turn") != sitting.turn:
                raise ConfigurationError("That was presented already, or has been answered.")
            self._refuse_unready(sitting)
            self._present(sitting)
            self._show()

    def done(self, values: Mapping[str, Any]) -> None:
        """Confirm presses, for a participant who does not see the page."""
        with self._changing:
            due = self._running().session.due
            if due is None or not _by_hand(self._running()):
                raise ConfigurationError("That is the participant's to answer.")
            self._take(values.get("turn"), "done")

    def pause(self, on: bool) -> None:
        """Pause, or go on; nothing is presented or answered in a pause."""
        with self._changing:
            sitting = self._sitting
            if sitting is None:
                raise ConfigurationError("No session of an experiment runs: begin one.")
            if sitting.paused != on:
                sitting.session.event("pause" if on else "continue")
                sitting.paused = on
                self._show()

    def end(self) -> None:
        """End the session here, complete or not; `begin` continues it at the step that is due."""
        with self._changing:
            if self._sitting is not None:
                self._sitting.open.close()
                self._sitting = None
                self._show()

    # The worker's board

    def heard(self, snapshot: Mapping[str, Any]) -> None:
        """Note what the rig has presented: its events go into the log before any page shows them."""
        with self._changing:
            surface = None if snapshot.get("gone") else snapshot.get("surface")
            self._surface, sitting = surface, self._sitting
            if sitting is not None and not snapshot.get("gone") and snapshot.get("held", sitting) is None:
                with suppress(HaploopError):  # another worker, in place of one that has died
                    self._ask_for_rig(sitting.name, sitting.session.assignment.participant)
            if sitting is None or not sitting.playing:
                return
            if surface is None:
                sitting.failed(
                    "The rig was left before the stimulus was over: prepare it, and present again."
                )
            elif surface["turn"] == sitting.turn:
                try:
                    self._presented(sitting, surface)
                except HaploopError as error:
                    sitting.failed(str(error))
            self._show()

    def _presented(self, sitting: _Sitting, surface: Mapping[str, Any]) -> None:
        for kind, details in surface["events"][sitting.noted :]:
            sitting.session.event(kind, **details)
            sitting.noted += 1
        if surface["state"] == "failed":
            sitting.failed(surface["sentence"])
        elif surface["state"] == "done":
            sitting.playing = False
            if sitting.session.due is not None and sitting.session.due.kind == "finger":
                self._take(sitting.turn, "done")

    # The participant's page

    def answer(self, values: Mapping[str, Any]) -> None:
        """Take an answer to the step that waits for one, by its turn. Raises DataError for an invalid one."""
        with self._changing:
            self._take(values.get("turn"), values.get("answer"))

    def _running(self) -> _Sitting:
        sitting = self._sitting
        if sitting is None or sitting.session.due is None:
            raise ConfigurationError("No session of an experiment runs: begin one.")
        if sitting.paused:
            raise ConfigurationError("The session is paused.")
        return sitting

    def _refuse_unready(self, sitting: _Sitting) -> None:
        if not _plays(sitting):
            return
        ready = self._surface is not None and self._surface["experiment"] == sitting.name
        if sitting.playing or not ready:
            raise ConfigurationError(
                "The rig presents the stimulus already: wait."
                if sitting.playing
                else "The rig plays this experiment's digital buttons: prepare it first."
            )

    def _present(self, sitting: _Sitting) -> None:
        """Log the stimulus of the step that is due, and have the rig present it if it has a part in it."""
        sitting.session.presented()
        sitting.turn = sitting.turn or secrets.token_hex(8)
        sitting.told, sitting.problem, sitting.noted = None, "", 0
        sitting.playing = _plays(sitting)
        if sitting.playing:
            who = sitting.session.assignment
            asked = {"participant": who.participant, "session": who.session, "turn": sitting.turn}
            try:
                status, answer = self._worker("present", asked)
            except InstrumentError as error:
                status, answer = 503, {"error": str(error)}
            if status != 200:
                sitting.failed(str(answer.get("error", "The worker refused.")))

    def _take(self, turn: object, answer: object) -> None:
        sitting = self._running()
        step, session = sitting.session.due, sitting.session
        if step is None or not sitting.turn or turn != sitting.turn or sitting.playing:
            raise DataError("That was answered already, or is asked no more.")
        told = session.answer(answer)
        sitting.turn = ""
        sitting.last = {"block": step.block, "number": step.number, "answer": answer}
        sitting.told = None if told is None else {"right": told, "was": step.presented}
        due = session.due
        if due is None:
            with suppress(HaploopError):  # the page says what is wrong with the list
                self.completed(sitting.name, session.assignment.participant)
        elif due.kind == "finger" and due.number > 1:
            # One press follows the other; only the first of them waits for the operator.
            self._present(sitting)
        self._show()

    def _show(self) -> None:
        sitting = self._sitting
        self.operator = None if sitting is None else _for_operator(sitting)
        self.participant = None if sitting is None else _for_participant(sitting)


def _plays(sitting: _Sitting) -> bool:
    """Whether the rig has a part in the step that is due."""
    step = sitting.session.due
    return step is not None and played_by_rig(sitting.store.experiment.file, step)


def _by_hand(sitting: _Sitting) -> bool:
    """Whether a step is done and not answered: a blindfolded participant has the operator confirm it."""
    step = sitting.session.due
    return step is not None and step.by_hand and not _plays(sitting)


def _for_operator(sitting: _Sitting) -> dict[str, Any]:
    session, file, step = sitting.session, sitting.store.experiment.file, sitting.session.due
    who = session.assignment
    return {
        "experiment": sitting.name,
        "title": file.title or file.name,
        "participant": who.participant,
        "group": who.group,
        "session": who.session,
        "sessions": file.sessions,
        "levels": session_levels(file, who),
        "blocks": [block.name for block in file.block],
        "step": None if step is None else _step(step) | {"stimulus": _stimulus(sitting, step)},
        "introduction": _introduction(sitting),
        "turn": sitting.turn,
        "by_hand": _by_hand(sitting),
        "plays": _plays(sitting),
        "playing": sitting.playing,
        "problem": sitting.problem,
        "paused": sitting.paused,
        "last": sitting.last,
    }


def _stimulus(sitting: _Sitting, step: Step) -> str:
    """What the operator is to present: the levels of this trial, and the values of two intervals."""
    of_session = session_levels(sitting.store.experiment.file, sitting.session.assignment)
    shown = [level for name, level in step.stimulus.items() if name not in of_session]
    if step.compares:
        shown.append("{:g}, then {:g}".format(*step.values))
    return ", ".join(shown)


def _for_participant(sitting: _Sitting) -> dict[str, Any]:
    """What the participant may see: never the stimulus, nor whether an answer was right, unless told."""
    step = sitting.session.due
    return {
        "step": None if step is None else _step(step),
        "introduction": _introduction(sitting),
        "ask": question(sitting.store.experiment.file, step, sitting.turn)
        if step and sitting.turn and not sitting.playing
        else None,
        "paused": sitting.paused,
        "told": sitting.told,
    }


def _step(step: Step) -> dict[str, Any]:
    # How many trials a staircase takes depends on the answers.
    return {"block": step.block, "number": step.number, "of": 0 if step.kind == "staircase" else step.of}


def _introduction(sitting: _Sitting) -> str:
    step = sitting.session.due
    texts = {block.name: block.text for block in sitting.store.experiment.file.block}
    return "" if step is None else texts[step.block]


def _refuse_too_soon(store: Store, participant: str) -> None:
    """Raise ConfigurationError when the day that is due would begin hours after the one before."""
    due = store.next_session(participant)
    hours = store.soon_after(participant, due) if due else None
    if hours is not None:
        raise ConfigurationError(
            f"{participant}'s day before ended {hours:.1f} hours ago: if day {due} is meant to begin now, "
            f"choose {due} as the day."
        )


# What a participant is asked in a step, for their page and for a preview.


def question(file: ExperimentFile, step: Step, turn: str) -> dict[str, Any]:
    """What the page asks: text, and choices or scales; `turn` comes back with the answer."""
    asked: dict[str, Any] = {"turn": turn, "kind": step.kind, "text": step.text}
    match step.kind:
        case "presses":
            times = "once" if step.repetitions == 1 else f"{step.repetitions} times"
            name = next(iter(step.stimulus.values()), "")
            asked["text"] = f"Press the physical {name} button {times}."
        case "finger":
            asked["text"] = f"A {step.stimulus['press']} press."
        case "rating":
            low, high = step.values
            pairs = zip(step.choices, file.question.pairs, strict=True)
            asked |= {"pairs": [[name, *ends] for name, ends in pairs], "low": low, "high": high}
        case "identification":
            asked["choices"] = [[name, name] for name in step.choices]
        case _:
            asked["choices"] = [[1, "First"], [2, "Second"]]
    return asked
