"""Test whether the active calibration still holds; if the table has drifted, remake every digital button.

Unattended: a quick response at each place and a verdict; where nothing seems to have changed, one button
is played and checked nevertheless; and then nothing, or new calibrations, drives and checks, which become
active all together or not at all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from typing import cast

import numpy as np

from ...base.errors import DataError, InstrumentError, LimitError
from ...base.progress import Progress, prefixed, silent
from ...instruments import Rig
from ...instruments.operator import LiftFinger
from .. import sizes
from ..drive import Check, DigitalButton, Drive, Method, build_button, check
from ..model import Calibration, calibrate_keeping
from ..response import Waveforms
from .adoption import (
    Kind,
    Outcome,
    buttons_of,
    calibrations_of,
    disturbed_in_check,
    note_outcome,
    parts,
    refuse_other,
)
from .common_factor import common_factors, factors_since
from .drift import compare
from .history import Generation, History
from .look import Look, Place, look_at, place_of, places_of, touched_since
from .overlay import TAKE_AWAY, told_touched
from .sensor_health import laser_at_rest

_RECENT = 9
"""Looks whose median noise is the laser's usual noise."""
_LEFT = 1.0
"""Time (s) for which a table rests after somebody has taken a hand away."""
_FREE = "Somebody confirmed that nothing rests on the table, so that the dampings count as a drift."
_NONE_PLAYED = (
    "No button was played, because each needs the laser at a point that it was not aimed at: whether they "
    "are right takes somebody to aim it (--attended)."
)
_PLAYS_BEFORE = 4
"""Plays of each old drive on the drifted table, enough to measure its error."""


def recalibrate(
    rig: Rig,
    history: History,
    *,
    actor: str = "haploop recalibrate",
    when: datetime | None = None,
    iterations: int = 3,
    progress: Progress = silent,
) -> Outcome:
    """Test whether the active calibration of a rig still holds, and restore a drifted one.

    Every look is noted in the history. A new generation is activated only if every one of its buttons
    passed its check on the table as it is. Nothing waits for an absent person: a point that the operator
    does not aim at is reported as not measured.

    Raises DataError for a history without a whole active calibration or one that cannot be written,
    ConfigurationError for another rig's and for a disk without room for what may be made, before anything is
    played; InstrumentError when another program recalibrates or the safe state was not confirmed. An
    instrument that fails otherwise is an outcome: broken.

    For example:

        >>> haploop.recalibrate(rig, haploop.History("lab-calibrations")).kind
        'unchanged'
    """
    when = when or datetime.now(UTC)
    with history.hold(_size(history.active(), iterations)):
        active = history.active()
        calibrations, buttons = calibrations_of(active), buttons_of(active)
        refuse_other(rig.name, rig.simulated, active, calibrations)
        usual = _usual_noise(history)
        look = look_at(rig, calibrations, _drives(buttons), usual, progress)
        free = False
        if look.touched and look.kind != "broken" and rig.operator.confirm(LiftFinger()):
            free = True
            rig.clock.sleep(_LEFT)
            look = look_at(rig, calibrations, _drives(buttons), usual, progress)
        outcome = Outcome(look.kind, when, active, look.verdicts, look.sentences, simulated=rig.simulated)
        if look.touched:
            outcome = _with(outcome, *told_touched(look.verdicts), *([_FREE] if free else []))
        disturbed = look.disturbances(usual)
        drives = [button.drive for button in buttons.values()]
        hidden = bool(disturbed and look.laser and any(look.laser.hides(drive) for drive in drives))
        outcome = _with(outcome, *disturbed)
        limits, since = rig.file.recalibration, factors_since(history, active)
        gained = common_factors(look.verdicts, since, limits.factor)
        far = bool(common_factors(look.verdicts, since, limits.gain))
        if outcome.kind == "unchanged" and not far:
            if turn := _turn(history, active, buttons, look):
                hides = bool(disturbed and look.laser and look.laser.hides(buttons[turn].drive))
                outcome = _played(rig, outcome, (turn, buttons[turn]), hides, progress)
            else:
                outcome = _with(outcome, _NONE_PLAYED)
        if gained and outcome.kind != "broken":
            kind = "broken" if far or outcome.kind in ("drifted", "not shown") else outcome.kind
            outcome = _with(replace(outcome, kind=kind), *gained)
        elif outcome.kind == "drifted":
            if hindered := _hindrance(look, active, free, hidden):
                kind, told = hindered
                outcome = _with(replace(outcome, kind=kind), told)
            else:
                anew = _made_anew(rig, buttons, outcome.before, iterations, progress)
                anew.free = free
                outcome = _judged(rig, history, outcome, calibrations, anew)
                if outcome.kind == "restored":
                    outcome = _activated(rig, history, outcome, anew, actor)
        note_outcome(history, active, outcome, look)
    return outcome


