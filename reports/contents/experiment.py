"""What an experiment says: what it asks, and who has answered what."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from ...base.errors import DataError
from ...experiments import (
    Assignment,
    Balance,
    Course,
    ExperimentFile,
    Latency,
    Step,
    Store,
    StoredSession,
    balance_of,
    group_of_slot,
    latency_of,
)
from .parts import Contents, Fact, Grid, fact
from .words import ANSWERS_SIMULATED, counted

_ASKS = {
    "identification": "identification: which was it?",
    "rating": "rating of pairs of adjectives",
    "two-interval": "two intervals: in which was it stronger?",
    "staircase": "staircase: in which of two intervals was it stronger?",
}


def plan_of_experiment(store: Store, why: str) -> Contents:
    """What an experiment is and who has begun it, where it has no scores; `why` says why it has none.

    Raises DataError as `experiment_contents`.
    """
    file, begun = store.experiment.file, experiment_contents(store)
    return replace(
        begun,
        title=f"Experiment {file.title or file.name}",
        facts=[*begun.facts, *_conditions(file)],
        tables=[steps_grid(file), *(replace(grid, title="Sessions") for grid in begun.tables)],
        notes=[why, *begun.notes],
    )


def steps_grid(file: ExperimentFile) -> Grid:
    """The blocks of the first participant's first day: kind, order, first stimulus and number of steps."""
    blocks = {block.name: block for block in file.block}
    rows = [
        (one.block, one.kind, blocks[one.block].order, _first(one),
         f"{'up to ' if one.kind == 'staircase' else ''}{one.of}")
        for one in first_steps(file)
    ]  # fmt: skip
    days = "a day" if file.sessions == 1 else f"each of {file.sessions} days"
    headings = ("Block", "Kind", "Order", "First", "Steps")
    return Grid(f"Steps of a participant, {days}", headings, rows, words=4)


def _first(step: Step) -> str:
    """The first stimulus: levels of factors, and the values of two intervals."""
    values = [" and ".join(f"{value:g}" for value in step.values)] if step.compares else []
    return ", ".join([*step.stimulus.values(), *values])


def first_steps(file: ExperimentFile) -> list[Step]:
    """The first step of each block of the first participant's first day."""
    return Course(file, Assignment("P01", 0, group_of_slot(file, 0), 1)).firsts()


def _conditions(file: ExperimentFile) -> Iterator[Fact]:
    yield fact("Kind", _ASKS[file.kind])
    if file.question.text:
        yield fact("Question", file.question.text)
    for factor in file.factor:
        yield fact(factor.name.capitalize(), f"{', '.join(factor.levels)} (varies by {factor.varies})")
    if file.question.pairs:
        yield fact("Pairs", ", ".join(file.pair_names))
    if file.comparison:
        yield fact(file.comparison.name.capitalize(), _compared(file))
    if len(file.groups) > 1:
        yield fact("Groups", ", ".join(file.groups))
    multiple = balance_of(file, []).multiple_of
    if multiple > 1:
        yield fact("Balanced", f"with a multiple of {multiple} participants")


def _compared(file: ExperimentFile) -> str:
    """What is compared in two intervals."""
    compared = file.comparison
    assert compared is not None
    values = ", ".join(f"{level:g}" for level in compared.levels)
    if file.kind == "staircase":
        values = f"a staircase from {compared.start:g}, {compared.down} right answers in a row down"
    unit = f" {compared.unit}" if compared.unit not in ("", "1") else ""  # 1: a ratio
    return f"{compared.standard:g}{unit} against {values}{unit if compared.levels else ''}"


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
