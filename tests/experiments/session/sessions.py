"""Sessions of simulated participants, also interrupted and killed ones."""

from pathlib import Path

import pytest

from haploop.base.clock import VirtualClock
from haploop.base.line_files import Mark, read_lines, read_marks, write_marks
from haploop.experiments.protocol import load_experiment
from haploop.experiments.session import Store, open_session, run_session
from haploop.mocks.people import ParticipantModel, SimulatedParticipant

__all__ = ["Stops", "answers", "broken", "killed", "ran", "run", "store"]


class Stops:
    """A participant whose session is interrupted at a step."""

    def __init__(self, who: SimulatedParticipant, after: int) -> None:
        self._who, self._left = who, after
        self.told = who.told

    def answer(self, step: object) -> object:
        if not self._left:
            raise KeyboardInterrupt
        self._left -= 1
        return self._who.answer(step)


def store(folder: Path, name: str = "matching") -> Store:
    return Store(load_experiment(name), folder / "answers")


def run(
    where: Store, participant: str, after: int | None = None, model: ParticipantModel | None = None
) -> None:
    with open_session(where, participant, VirtualClock(), simulated=True) as session:
        who = SimulatedParticipant(model or ParticipantModel(), participant, session.assignment.session)
        run_session(session, who if after is None else Stops(who, after))


def ran(folder: Path, *people: str, name: str = "matching") -> Store:
    """A store in which sessions of people were run, one after the other."""
    where = store(folder, name)
    for who in people:
        run(where, who)
    return where


def broken(where: Store, participant: str, after: int) -> None:
    """Run a session that is interrupted."""
    with pytest.raises(KeyboardInterrupt):
        run(where, participant, after)


def killed(where: Store, participant: str) -> None:
    """Put a participant's mark back to where a program that is killed leaves it."""
    path = where.path_of(participant, 1)
    mark = Mark.of(read_lines(path, only_first=True))
    write_marks(where.folder, {**read_marks(where.folder), f"{participant}/{path.name}": mark})


def answers(where: Store, participant: str, session: int = 1) -> list[object]:
    stored = where.session(participant, session)
    return [(step.block, step.number, step.presented, answer) for step, answer, _ in stored.answers]
