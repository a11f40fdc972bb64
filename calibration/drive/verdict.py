"""The verdict of a check: the reasons for not passing, and what else the plays show."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from ...base.wording import capital, error_said
from ..perception import levels_of, sensations_of
from .agreement import SharedPower, plays_needed
from .checked import Check, Silence, Verdict, hertz

LEAST_IN_BAND = 0.25
"""Smallest share of the modulated press's energy in the drive's band: matching less is no match."""
LEAST_MOVED = 0.3
"""Share of the target in the measured motion, below which the surface counts as not following the drive."""
UNSEEN = "the patch is not connected, or the laser does not see the surface"
_EXCESS = 1.02
"""Measured volts over the limit that are attributed to the monitor's gain error."""
_STRAY = 5.0
"""Deviations of the monitor's noise at rest that the largest of a million samples is off by."""
_LOUD = 0.05
"""Largest share of the limit that is attributed to that noise: an amplifier that oscillates is no noise."""
_ARRIVES = 0.8
"""Share of a patch's volts that have to be measured at it."""
_FACTOR = 0.05
"""Distance of a factor over the whole motion from one, from which it is told."""
_CONFIDENT = "95 % confidence: "
_WORSE: tuple[Verdict, ...] = ("pass", "not shown", "fail")
_CONTRADICTS = 2.0
"""Ratio of a predicted error and an end of the measured one's interval, from which they contradict each
other (estimate)."""
_AMPLE = 0.05
"""Error from which one that was not expected is told."""
_PASSES_MORE = (
    "measure with a vibrometer or a filter that passes more, or play the button at another point or with "
    "another patch."
)
_TOLD = 0.05
"""Share of the target from which tones that were taken out are told."""


@dataclass(frozen=True)
class Signs:
    """What tells, beside the errors, whether the plays can be believed."""

    followed: tuple[float, float]
    """Share of the target in the motion, and the standard error of that."""
    odd: tuple[int, float]
    """Number of the play that differs from all others (0: none), and by how much, over the target."""
    dependent: str
    """Evidence that noise is not independent from play to play; empty if there is none."""
    overload: str | None
    """Sentence about a signal that left its range."""
    limit: float
    """The rig's largest voltage (V)."""
    monitor_noise: float = 0.0
    """Standard deviation (V) of what the monitor shows at rest."""
    volts: tuple[tuple[str, float, float], ...] = ()
    """Of each patch its name, the largest volts that were measured at it, and those of the drive."""


def judged(result: Check, signs: Signs) -> Check:
    """The check with its verdict, reasons and notes."""
    notes = _notes(result, signs)
    if failures := _failures(result, signs):
        return replace(result, verdict="fail", reasons=tuple(failures), notes=notes)
    if doubt := _doubt(result, signs):
        return replace(result, verdict="not shown", reasons=(f"Not shown: {doubt}",), notes=notes)
    return replace(result, verdict="pass", notes=notes)


def undecided(result: Check) -> bool:
    """True for a verdict of not shown that nothing but the number of plays stands against."""
    low, high = result.interval
    if result.verdict != "not shown" or low > result.tolerance or not high > result.allowed:
        return False
    # What more plays would not lessen.
    stays = (result.above.bound or 0.0) ** 2
    if high <= result.tolerance:
        stays += result.drive.hidden[0] ** 2 + max(result.whole.value, 0.0)
    return bool(stays < result.tolerance**2)


def worst(verdicts: Iterable[Verdict]) -> Verdict:
    """The worst of verdicts."""
    return max(verdicts, key=_WORSE.index)


def all_judged(result: Check) -> Check:
    """The check with the worst verdict of all its buttons and silent points, and the reasons of each."""
    verdict, reasons = result.verdict, list(result.reasons)
    for other in result.others:
        named = f"The {other.drive.button} button at the {other.drive.point} point"
        reasons += [f"{named}: {reason}" for reason in other.reasons]
        verdict = worst((verdict, other.verdict))
    for silence in result.silent:
        own, reason = _of_silence(silence, result.tolerance)
        reasons += [reason] if reason else []
        verdict = worst((verdict, own))
    return replace(result, verdict=verdict, reasons=tuple(reasons))


def _of_silence(silence: Silence, tolerance: float) -> tuple[Verdict, str]:
    """The verdict on a point that is to be silent, and why it is not silent.

    Its motion is an error as any other, over the target of the drive's own point.
    """
    named = f"the {silence.point} point, which is to be silent,"
    if silence.unseen:
        return "fail", f"Nothing is known of {named[:-1]}. {silence.unseen}"
    if not silence.motion.possible:
        return "not shown", (
            f"Not shown: something periodic disturbs the laser at {named} in step with the plays (mains, a "
            "fan, a motor): stop it, and check again."
        )
    low, high = silence.motion.interval
    moves = f"{named} moves by {error_said(silence.motion.root, (low, high), _CONFIDENT)} of the target"
    if low > tolerance:
        return "fail", f"{capital(moves)}, and {tolerance:.0%} is accepted."
    if high > tolerance:
        return "not shown", (
            f"Not shown: {moves}, which does not tell on which side of the accepted {tolerance:.0%} it lies."
        )
    return "pass", ""


