"""Who has answered what in an experiment."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from rich.box import SIMPLE
from rich.table import Table

from ...experiments import Store, StoredSession, balance_of, latency_of
from ...instruments import DataError
from ...terminal.progress import print_json, print_line, print_table
from .formatting import ANSWERS_SIMULATED

__all__ = ["experiment_values", "show_experiment"]


def experiment_values(store: Store) -> dict[str, Any]:
    """Return each session that was begun, and each withdrawal, as JSON values.

    `problems` has a sentence for each log that is damaged, missing or cut short. Raises DataError for
    withdrawals or marks that are.
    """
    sessions, problems = _readable(store)
    latencies = [e.values["latency"] for one in sessions for e in one.events if e.kind == "activation"]
    slots = {one.assignment.participant: one.assignment.slot for one in sessions}
    return {
        "experiment": store.experiment.file.name,
        "folder": str(store.folder),
        "simulated": any(one.simulated for one in sessions),
        "sessions": [
            {
                "participant": one.assignment.participant,
                "group": one.assignment.group,
                "session": one.assignment.session,
                "answers": len(one.answers),
                "complete": one.complete,
                "due": one.due and {"block": one.due.block, "trial": one.due.number},
                "begun": one.events[0].time,
                "resumed": sum(event.kind == "resumed" for event in one.events),
                "log": str(one.path),
            }
            for one in sessions
        ],
        "problems": problems,
        "design": asdict(balance_of(store.experiment.file, [*slots.values()])),
        "latency": asdict(latency_of(latencies)) if latencies else None,
        "withdrawn": [{"participant": one.participant, "time": one.time} for one in store.withdrawals()],
    }


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


def show_experiment(store: Store, as_json: bool) -> bool:
    """Show each session that was begun, and each withdrawal; return whether every log can be read."""
    found = experiment_values(store)
    if as_json:
        print_json(found)
        return not found["problems"]
    table = Table(box=SIMPLE, title=f"{store.experiment.file.name} in {store.folder}", title_justify="left")
    for column in ("Participant", "Group", "Session", "Answers", "Due", "Begun"):
        table.add_column(column)
    for one in found["sessions"]:
        due = f"{one['due']['block']} {one['due']['trial']}" if one["due"] else "to be sealed"
        begun = one["begun"][:16].replace("T", " ")
        answers, due = str(one["answers"]), "complete" if one["complete"] else due
        table.add_row(one["participant"], one["group"], str(one["session"]), answers, due, begun)
    print_table(table)
    for gone in found["withdrawn"]:
        print_line(f"{gone['participant']} withdrew at {gone['time']}.")
    if not found["design"]["balanced"]:
        print_line(_unbalanced(found["design"]))
    if told := found["latency"]:
        over = "within" if told["worst"] <= told["budget"] else "beyond"
        print_line(
            f"{told['count']} activations: from frame to drive {_ms(told['median'])} (median), "
            f"{_ms(told['p95'])} (95 %), {_ms(told['worst'])} at most, {over} the budget of "
            f"{_ms(told['budget'])}."
        )
    if found["simulated"]:
        print_line(ANSWERS_SIMULATED)
    for sentence in found["problems"]:
        print_line(sentence)
    return not found["problems"]


def _unbalanced(design: dict[str, Any]) -> str:
    people = sum(design["groups"].values())
    several = ", ".join(f"{name} {count}" for name, count in design["groups"].items())
    inside = f" ({several})" if len(design["groups"]) > 1 else ""
    return (
        f"The design is not balanced with {people} participant{'s' * (people != 1)}{inside}: groups are "
        f"equally large, and each order is used equally often, at a multiple of {design['multiple_of']}."
    )


def _ms(seconds: float) -> str:
    return f"{1000 * seconds:.0f} ms"