def _hindrance(look: Look, active: Generation, free: bool, hidden: bool) -> tuple[Kind, str] | None:
    """Why nothing can be made anew on a table that has drifted: what the outcome is then, and a sentence."""
    if look.touched and not free:
        return "touched", f"Nothing was changed: {active.name} stays the active one. {TAKE_AWAY}"
    if look.unmeasured:
        return "drifted", (
            "Nothing was changed, because a button at a point that was not measured cannot be made anew: "
            "run it with somebody there to aim the laser (--attended)."
        )
    if hidden:
        return "broken", (
            "The laser's signal is too disturbed to tell whether the buttons are right. Nothing was made "
            f"anew: {active.name} stays the active one."
        )
    return None


def _size(active: Generation, iterations: int) -> int:
    """Room (bytes) for a generation in the place of `active`."""
    each = sizes.CHECK + sizes.of_button(iterations)
    places = len(active.paths("calibrations")) * (sizes.CALIBRATION + sizes.WAVEFORMS)
    return places + len(active.paths("buttons")) * each


def _drives(buttons: Mapping[str, DigitalButton]) -> dict[Place, dict[str, Drive]]:
    """The drives at each place, by button."""
    drives: dict[Place, dict[str, Drive]] = {}
    for name, button in buttons.items():
        for patch in button.drive.patches:
            drives.setdefault((patch, button.drive.point), {})[name] = button.drive
    return drives


def _turn(history: History, active: Generation, buttons: Mapping[str, DigitalButton], look: Look) -> str:
    """The button to play: of those played least often in this generation's looks, the one with least margin.

    So every button has its turn, and the one that is closest to its tolerance is the first of each round.
    Empty when the laser was not at all points of any button.
    """
    looks = [entry for entry in history.looks if entry["compared_with"] == active.name]
    times = {name: sum(name in entry["played"] for entry in looks) for name in buttons}
    here = [name for name, b in buttons.items() if look.measured.issuperset(places_of(b.drive))]
    return min(here, key=lambda name: (times[name], _margin(buttons[name].check)), default="")


def _margin(check: Check) -> float:
    return check.tolerance - check.error


def _played(
    rig: Rig, outcome: Outcome, turn: tuple[str, DigitalButton], hidden: bool, progress: Progress
) -> Outcome:
    """The outcome after a check of one button on a table that seems unchanged.

    `hidden`: the laser is so disturbed that it would hide whether the button is right.
    """
    name, button = turn
    told = f"The button {name} was played, whose turn it was with a margin of {_margin(button.check):.1%}"
    try:
        found = check(rig, button.drive, progress=prefixed(progress, name))
    except (InstrumentError, LimitError) as error:
        rig.make_safe()
        return _with(replace(outcome, kind="broken"), f"{name}: {error}")
    outcome = replace(outcome, before={name: found})
    if found.passed:
        return _with(outcome, f"{told}: its error is {found.whole.brief}, and it passes.")
    reasons = " ".join(found.reasons)
    if found.verdict == "not shown" and not hidden:
        return _with(
            replace(outcome, kind="not shown"),
            f"{told}. The response is as it was, and whether the button is right cannot be told. {reasons}",
        )
    if hidden:
        return _with(
            replace(outcome, kind="broken"),
            f"{told}, and it does not pass: {reasons} The response is as it was, and the laser is disturbed.",
        )
    return _with(
        replace(outcome, kind="drifted"),
        f"{told}, and it does not pass although the response is as it was: {reasons}",
    )


@dataclass
class _Anew:
    """Everything that was made anew on a drifted table."""

    before: dict[str, Check]
    after: dict[str, DigitalButton] = field(default_factory=dict)
    calibrations: dict[Place, Calibration] = field(default_factory=dict)
    waveforms: dict[Place, Waveforms] = field(default_factory=dict)
    failed: list[str] = field(default_factory=list)
    """Sentences on what did not come out as it has to."""
    free: bool = False
    """Somebody has confirmed that nothing rests on the table."""
    touched: list[str] = field(default_factory=list)
    """Sentences on what came to rest on the table, or left it, while buttons were made."""
    broken: str = ""
    """Sentence on the instrument that failed; the rest was not made then."""
    without: list[str] = field(default_factory=list)
    """Sentences on drives for a finger, which take that person to be made anew."""


