"""What a study says: who has pressed what, and the forces at activation in its recordings."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from statistics import mean, stdev
from typing import Any

import numpy as np

from ...acquisition import Recording, Study, StudyProgress
from ...base.arrays import FloatArray
from ...base.errors import DataError
from ...base.wording import capital
from .parts import Cell, Contents, Drawing, Fact, Grid, Verdict, fact
from .press import press_drawing
from .recording import forces_drawing, forces_in


def study_contents(study: Study, progress: Sequence[StudyProgress]) -> Contents:
    """Progress of a study: presses, sessions and consents by participant and button."""
    file = study.file
    done, of = sum(len(one.accepted) for one in progress), sum(one.of for one in progress)
    recordings = [recording for one in progress for recording in one.recordings]
    by: dict[str, dict[str, StudyProgress]] = {}
    for one in progress:
        by.setdefault(one.participant, {})[one.button] = one
    consented = {name: any(one.consented for one in mine.values()) for name, mine in by.items()}
    participants = [
        {
            "participant": name,
            "consented": consented[name],
            "order": file.order_for(name),
            "buttons": {button: _values(one) for button, one in mine.items()},
        }
        for name, mine in by.items()
    ]
    rows: list[tuple[str | Cell, ...]] = []
    for name, mine in by.items():
        consent = (
            [Cell("yes", "good") if consented[name] else Cell("not yet", "aside")] if file.consent else []
        )
        presses = [_cell(mine[button]) for button in file.buttons]
        rows.append((name, *consent, *presses, Cell(", ".join(file.order_for(name)), "aside")))
    buttons = [capital(button) for button in file.buttons]
    headings = ("Participant", *(["Consent"] if file.consent else []), *buttons, "Order")
    facts = [
        fact(study=file.name, file=study.path, participants=participants),
        fact(accepted=done, of=of, complete=done == of),
        *_columns(recordings),
    ]
    return Contents(
        f"Study {file.name}: {done} of {of} presses",
        facts,
        [Grid("", headings, rows, words=len(headings))],
        [_next(progress)],
        simulated=any(recording.simulated for recording in recordings),
        rig=recordings[0].rig if recordings else "",
        verdicts=[
            Verdict(
                f"{one.participant}, {one.button}",
                "complete" if one.complete else "incomplete",
                one.complete,
                f"{len(one.accepted)} of {one.of} presses accepted",
                ", ".join(_asides(one)),
            )
            for one in progress
        ],
    )


def study_figures(study: Study) -> list[Drawing]:
    """The figures of a study: its forces, and the representative press of each button."""
    recordings = [recording for button in study.file.buttons for recording in study.recordings(button)]
    forces = forces_in(recordings)
    pressed = sorted({one.button for one in recordings if one.motion and one.accepted})
    presses = [press_drawing(study.representative(button)) for button in pressed]
    return [*([forces_drawing(recordings, f", study {study.file.name}")] if forces else []), *presses]


def forces_contents(recordings: Sequence[Recording]) -> Contents:
    """Force at activation by participant and button. Raises DataError without an accepted press."""
    by_button = forces_in(recordings)
    if not by_button:
        raise DataError(
            "The recordings hold no accepted press with an activation, so there is no force to show."
        )
    everyone = {button: np.concatenate(list(by.values())) for button, by in by_button.items()}
    values = {
        button: {
            **_summary(everyone[button]),
            "participants": {name: _summary(mine) for name, mine in by.items()},
        }
        for button, by in by_button.items()
    }
    names = sorted({name for by in by_button.values() for name in by})
    rows = [(name, *(_force(by.get(name)) for by in by_button.values())) for name in names]
    rows.append(("All", *map(_force, everyone.values())))
    headings = ("Participant", *(capital(button) for button in by_button))
    return Contents(
        "",
        [fact(files=[recording.path for recording in recordings], buttons=values)],
        [Grid("Force at activation", headings, rows)],
        kind="recordings",
        simulated=any(recording.simulated for recording in recordings),
        figures=[forces_drawing(recordings)],
    )


def _next(progress: Sequence[StudyProgress]) -> str:
    """What is recorded now, or is to be recorded next."""
    for one in progress:
        if one.in_progress:
            return f"{one.participant}, {one.button} is being recorded now."
    for one in progress:
        if not one.complete:
            press = f"press {one.missing[0][0]}"
            return f"`haploop study run` continues with {one.participant}, {one.button}, {press}."
    return "Every press has been recorded. Plot the forces with `haploop show STUDY --plot OUT.png`."


def _values(one: StudyProgress) -> dict[str, Any]:
    return {
        "accepted": len(one.accepted),
        "of": one.of,
        "missing": [number for number, _ in one.missing],
        "bad": one.bad,
        "rejected": one.rejected,
        "sessions": len(one.recordings),
        "interrupted": one.interrupted,
        "in_progress": one.in_progress,
        "files": [recording.path for recording in one.recordings],
    }


def _cell(one: StudyProgress) -> Cell:
    if not one.recordings:
        return Cell("-", "aside")
    asides = [*_asides(one), *(["in progress"] if one.in_progress else [])]
    told = f" ({', '.join(asides)})" if asides else ""
    return Cell(f"{len(one.accepted)}/{one.of}{told}", "good" if one.complete else "doubtful")


def _asides(one: StudyProgress) -> list[str]:
    counts = ((one.bad, "bad"), (one.rejected, "rejected"), (one.interrupted, "interrupted"))
    return [f"{count} {word}" for count, word in counts if count]


def _columns(recordings: Sequence[Recording]) -> Iterator[Fact]:
    """Summarise what the recordings say of their participants; the latest of each participant counts."""
    about = {recording.participant: recording.about for recording in recordings}
    for column in dict.fromkeys(column for mine in about.values() for column in mine):
        values = [mine[column] for mine in about.values() if column in mine]
        numbers = [v for v in values if isinstance(v, int | float) and not isinstance(v, bool)]
        if len(numbers) == len(values):
            spread = f", standard deviation {stdev(numbers):.1f}" if len(numbers) > 1 else ""
            told = (
                f"{min(numbers):g} to {max(numbers):g}, mean {mean(numbers):.1f}{spread} (n = {len(values)})"
            )
        else:
            counts = Counter("yes" if v is True else "no" if v is False else str(v) for v in values)
            told = ", ".join(f"{value}: {count}" for value, count in sorted(counts.items()))
        yield fact(capital(column), told)


def _summary(forces: FloatArray) -> dict[str, Any]:
    return {
        "presses": len(forces),
        "activation_force_n": float(np.mean(forces)),
        "activation_force_sd_n": float(np.std(forces, ddof=1)) if len(forces) > 1 else None,
    }


def _force(forces: FloatArray | None) -> str:
    if forces is None or not len(forces):
        return "-"
    spread = f" ± {np.std(forces, ddof=1):.2f}" if len(forces) > 1 else ""
    return f"{np.mean(forces):.2f}{spread} N ({len(forces)})"
