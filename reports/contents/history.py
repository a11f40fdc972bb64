"""What a rig's calibration history says: its calibrations, one of them, their difference, a recalibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from ...calibration import Calibration, Check
from ...calibration.recalibration import (
    Generation,
    History,
    Outcome,
    PlaceMetrics,
    buttons_of,
    calibrations_of,
)
from .. import figures
from . import words
from .parts import Cell, Contents, Drawing, Grid, Tone, fact, verdict_cell
from .words import counted, damping, fixed, measured_error, percent

Place = tuple[str, str]

_METRICS = (
    # Metric, its label, and the factor to the label's unit.
    ("resonance_hz", "Resonance (Hz)", 1.0),
    ("damping", "Damping ratio (%)", 100.0),
    ("gain", "Gain (m/s² per V)", 1.0),
    ("coherence", "Coherence", 1.0),
)

_OUTCOMES = {
    "unchanged": "The calibration holds",
    "restored": "The table had drifted; every button is within tolerance again",
    "drifted": "The table has drifted; not every button could be brought within tolerance",
    "touched": "Something rests on the table; nothing was changed",
    "broken": "Something is broken; nothing was changed",
    "not shown": "Nothing has changed that could be seen, and whether the buttons are right cannot be told",
}
"""Title of each kind of outcome."""


def history_contents(history: History) -> Contents:
    """Every calibration of a history; the active one is marked."""
    activations, generations = history.activations, history.generations
    active = activations[-1].generation if activations else ""
    listed = [
        {
            "name": one.name,
            "created": one.created,
            "parent": one.parent or None,
            "reason": one.reason,
            "buttons": [path.stem for path in one.paths("buttons")],
            "active": one.name == active,
            "activations": [vars(a) for a in activations if a.generation == one.name],
        }
        for one in generations
    ]
    rows = [
        (
            "active" if one.name == active else "",
            one.name,
            f"{datetime.fromisoformat(one.created):%Y-%m-%d %H:%M} UTC",
            one.parent.partition("-")[0],
            str(len(one.paths("buttons"))),
            one.reason,
        )
        for one in generations
    ]
    looks = history.looks
    nights = [night(history, look) for look in looks]
    measured = any(place.get("modes") for look in looks for place in look["places"])
    values = fact(
        folder=history.folder, active=active or None, generations=listed, looks=len(looks), nights=nights
    )
    headings = ("", "Calibration", "Made", "From", "Buttons", "Why")
    grid = Grid("Calibrations", headings, rows, words=len(headings))
    none = f"{history.folder} holds no calibration yet: make one with `haploop calibrations adopt`."
    trend = Drawing.alone(
        "trend",
        "Calibrations over time",
        words.TREND,
        lambda columns: figures.trend(history, columns),
        f"n = {len(looks)} looks.",
    )
    return Contents(
        f"History of calibrations, {history.folder}" if rows else "",
        [values],
        [*([grid] if rows else []), *([_nights(nights)] if nights else [])],
        [] if rows else [none],
        kind="history",
        simulated=simulated(history) if rows else None,
        figures=[*([trend] if activations else []), *([_modes_drawing(looks)] if measured else [])],
        undrawn=none,
    )


def _modes_drawing(looks: Sequence[Mapping[str, Any]]) -> Drawing:
    return Drawing.alone(
        "modes",
        "Drift of each mode",
        words.MODES,
        lambda columns: figures.nights_figure(looks, columns),
        f"n = {len(looks)} nights.",
    )


def night(history: History, look: Mapping[str, Any]) -> dict[str, Any]:
    """One night of a history as plain values: what was found, what was done, and why."""
    shifts = [one["shift"] for place in look["places"] for one in place.get("modes", [])]
    report = history.report(look["when"], look["outcome"])
    return {
        "when": look["when"],
        "outcome": look["outcome"],
        "drift": max(shifts, key=abs, default=None),
        "done": _done(look),
        "why": look["sentences"][0] if look["sentences"] else "",
        "compared_with": look["compared_with"],
        "active": look["active"],
        "report": report.name if report.is_file() else None,
    }


_TONES: dict[str, Tone] = {"unchanged": "good", "restored": "good", "broken": "bad"}
_NEWEST = 30
"""Nights in a table."""


def _done(look: Mapping[str, Any]) -> str:
    """What a night did."""
    if look["outcome"] == "restored":
        return f"{counted(look['buttons'], 'button')} made anew; {look['active']} is active"
    played = [
        f"{name} played: error {measured_error(one['before']['whole'], brief=True)}"
        for name, one in look["buttons"].items()
        if one["before"]
    ]
    kept = [] if look["outcome"] == "unchanged" else ["nothing changed"]
    return "; ".join([*(played or ["nothing played"]), *kept])


def _nights(nights: Sequence[Mapping[str, Any]]) -> Grid:
    """A line for each of the newest nights."""
    rows = [
        (
            f"{datetime.fromisoformat(one['when']):%Y-%m-%d %H:%M}",
            Cell(one["outcome"], _TONES.get(one["outcome"], "doubtful")),
            "" if one["drift"] is None else f"{one['drift']:+z.2%}",
            one["done"],
            one["why"],
        )
        for one in nights[: -_NEWEST - 1 : -1]
    ]
    of = f", the newest {_NEWEST} of {len(nights)}" if len(nights) > _NEWEST else ""
    headings = ("Night (UTC)", "Outcome", "Largest drift", "Done", "Why")
    return Grid(f"Nights{of}", headings, rows, words=len(headings))


def generation_contents(history: History, generation: Generation) -> Contents:
    """Verify and describe a calibration: places, buttons, reason, and periods of activity.

    Raises DataError when it is incomplete or damaged.
    """
    generation.verify()
    calibrations, buttons = calibrations_of(generation), buttons_of(generation)
    metrics = {_place(c): PlaceMetrics.of(c) for c in calibrations}
    activations = [a for a in history.activations if a.generation == generation.name]
    rig = calibrations[0].response.rig
    facts = [
        fact(name=generation.name, created=generation.created, digest=generation.digest),
        fact("Rig", rig, rig=rig),
        fact("Why", generation.reason, reason=generation.reason),
        fact("Made from", generation.parent or "nothing before it", parent=generation.parent or None),
        *(
            fact(
                f"Patch {patch}, {point}",
                f"{f.resonance_hz:.2f} Hz, damping {damping(c.model.carriers[0])}, gain {f.gain:.3g} m/s² "
                f"per V, coherence {f.coherence:.4f}",
            )
            for c, ((patch, point), f) in zip(calibrations, metrics.items(), strict=True)
        ),
        *(fact(name, str(button.check)) for name, button in buttons.items()),
        *(fact("Activated", f"{a.when} by {a.actor}: {a.reason}") for a in activations),
        fact(
            places={"-".join(place): vars(f) for place, f in metrics.items()},
            buttons={
                name: {"drive_peak_v": button.drive.peak, **button.check.summary()}
                for name, button in buttons.items()
            },
            activations=[vars(a) for a in activations],
        ),
    ]
    return Contents(
        f"Calibration {generation.name}",
        facts,
        simulated=any(c.response.simulated for c in calibrations),
        rig=rig,
    )


def difference_contents(one: Generation, other: Generation) -> Contents:
    """What changed from one calibration to another. Raises DataError when one is incomplete or damaged."""
    one.verify()
    other.verify()
    metrics = [{_place(c): vars(PlaceMetrics.of(c)) for c in calibrations_of(g)} for g in (one, other)]
    checks = [{name: button.check for name, button in buttons_of(g).items()} for g in (one, other)]
    places = {place: [found.get(place) for found in metrics] for place in sorted({*metrics[0], *metrics[1]})}
    buttons = {name: [found.get(name) for found in checks] for name in sorted({*checks[0], *checks[1]})}
    rows = [
        _change(f"{patch} at {point}: {label}", [None if f is None else factor * f[name] for f in both])
        for (patch, point), both in places.items()
        for name, label, factor in _METRICS
    ]
    rows += [
        _change(f"{name}: error (%)", [None if c is None else 100 * c.error for c in both])
        for name, both in buttons.items()
    ]
    values = fact(
        **{"from": one.name, "to": other.name},
        places={"-".join(place): {"from": was, "to": now} for place, (was, now) in places.items()},
        buttons={
            name: {"from": was and was.summary(), "to": now and now.summary()}
            for name, (was, now) in buttons.items()
        },
    )
    title = f"From {one.name} to {other.name}"
    return Contents("", [values], [Grid(title, ("", "Before", "After", "Change"), rows)])


def _change(label: str, numbers: Sequence[float | None]) -> tuple[str, str, str, str]:
    told = ["none" if number is None else f"{number:.4g}" for number in numbers]
    was, now = numbers
    change = f"{now / was - 1:+z.2%}" if was and now is not None else ""
    return label, told[0], told[1], change


def outcome_contents(
    history: History, outcome: Outcome, assumed: Sequence[str] = (), report: Path | None = None
) -> Contents:
    """What a recalibration found and did. `assumed` are requests that no operator was present to confirm."""
    after = {name: button.check for name, button in outcome.after.items()}
    names = sorted({*outcome.before, *after})
    told = [f"Assumed, with no operator present: {sentence}" for sentence in assumed]
    calibrations = calibrations_of(outcome.active)
    rig = calibrations[0].response.rig
    rows = [_button_row(name, outcome, after) for name in names]
    tables = [Grid("Buttons", _OF_BUTTON, rows, below=_ERROR)] if rows else []
    if outcome.verdicts:
        tables.append(_places(outcome))
    drawings = [
        Drawing.alone(
            "before-and-after",
            "Before and after",
            words.BEFORE_AND_AFTER,
            lambda _: figures.before_and_after(outcome.before, after),
        )
    ]
    if outcome.kind == "restored":
        previous = calibrations_of(history.find(outcome.active.parent))
        drawings.append(
            Drawing.alone(
                "responses",
                "The table's response",
                "Models of the previous and of the active calibration.",
                lambda _: figures.responses(previous, calibrations),
            )
        )
    looks = history.looks
    modes = [_modes_drawing(looks)] if outcome.verdicts else []
    return Contents(
        _OUTCOMES[outcome.kind],
        [
            fact(**outcome.summary(), assumed=list(assumed)),
            fact("Rig", f"{rig}, {outcome.when:%Y-%m-%d %H:%M} UTC"),
            fact("History", str(history.folder)),
            fact("Active", outcome.active.name),
            fact("Report", str(report or ""), report=report),
        ],
        tables,
        [*outcome.sentences, *told],
        simulated=outcome.simulated,
        rig=rig,
        figures=[*(drawings if outcome.before else []), *modes],
    )


_OF_BUTTON = (
    "Button", "Error before", "Error after", "At most", "Outside before", "Outside after",
    "Correlation before", "Correlation after", "Verdict",
)  # fmt: skip
_ERROR = (
    "Error is the root-mean-square difference between the whole measured motion and the target acceleration "
    "over the target's; outside is the motion outside the drive's band. Before: the old drive on the table "
    "as it was found. After: the new drive."
)
_OF_PLACE = (
    "Place", "Resonance calibrated", "Found", "Damping calibrated", "Found", "Gain", "Coherence", "Verdict",
)  # fmt: skip


def _button_row(name: str, outcome: Outcome, after: Mapping[str, Check]) -> Sequence[str | Cell]:
    both = (outcome.before.get(name), after.get(name))
    # On an unchanged table, the old drive is the one that is judged.
    judged = both[outcome.kind != "unchanged"]
    errors = ["not measured" if c is None else c.whole.brief for c in both]
    outside = ["-" if c is None else c.outside.brief for c in both]
    correlations = ["-" if c is None else fixed(c.correlation, 4) for c in both]
    tolerance = "-" if judged is None else percent(judged.tolerance, 0)
    verdict = Cell("not made", "doubtful") if judged is None else verdict_cell(judged.verdict)
    return (name, *errors, tolerance, *outside, *correlations, verdict)


def _places(outcome: Outcome) -> Grid:
    rows = []
    for one in outcome.verdicts:
        was, now = one.before, one.now
        found = [*4 * ["not measured"]]
        if now is not None:
            found = [
                fixed(now.resonance_hz, 2, "Hz"),
                percent(now.damping, 2),
                fixed(now.gain / was.gain, 3, "times"),
                fixed(now.coherence, 4),
            ]
        hz, ratio, *others = found
        place = f"Patch {one.patch} at {one.point}"
        before = fixed(was.resonance_hz, 2, "Hz")
        rows.append((place, before, hz, percent(was.damping, 2), ratio, *others, one.kind))
    return Grid("Places", _OF_PLACE, rows)


def simulated(history: History) -> bool:
    """True when anything in a history was measured on a simulated rig."""
    latest = history.generations[-1:]
    return any(c.response.simulated for generation in latest for c in calibrations_of(generation))


def _place(calibration: Calibration) -> Place:
    return calibration.response.patch, calibration.response.point