def _made_anew(
    rig: Rig,
    buttons: Mapping[str, DigitalButton],
    before: Mapping[str, Check],
    iterations: int,
    progress: Progress,
) -> _Anew:
    """Check each old drive, calibrate each place, with its hysteresis, and compute and learn each drive."""
    made = _Anew(dict(before))
    for name, old in buttons.items():
        places = places_of(old.drive)
        try:
            if name not in made.before:
                old_drive = prefixed(progress, f"{name}, old drive")
                made.before[name] = check(
                    rig, old.drive, plays=_PLAYS_BEFORE, most=_PLAYS_BEFORE, progress=old_drive
                )
            for place in places:
                if place not in made.calibrations:
                    found, kept = calibrate_keeping(rig, *place, progress)
                    # How its channel scatters takes several calibrations to tell; a person chose a carrier.
                    known = next((c for c in old.calibrations if place_of(c) == place), found)
                    found = replace(found, scatter=known.scatter, chosen_hz=known.chosen_hz)
                    made.calibrations[place] = found
                    made.waveforms[place] = replace(kept, calibration=found.digest)
            made.after[name] = build_button(
                rig,
                old.press,
                [made.calibrations[place] for place in places],
                method=cast(Method, old.drive.method),
                trade=old.drive.trade,
                elsewhere=old.elsewhere,
                iterations=iterations,
                progress=prefixed(progress, name),
            )
            made.touched += touched_since(rig, made.calibrations[places[-1]], prefixed(progress, name))
        except (DataError, LimitError) as error:
            made.failed.append(f"{name}: {error}")
        except InstrumentError as error:
            rig.make_safe()
            made.broken = f"{name}: {error}"
            return made
        else:
            made.failed += [f"{name}: {reason}" for reason in made.after[name].check.reasons]
            if old.pressed:
                made.without.append(
                    f"{name} has no drives for {old.pressed.participant}'s finger now: make them again "
                    "(haploop calibrate-finger, button under)."
                )
    return made


def _judged(
    rig: Rig, history: History, found: Outcome, calibrations: Sequence[Calibration], anew: _Anew
) -> Outcome:
    """Restored, if all that was made anew may be activated; else the reasons why the active ones stay."""
    found = replace(found, before=anew.before, after=anew.after)
    if anew.broken:
        return _with(replace(found, kind="broken"), anew.broken)
    # Whoever moved the laser since the look must not be adopted either.
    old = {place_of(c): c for c in calibrations}
    again = [compare(old[place], c.response, {}, c.hysteresis) for place, c in anew.calibrations.items()]
    factors = common_factors(again, factors_since(history, found.active), rig.file.recalibration.factor)
    failed = (*anew.failed, *factors)
    disturbed = _disturbed_since(rig, anew.after, _usual_noise(history))
    # Whatever came to rest on the table since the look is in the new calibrations, or in the drives.
    touched = (*(() if anew.free else told_touched(again)), *anew.touched)
    if failed or disturbed or touched:
        kind: Kind = "broken" if disturbed else "touched" if touched else found.kind
        told = (*failed, *disturbed, *touched, *([TAKE_AWAY] if touched else []))
        kept_active = f"Nothing was changed: {found.active.name} stays the active one."
        return _with(replace(found, kind=kind), *told, kept_active)
    # A calibration without a button of its own has nothing to be checked with, and is kept.
    anew.calibrations = old | anew.calibrations
    return replace(found, kind="restored")


def _activated(rig: Rig, history: History, found: Outcome, anew: _Anew, actor: str) -> Outcome:
    """Add what was made anew to the history, and activate it."""
    reason = " ".join(found.sentences)
    generation = history.add(
        parts(anew.calibrations.values(), anew.after, anew.before)
        | {f"waveforms/{'-'.join(place)}.h5": waveforms for place, waveforms in anew.waveforms.items()},
        when=found.when,
        reason=reason,
        details=replace(found, kind="drifted").summary(),
        parent=found.active.name,
    )
    # Log first: an activation that is not in the audit log must not happen.
    rig.audit.note("activated", calibration=generation.name, reason=reason)
    history.activate(generation, when=found.when, actor=actor, reason=reason)
    return _with(
        replace(found, active=generation),
        f"Every button was made anew and passed; {generation.name} is the active calibration now.",
        *anew.without,
    )


def _disturbed_since(rig: Rig, after: Mapping[str, DigitalButton], usual: float | None) -> tuple[str, ...]:
    """Sentences on what disturbed the laser while buttons were made anew, or does so now, and matters."""
    told = disturbed_in_check(after)
    laser = laser_at_rest(rig)
    if any(laser.hides(button.drive) for button in after.values()):
        told += laser.disturbances(usual)
    return tuple(told)


def _with(outcome: Outcome, *sentences: str) -> Outcome:
    return replace(outcome, sentences=(*outcome.sentences, *sentences))


def _usual_noise(history: History) -> float | None:
    """The laser's median noise at rest in the latest looks without a fault."""
    noises = [float(look["laser_noise"]) for look in history.looks if look["outcome"] != "broken"]
    return float(np.median(noises[-_RECENT:])) if noises else None
