"""The job that plays an experiment's digital buttons: it holds the rig, and waits for what to present.

The session and its log are the server's. For each stimulus this job reads the log, and puts what happened on
the board, from where the server writes it into the log.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from ...base.errors import ConfigurationError, DataError
from ...base.threads import Flag, Inbox
from ...experiments import Assignment, Event, Experiment, Presenter, Store, prepare_surface
from ...instruments import Rig
from .board import Board


class Stimuli:
    """What the pages ask a running job to present. For any thread."""

    def __init__(self, board: Board, nobody: Flag) -> None:
        self._board, self._nobody = board, nobody
        self._asked: Inbox[Mapping[str, Any] | None] = Inbox()

    def present(self, values: Mapping[str, Any]) -> None:
        """Ask for the step that is due in a session: {participant, session, turn}."""
        surface = self._board["surface"]
        if surface is None or surface["state"] == "presenting":
            raise ConfigurationError("The rig is not ready to present a stimulus: prepare it, or wait.")
        self._board.set(surface=_surface(surface["experiment"], "presenting", str(values.get("turn", ""))))
        self._asked.put(values)

    def release(self) -> None:
        """Have the job end, and leave the rig."""
        self._asked.put(None)

    def next(self) -> Mapping[str, Any] | None:
        """Wait for a stimulus; None when the job is to end, or no page has been there for long."""
        while not self._nobody.is_set():
            if self._asked.wait():
                return self._asked.take()
        return None

    def forget(self) -> None:
        """Forget what was asked for before."""
        while len(self._asked):
            self._asked.take()


@dataclass(frozen=True)
class _Noted:
    """A session as its log tells it, whose new events go to the board."""

    assignment: Assignment
    board: Board
    events: list[Event] = field(default_factory=list)

    def event(self, kind: str, **details: Any) -> None:
        """Note an event on the board."""
        self.events.append(Event(0, kind, "", 0.0, 0, details))
        self.board.change(
            "surface", lambda surface: {**surface, "events": [*surface["events"], [kind, details]]}
        )


def present_stimuli(rig: Rig, name: str, store: Store, board: Board, stimuli: Stimuli) -> None:
    """Prepare the rig for an experiment, and present what is asked for, until it is to be left."""
    experiment: Experiment = store.experiment
    presenter = Presenter(prepare_surface(rig, experiment, board.progress), experiment.file)
    stimuli.forget()
    board.set(surface=_surface(name, "ready", ""), progress=None, request=None)
    try:
        while (asked := stimuli.next()) is not None:
            sentence = ""
            try:
                _present(store, presenter, board, asked)
            except DataError as error:
                sentence = str(error)
            board.set(request=None)
            board.change("surface", _ended(sentence))
    finally:
        board.set(surface=None)


def _present(store: Store, presenter: Presenter, board: Board, asked: Mapping[str, Any]) -> None:
    stored = store.session(str(asked.get("participant")), int(asked.get("session", 1)))
    if stored is None or stored.due is None:
        raise DataError("No step of that session is due.")
    presenter.present(_Noted(stored.assignment, board, list(stored.events)), stored.due)


def _ended(sentence: str) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """What makes a surface that presents one that has done so, or failed to for the reason in `sentence`."""
    state = "failed" if sentence else "done"
    return lambda now: {**now, "state": state, "sentence": sentence}


def _surface(experiment: str, state: str, turn: str) -> dict[str, Any]:
    return {"experiment": experiment, "state": state, "turn": turn, "sentence": "", "events": []}