def _said(result: Check) -> str:
    """How far the motion differs from the target."""
    if not np.isfinite(result.error):
        return "an rms that is not known"
    return f"an rms of {error_said(result.error, result.interval, _CONFIDENT)}"


def _failures(result: Check, signs: Signs) -> list[str]:
    """Reasons to fail the check; none if it passes, or shows nothing."""
    drive, failures = result.drive, []
    if signs.overload:
        failures.append(signs.overload)
    noise = min(_STRAY * signs.monitor_noise, _LOUD * signs.limit)
    if result.drive_measured_peak > _EXCESS * signs.limit + noise:
        failures.append(
            f"The patch got {result.drive_measured_peak:.1f} V, and the rig's limit is {signs.limit:.1f} V."
        )
    for patch, got, planned in signs.volts:
        if got < _ARRIVES * planned:
            who = "The patch" if len(signs.volts) == 1 else f"Patch {patch}"
            failures.append(
                f"{who} got {got:.2g} V where the drive has {planned:.1f} V: check the amplifier, the relay "
                "and the drive monitor."
            )
    low_hz, high_hz = drive.band
    # Written so that NaN fails too.
    if not signs.dependent and not result.interval[0] <= result.tolerance:
        failures.append(
            f"The motion of the surface up to {hertz(result.judged_hz)} differs from the target by "
            f"{_said(result)}, and "
            f"{result.tolerance:.0%} is accepted: {result.within.brief} within {low_hz:.0f} to "
            f"{high_hz:.0f} Hz, and {result.outside.brief} outside."
        )
    if not drive.in_band >= LEAST_IN_BAND:
        failures.append(
            f"Only {drive.in_band:.1%} of the press's energy lies in the {low_hz:.0f} to "
            f"{high_hz:.0f} Hz that were played, and {LEAST_IN_BAND:.0%} is needed."
        )
    felt = sensations_of(levels_of(result.accelerations, result.rate_hz), result.lab)[0]
    if felt.nobody:
        failures.append(f"{felt.sentence()} What nobody can feel is no button.")
    if failures and signs.followed[0] < LEAST_MOVED:
        failures.append(f"The surface followed {signs.followed[0]:.1%} of the target motion: {UNSEEN}.")
    elif failures and drive.predicted_error > result.tolerance:
        failures.append(
            f"The error predicted when the drive was computed is {drive.predicted_error:.1%}: within the "
            "limits, and with this calibration, the table cannot follow the press."
        )
    return failures


def _doubt(result: Check, signs: Signs) -> str:
    """What the plays leave open; empty if the error lies within the tolerance."""
    number, by = signs.odd
    if by > result.tolerance:
        return f"play {number} is not of the same motion as the others; check again."
    if signs.dependent:
        return (
            f"{signs.dependent}, which independent noise does not do. Something periodic disturbs the "
            "laser in step with the plays (mains, a fan, a motor): stop it, and check again."
        )
    if result.interval[1] > result.allowed:
        return (
            f"the motion up to {hertz(result.judged_hz)} differs from the target by {_said(result)}, "
            f"{_bounded(result)}which does not tell on which side of the accepted {result.tolerance:.0%} it "
            f"lies. {_remedy(result)}"
        )
    return _beyond(result) or (_contradiction(result) if _unlike_plan(result) else "")


def _bounded(result: Check) -> str:
    """What may lie above the band that is judged, as a part of a sentence; empty where nothing is said."""
    said = ""
    if result.above.bound is not None:
        said = f"and above, where noise hides it, by at most {result.above.bound:.1%} as calibrated, "
    if _hinges_on_hidden(result):
        said += (
            f"and near {hertz(result.drive.hidden[2])}, above what the laser passes, by up to "
            f"{result.hidden:.1%}, "
        )
    return said


def _hinges_on_hidden(result: Check) -> bool:
    """True where the check would pass if nothing moved above what the laser passes, and where that is all."""
    alone = np.hypot(result.interval[1], result.above.bound or 0.0) <= result.tolerance
    return bool(alone or result.hidden >= result.tolerance)


def _remedy(result: Check) -> str:
    """A sentence on what would tell on which side of the tolerance the error lies."""
    needed = plays_needed(result.whole, result.allowed) if result.allowed else None
    if needed:
        return f"{needed} plays would probably show it."
    if _hinges_on_hidden(result):
        told = np.hypot(result.interval[1], result.drive.hidden[0]) <= result.tolerance
        return f"More plays would {'tell what moves there; otherwise' if told else 'not:'} {_PASSES_MORE}"
    less_noise = "use a range or filter of the vibrometer with less noise, or more output."
    if not result.allowed:  # as more is judged, less is left to a bound
        return f"More plays would be judged to a higher frequency. Without them, {less_noise}"
    return f"More plays would not: {less_noise}"


