"""What an experiment says: what it asks, who has answered what, and a prediction of the answers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from ...base.errors import DataError
from ...calibration.perception import Sensation
from ...reports.contents import ANSWERS_SIMULATED, Contents, Fact, Grid, counted, fact, fixed, percent, plain
from ..analysis import METRICS, PAPER, PAPER_METRICS, Prediction
from ..contact import Latency, latency_of
from ..protocol import Assignment, Balance, Course, ExperimentFile, Step, balance_of, group_of_slot
from ..session import Store, StoredSession

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


# What a prediction of answers says, beside the paper's tables III and IV.

_PAPER_RIGHT = (0.70, 0.9233)
"""Right answers in the paper's four groups and days, least and most (findings of its tables III and IV)."""
_NOT_KNOWN = (
    "Not in it: how well people remember a button (between a twentieth and all of what the differences "
    "allow: an estimate), cues beside the surface's vibration (force, travel, sound), pitch, learning with "
    "confirmation. Predicted of the motion that was checked, as the table was then: bare, or under a finger."
)


def prediction_contents(found: Prediction) -> Contents:
    """What a prediction says."""
    mean, least, most = found.overall
    rows = [
        (
            name,
            fixed(level, 1, "dB"),
            *(
                f"{percent(cell, 0)} ({100 * low:.0f} to {percent(high, 0)})"
                for cell, low, high in zip(cells, lows, highs, strict=True)
            ),
        )
        for name, level, cells, lows, highs in zip(
            found.classes, found.levels, found.cells, found.least, found.most, strict=True
        )
    ]
    tables = [
        Grid(
            "Predicted answers, in percent of the presented button (90 % of what is not known)",
            ("Presented", "Level", *found.classes),
            rows,
        )
    ]
    paper: list[Fact] = []
    if set(found.classes) <= set(PAPER):
        tables.append(
            Grid(
                "The paper's tables III and IV: range over groups and days",
                ("Presented", *found.classes),
                [
                    (name, *(f"{PAPER[name][one][0]} to {PAPER[name][one][1]} %" for one in found.classes))
                    for name in found.classes
                ],
            )
        )
        paper.append(
            fact(
                "In the paper",
                f"{percent(_PAPER_RIGHT[0], 0)} to {percent(_PAPER_RIGHT[1], 0)}",
                paper={"right": _PAPER_RIGHT, "answers_percent": PAPER},
            )
        )
    if set(found.classes) == set(PAPER):
        cells, within = _beside(found)
        tables.append(cells)
        paper.append(
            fact(
                "Cells of tables III and IV within the range",
                f"{within} of 36",
                cells={"within": within, "metrics": METRICS, "predicted": plain(found.metrics)},
            )
        )
    return Contents(
        "Prediction of answers",
        [
            fact(
                "Right answers",
                f"{percent(mean, 0)} ({100 * least:.0f} to {percent(most, 0)}); by guessing "
                f"{percent(found.chance, 0)}",
                right=plain(found.overall),
                classes=found.classes,
                answers=plain(found.cells),
                least=plain(found.least),
                most=plain(found.most),
                above_threshold_db=found.levels,
            ),
            *paper,
        ],
        kind="prediction",
        tables=tables,
        notes=[Sensation(found.act, 0.0).reservation, _NOT_KNOWN],
        simulated=found.simulated or None,
        undrawn="There is no figure of a prediction.",
    )


def _beside(found: Prediction) -> tuple[Grid, int]:
    """The cells of the paper's tables beside those predicted, and how many lie within their ranges."""
    rows, within = [], 0
    for number, metric in enumerate(METRICS):
        for column, name in enumerate(PAPER):
            mean, low, high = found.metrics[number, found.classes.index(name)]
            paper = [cells[number][column] for cells in PAPER_METRICS.values()]
            within += sum(100 * low <= one <= 100 * high for one in paper)
            predicted = f"{percent(mean, 0)} ({100 * low:.0f} to {percent(high, 0)})"
            rows.append((f"{metric}, {name}", predicted, *(f"{one:.2f} %" for one in paper)))
    titles = (f"Group {group}, day {day}" for group, day in PAPER_METRICS)
    title = "Tables III and IV of the paper, beside the prediction (one for all groups and days)"
    return Grid(title, ("Cell", "Predicted", *titles), rows), within
