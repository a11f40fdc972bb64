"""What an experiment says: who has answered what."""

from __future__ import annotations

from ...base.errors import DataError
from ...experiments import Balance, Latency, Store, StoredSession, balance_of, latency_of
from .parts import Contents, Grid, fact
from .words import ANSWERS_SIMULATED, counted


def experiment_contents(store: Store) -> Contents:
    """Each session that was begun, and each withdrawal.

    The value `problems` has a sentence for each log that is damaged, missing or cut short. Raises DataError
    for withdrawals or marks that are.
    """
    sessions, problems = _readable(store)
    withdrawn = store.withdrawals()
    name = store.experiment.file.name
    latencies = [e.values["latency"] for one in sessions for e in one.events if e.kind == "activation"]
    latency = latency_of(latencies) if latencies else None
    slots = {one.assignment.participant: one.assignment.slot for one in sessions}
    design = balance_of(store.experiment.file, [*slots.values()])
    rows, values = [], []
    for one in sessions:
        who, due, begun = one.assignment, one.due, one.events[0].time
        values.append(
            {
                "participant": who.participant,
                "group": who.group,
                "session": who.session,
                "answers": len(one.answers),
                "complete": one.complete,
                "due": due and {"block": due.block, "trial": due.number},
                "begun": begun,
                "resumed": sum(event.kind == "resumed" for event in one.events),
                "log": one.path,
            }
        )
        still = f"{due.block} {due.number}" if due else "complete" if one.complete else "to be sealed"
        when = begun[:16].replace("T", " ")
        rows.append((who.participant, who.group, str(who.session), str(len(one.answers)), still, when))
    headings = ("Participant", "Group", "Session", "Answers", "Due", "Begun")
    notes = [f"{gone.participant} withdrew at {gone.time}." for gone in withdrawn]
    if not design.balanced:
        notes.append(_unbalanced(design))
    if latency:
        notes.append(_latency(latency))
    notes += problems
    facts = fact(
        experiment=name,
        folder=store.folder,
        sessions=values,
        problems=problems,
        design=design,
        latency=latency,
        withdrawn=[{"participant": gone.participant, "time": gone.time} for gone in withdrawn],
    )
    return Contents(
        "",
        [facts],
        [Grid(f"{name} in {store.folder}", headings, rows, words=len(headings))],
        notes,
        simulated=any(one.simulated for one in sessions),
        origin=ANSWERS_SIMULATED,
    )


def _readable(store: Store) -> tuple[list[StoredSession], list[str]]:
    sessions, problems = [], []
    for who in store.participants():
        for number in range(1, store.experiment.file.sessions + 1):
            try:
                found = store.session(who, number)
            except DataError as error:
                problems.append(str(error))
            else:
                sessions += [found] if found else []
    return sessions, problems


def _unbalanced(design: Balance) -> str:
    several = ", ".join(f"{name} {count}" for name, count in design.groups.items())
    inside = f" ({several})" if len(design.groups) > 1 else ""
    return (
        f"The design is not balanced with {counted(sum(design.groups.values()), 'participant')}{inside}: "
        f"groups are equally large, and each order is used equally often, at a multiple of "
        f"{design.multiple_of}."
    )


def _latency(told: Latency) -> str:
    over = "within" if told.worst <= told.budget else "beyond"
    return (
        f"{told.count} activations: from frame to drive {_ms(told.median)} (median), {_ms(told.p95)} (95 %), "
        f"{_ms(told.worst)} at most, {over} the budget of {_ms(told.budget)}."
    )


def _ms(seconds: float) -> str:
    return f"{1000 * seconds:.0f} ms"