def _beyond(result: Check) -> str:
    """Evidence that the surface moves too much above the highest frequency that is judged, in a clause."""
    above, top = result.above, hertz(result.judged_hz)
    if above.motion is not None and result.whole.value + above.motion.value > result.tolerance**2:
        limit = "that it passes" if above.bound is None else "up to which is judged"
        return (
            f"the laser shows motion near {hertz(above.hz)}, above the {top} {limit} (or beyond the "
            f"card's sample rate, and folded down), which its filter lets through as {above.motion.root:.1%} "
            f"of the target: {_PASSES_MORE}"
        )
    octave = above.octave
    if (
        above.bound is None
        and octave.interval[0] > 0
        and result.whole.value + octave.value > result.tolerance**2
    ):
        return (
            f"{octave.root:.1%} of error lie between {hertz(result.judged_hz / 2)} and {top}, and if as much "
            f"lies in the octave above, which the laser does not pass, the motion differs by more than the "
            f"accepted {result.tolerance:.0%}: {_PASSES_MORE}"
        )
    return ""


def _unlike_plan(result: Check) -> bool:
    """True when more error was expected than is accepted, and the plays show much less."""
    return result.drive.predicted_error > max(result.tolerance, _CONTRADICTS * result.interval[1])


def _contradiction(result: Check) -> str:
    """A clause on a predicted error that the plays contradict; empty where they do not."""
    predicted = result.drive.predicted_error
    if not (_unlike_plan(result) or result.interval[0] > max(_AMPLE, _CONTRADICTS * predicted)):
        return ""
    return (
        f"{predicted:.1%} of error were expected when the drive was computed or learnt, and the plays show "
        f"{result.whole.said}: the table, the patch or the laser's aim has changed "
        "since, or the calibration is wrong; calibrate again, and compute the drive from that."
    )


def one_factor(whole: SharedPower, followed: tuple[float, float], least: float) -> str:
    """A sentence where most of the error is one factor, `least` from one or more; empty elsewhere.

    The squared error is that of the factor and that of all else, which is orthogonal to the target.
    """
    share, deviation = followed
    amiss = abs(share - 1)
    clear = share > LEAST_MOVED and amiss > max(least, 3 * deviation)
    if not (clear and amiss**2 > whole.value / 2):
        return ""
    left = float(np.sqrt(max(whole.value - amiss**2, 0.0)))
    return (
        f"The laser shows {share:.2f} times the target, and {left:.1%} of error beside that factor: its "
        "scale is wrong (its aim, range or settings), or the patch moves the table by another amount per "
        "volt than when it was calibrated."
    )


def _notes(result: Check, signs: Signs) -> tuple[str, ...]:
    notes = []
    number, by = signs.odd
    if factor := one_factor(result.whole, signs.followed, _FACTOR):
        notes.append(factor)
    if told := _contradiction(result):
        notes.append(f"Expected and measured error contradict each other: {told}")
    if result.above.bound is not None:
        notes.append(
            f"Judged is motion up to {hertz(result.judged_hz)}: above, the pick-up's noise leaves nothing "
            "to be told. By the drive's spectrum and the calibration, at most "
            f"{result.above.bound:.1%} of the target move there."
        )
    if result.tones.share > _TOLD:
        tones = ", ".join(f"{hz:.1f}" for hz in result.tones.hz)
        notes.append(
            f"The background has steady tones at {tones} Hz, {result.tones.share:.0%} of the target, which "
            "were measured before each play and taken out: look for mains hum (ground the laser's cable), a "
            "fan or a motor."
        )
    if number:
        notes.append(
            f"Play {number} of {result.plays} differs from all others by {by:.1%} of the target: something "
            "shook or touched the table, or the patch had not settled."
        )
    if result.drift > 0:
        notes.append(
            f"The motion changed by {result.drift:.1%} of the target from the first play to the last: the "
            "table or the patch had not settled, or its temperature changes."
        )
    octaves = result.octaves
    heard = octaves.target_db.max() + 20 * np.log10(result.tolerance)
    drowned = (octaves.floor_db > heard) & (octaves.hz > result.drive.band[1])
    if np.any(drowned):
        notes.append(
            f"Above {octaves.hz[drowned][0] / 10**0.05:.0f} Hz, the noise left in the mean of "
            f"{result.plays} plays exceeds {result.tolerance:.0%} of the target's strongest third octave: "
            "single tones there would not be seen; more plays, or a narrower filter of the vibrometer, "
            "resolve more."
        )
    return tuple(notes)
