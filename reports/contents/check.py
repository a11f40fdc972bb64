"""What a check and a digital button say."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import zip_longest
from pathlib import Path

import numpy as np

from ...acquisition import Representative
from ...calibration import Check, DigitalButton, Feeling, check_feeling
from ...calibration.drive import OtherPoint
from .. import figures
from . import words
from .calibration import drive_drawing, drive_facts, response_drawing
from .feeling import feeling_facts, loudness
from .glance import Glance, check_glance
from .parts import Contents, Drawing, Fact, Verdict, detailed, fact, verdict_cell
from .press import press_drawing
from .words import percent, sentence


def check_contents(check: Check, press: Representative | None = None, file: Path | None = None) -> Contents:
    """What a check says.

    `press`, the recorded one, adds how loud the motion is against it, and figures of both; `file` is where
    the plays are kept.
    """
    drive, feeling = check.drive, check_feeling(check, press)
    facts = [
        fact(**check.summary()),
        *_check_facts(check, feeling),
        *drive_facts(drive),
        fact("Every play is kept in", str(file), file=file) if file else fact(),
    ]
    return Contents(
        f"Check of the {drive.button} button, {check.plays} plays",
        facts,
        kind="check",
        simulated=check.simulated,
        rig=drive.rig,
        verdicts=[_verdict(f"Check of the {drive.button} button", check, feeling), *_others(check)],
        figures=[
            _check_drawing("check", check),
            *([_motion_drawing(press, check), _feeling_drawing(check, feeling)] if press else []),
            *_other_drawings(check),
        ],
        glances=_glances(check, feeling, press),
    )


def _glances(
    check: Check, feeling: Feeling, press: Representative | None, others: Sequence[Representative] = ()
) -> list[Callable[[], Glance]]:
    """Of the button, and of each that another point plays at the same time; `others` are their presses."""
    beside = [(one, check_feeling(one, own), own) for one, own in zip_longest(check.others, others)]
    return [partial(check_glance, *one) for one in [(check, feeling, press), *beside]]


def _check_drawing(name: str, check: Check, there: str = "") -> Drawing:
    return Drawing.alone(
        name,
        f"Check of the {check.drive.button} button{there}: {check.verdict}",
        words.CHECK,
        lambda columns: figures.check_figure(check, columns),
        f"n = {check.plays} plays.",
    )


def _other_drawings(check: Check) -> Iterator[Drawing]:
    """A figure of each button that another point plays at the same time."""
    for other in check.others:
        point = other.drive.point
        yield _check_drawing(f"check-{point}", other, f" at the {point} point")


def _others(check: Check, presses: Sequence[Representative] = ()) -> Iterator[Verdict]:
    """The verdict on each button that another point plays at the same time; `presses` are theirs."""
    for other, press in zip_longest(check.others, presses):
        title = f"The {other.drive.button} button at the {other.drive.point} point"
        yield _verdict(title, other, check_feeling(other, press))


def button_contents(button: DigitalButton) -> Contents:
    """What a digital button says: its check, its drive, and what they were made from."""
    press, drive, check, learning = button.press, button.drive, button.check, button.learning
    feeling, kept = check_feeling(check, press), sum(one.kept for one in learning.iterations[1:])
    tried = [
        f"{number}: in band {', '.join(power.brief for power in one.each_within)}, "
        f"{'kept' if one.kept else 'not kept'}: {one.reason}"
        for number, one in enumerate(learning.iterations)
    ]
    facts = [
        fact(passed=button.passed, check=check.summary()),
        fact(
            "Made",
            f"{button.created} on {drive.rig}, patch {drive.patch} at the {drive.point} point",
            created=button.created,
            software=button.made_with,
            rig=drive.rig,
            point=drive.point,
        ),
        *_check_facts(check, feeling, button.others),
        *drive_facts(drive),
        fact("Corrections", f"{len(tried) - 1} tried, {kept} kept. {learning.stopped}"),
        *_under_a_finger(button),
        *detailed(_origins(button, tried)),
    ]
    title = f"Digital {press.button} button"
    return Contents(
        f"{title}, {verdict_cell(button.verdict).text}",
        facts,
        kind="button",
        simulated=button.simulated,
        rig=drive.rig,
        verdicts=[
            _verdict(title, check, feeling),
            *_others(check, button.others),
            *_pressed_verdicts(button),
        ],
        figures=_figures_of(button, feeling),
        glances=_glances(check, feeling, press, button.others),
        picture=Drawing.alone(
            f"button-{press.button}",
            title,
            words.LEARNING,
            lambda columns: figures.button_figure(button, columns),
            _plays([check]),
        ),
    )


def _pressed_verdicts(button: DigitalButton) -> Iterator[Verdict]:
    """The verdict on each drive for a finger."""
    if button.pressed is None:
        return
    for force, one in zip(button.pressed.forces, button.pressed_checks, strict=True):
        subject = f"Under {button.pressed.participant}'s finger, {force:.3g} N"
        yield _verdict(subject, one, check_feeling(one, button.press))


def _under_a_finger(button: DigitalButton) -> list[Fact]:
    """The drives for a finger, and what their checks say; nothing for a button of the bare table."""
    if button.pressed is None:
        return []
    each = [
        f"{force:.3g} N: {one.verdict}, error {one.whole.said}"
        for force, one in zip(button.pressed.forces, button.pressed_checks, strict=True)
    ]
    return [
        fact(
            f"Under {button.pressed.participant}'s finger",
            each,
            finger=button.pressed.participant,
            finger_forces=list(button.pressed.forces),
            finger_checks=[one.summary() for one in button.pressed_checks],
        )
    ]


def _origins(button: DigitalButton, tried: Sequence[str]) -> list[Fact]:
    """Each correction, and what a button was made from."""
    learning, drive = button.learning, button.drive
    calibrated = max(one.response.created for one in button.calibrations)
    recordings = [*drive.sources, *(source for one in drive.elsewhere for source in one.sources)]
    return [
        fact(
            "Learning",
            tried,
            iterations=[
                {
                    "whole": one.whole.summary(),
                    "within": one.within.summary(),
                    "kept": one.kept,
                    "reason": one.reason,
                }
                for one in learning.iterations
            ],
            best=learning.best,
            stopped=learning.stopped,
        ),
        fact(
            "Calibration",
            f"{calibrated}, SHA-256 {drive.calibration}",
            calibrated=calibrated,
            calibration_sha256=drive.calibration,
        ),
        fact(
            "Recordings",
            [f"{name}, SHA-256 {content}" for name, content in recordings],
            sources=[{"file": name, "sha256": content} for name, content in recordings],
        ),
        fact("Content", f"SHA-256 {button.digest}", content_sha256=button.digest),
    ]


def _figures_of(button: DigitalButton, feeling: Feeling) -> Sequence[Drawing]:
    press, check, learning = button.press, button.check, button.learning
    return [
        press_drawing(press),
        *(response_drawing(one) for one in button.calibrations),
        drive_drawing(button.drive),
        _motion_drawing(press, check),
        _feeling_drawing(check, feeling),
        Drawing.alone(
            f"button-{press.button}",
            f"Digital {press.button} button: {check.verdict}",
            words.ITERATIONS,
            lambda columns: figures.iterations_figure(button, columns),
            f"n = {check.plays} plays, {len(learning.iterations) - 1} corrections.",
        ),
        *_other_drawings(check),
    ]


def _motion_drawing(press: Representative, check: Check) -> Drawing:
    return Drawing(
        "motion",
        "Measured motion of the surface",
        words.COMPARISON,
        [(press, check)],
        lambda some, columns: figures.comparison(some, columns),  # noqa: PLW0108 - loads matplotlib
        lambda some: _plays([one for _, one in some]),
    )


def _feeling_drawing(check: Check, feeling: Feeling) -> Drawing:
    return Drawing(
        "feeling",
        "What a finger would feel",
        words.FEELING,
        [(check, feeling)],
        lambda some, columns: figures.feeling_figure(
            [(one.drive.button, felt) for one, felt in some], columns
        ),
        lambda some: _plays([one for one, _ in some]),
    )


def _plays(checks: Sequence[Check]) -> str:
    return sentence([f"{one.drive.button}, n = {one.plays} plays" for one in checks])


def _check_facts(check: Check, feeling: Feeling, presses: Sequence[Representative] = ()) -> Iterator[Fact]:
    """The verdict with its reasons, the errors that it is of, and what a finger would feel."""
    low, high = check.drive.band
    yield fact("Verdict", [verdict_cell(check.verdict), *check.reasons, *check.notes])
    yield fact(
        f"Error up to {check.judged_hz:.0f} Hz",
        f"{check.whole.said}, {percent(check.tolerance)} accepted, in {check.plays} plays",
    )
    yield from silence_facts(check)
    yield from other_facts(check, presses)
    yield from crosstalk_facts(check)
    envelopes = f"of the envelopes {check.envelope_correlation:.4f}"
    noise = f"{percent(check.whole.floor)}, within the band {percent(check.within.floor)}"
    yield from detailed(
        [
            fact(f"Within {low:.0f} to {high:.0f} Hz", check.within.said),
            fact("Motion outside, of the target", check.outside.said),
            fact("Correlation", f"{check.correlation:.4f}, {envelopes}"),
            fact("Third octaves", f"{check.octaves.error_db:.2f} dB"),
            fact("Noise of the plays' mean", noise),
        ]
    )
    yield from feeling_facts(feeling)


def silence_facts(check: Check) -> Iterator[Fact]:
    """By how much the points that are to be silent are."""
    planned = {one.point: one for one in check.drive.elsewhere}
    for silence in check.silent:
        still, drifted = planned[silence.point].expected
        yield fact(
            f"Silence at point {silence.point}",
            f"{_contrast(silence.contrast_db)}; {_below(still)} dB were expected, "
            f"{_below(drifted)} dB after a drift{_known(planned[silence.point])}",
        )


def other_facts(check: Check, presses: Sequence[Representative]) -> Iterator[Fact]:
    """What became of each button that another point plays at the same time, of `presses`: the verdict, the
    error, who feels it, and how much of the press it is.
    """
    planned = {one.point: one for one in check.drive.elsewhere}
    for other, press in zip_longest(check.others, presses):
        felt = check_feeling(other, press)
        one = planned[other.drive.point]
        expected = " and ".join(percent(error) for error in one.expected)
        yield fact(
            f"{one.button} at point {one.point}",
            [
                verdict_cell(other.verdict),
                f"error {other.whole.said}; {expected} were expected, as calibrated and after a drift"
                f"{_known(one)}",
                felt.sentence,
                ", ".join(filter(None, (_played(other), loudness(felt)))),
            ],
        )


def crosstalk_facts(check: Check) -> Iterator[Fact]:
    """How much of each button moves the point of another."""
    for seen in (check, *check.others) if check.others else ():
        for point, level in seen.crosstalk_db:
            yield fact(
                f"Crosstalk at the {seen.drive.point} point",
                f"at most {level:.0f} dB of the button at the {point} point",
            )


def _contrast(level: float) -> str:
    return f"{level:.0f} dB below the target" if math.isfinite(level) else "not known"


def _known(one: OtherPoint) -> str:
    """How well the responses of a point are known."""
    return f"; the point is known to {percent(one.known_to)} ({one.known_from})"


def _below(motion: float) -> str:
    return f"{-20 * np.log10(max(motion, 1e-6)):.0f}"


def _verdict(subject: str, check: Check, feeling: Feeling) -> Verdict:
    """Is it like the recorded press, can it be felt, how loud is it, and how much of the press is it?"""
    return Verdict(
        subject,
        check.verdict,
        check.passed,
        f"error {check.whole.said}, {percent(check.tolerance, 0)} accepted, {check.plays} plays",
        " ".join((*check.reasons, *check.notes)),
        (feeling.sentence.removesuffix("."), ", ".join(filter(None, (_played(check), loudness(feeling))))),
    )


def _played(check: Check) -> str:
    """How much of the press is played."""
    drive = check.drive
    return f"plays {percent(drive.in_band)} of the press's energy, at {drive.scale:.3f} of its size"
