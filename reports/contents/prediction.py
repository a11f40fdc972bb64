"""What a prediction of answers says, beside the paper's tables III and IV."""

from __future__ import annotations

from ...calibration.perception import Sensation
from ...experiments import METRICS, PAPER, PAPER_METRICS, Prediction
from .parts import Contents, Fact, Grid, fact, plain
from .words import fixed, percent

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
        notes=[
            Sensation(found.act, 0.0).reservation,
            _NOT_KNOWN,
        ],
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
