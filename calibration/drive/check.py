"""The closed loop: play a drive, measure the motion of the surface, and compare it with the target."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ...base.arrays import ComplexArray, FloatArray
from ...base.errors import ConfigurationError
from ...base.filters import envelope
from ...base.progress import Progress, part_of, silent
from ...instruments import Rig
from .. import sizes
from ..perception import lab_threshold
from ..response import prepare, unseen
from ..spectra import third_octaves
from .agreement import (
    SharedPower,
    dependence,
    error_spectra,
    followed,
    lines_inside,
    odd_play,
    plays_needed,
    shared_power,
    told_by_noise,
    trend,
)
from .checked import Above, Check, Silence, ThirdOctaves, Tones
from .drive import Drive
from .playing import Played, joined, play, refuse_foreign, targets_of
from .verdict import Signs, all_judged, judged, undecided

if TYPE_CHECKING:
    from ...acquisition import Representative

TOLERANCE = 0.20
"""Largest error of the motion. About the just noticeable difference of vibration amplitude well above
threshold (docs/hardware.md, "Buttons and people")."""
_ROOM = TOLERANCE * 3**0.5 / 2
"""Error beside which one of half the tolerance is within it."""
_PLAYS = 8
"""Plays of a check that was asked for no other number."""
_LOWEST_OCTAVE = 20.0
"""Lowest third-octave band (Hz) that is shown; a play lasts about a second."""


def check(
    rig: Rig,
    drive: Drive,
    press: Representative | None = None,
    *,
    plays: int = _PLAYS,
    most: int | None = None,
    progress: Progress = silent,
) -> Check:
    """Play a drive `plays` times and compare the motion of the surface with the drive's target.

    Where those plays do not tell on which side of the tolerance the error lies, it is played on until there
    are as many as would, up to `most` (eight times as many if None). That is done once at each point, so that
    an error at the tolerance passes with a probability of at most 5 %.

    The laser visits the other points of the drive as well: each button is compared and judged, and the check
    passes if all do; of a silent point it is measured how much it moves.

    `press`, if given, must be the one that the drive was computed for: ConfigurationError
    otherwise. `progress` is called after each play. A signal that leaves its range, a dead
    patch or a blocked laser fails the check, with its reason. Raises ConfigurationError for fewer than
    three plays or a drive made for another rig or sample rate, and what `Rig.excite` raises.

    For example:

        >>> result = haploop.check(rig, haploop.load("drive.h5"), haploop.load("press.h5"))
        >>> result.save("check.h5")
        >>> result.verdict
        'pass'
    """
    if plays < 3:
        raise ConfigurationError("A check needs at least 3 plays: their differences are its uncertainty.")
    refuse_foreign(rig, drive)
    if press is not None and not drive.is_of(press):
        raise ConfigurationError(
            f"The drive was computed for another press than this one of {press.button!r}: compute it again."
        )
    prepare(rig, drive.point)
    doing = f"Check the {drive.button} button"
    most = sizes.MORE_PLAYS * plays if most is None else most
    total = plays * len(drive.points)
    result = _decided(rig, drive, drive, (plays, most), part_of(progress, doing, 0, total))
    silent, others = [], []
    for number, one in enumerate(drive.elsewhere, 1):
        prepare(rig, one.point)
        tell = part_of(progress, doing, number * plays, total)
        if one.button:
            others.append(_decided(rig, drive, drive.seen_from(one.point), (plays, most), tell))
            continue
        silent.append(_silence(rig, drive, one.point, play(rig, drive, plays, progress=tell)))
    return all_judged(replace(result, silent=tuple(silent), others=tuple(others)))


def _decided(rig: Rig, drive: Drive, seen: Drive, plays: tuple[int, int], progress: Progress) -> Check:
    """The comparison at one point, of the first number of `plays`, or of as many as tell, up to the second.

    `seen` is the drive as its target is there.
    """
    first, most = plays
    played = play(rig, drive, first, progress=progress)
    result = compare(seen, played, rig, most)
    while result.plays < most and undecided(result):
        count = min(most, _wanted(result, most)) - result.plays
        tell = part_of(
            progress, f"Check the {drive.button} button, which needs {result.plays + count} plays", 0, count
        )
        played = joined(played, play(rig, drive, count, progress=tell))
        result = compare(seen, played, rig)
    return result


def _wanted(result: Check, most: int) -> int:
    """Number of plays that would probably decide, and some more: what tells it is known from few plays."""
    if result.interval[1] <= result.tolerance:
        return 2 * result.plays  # so that less may hide above
    needed = plays_needed(result.whole, result.allowed or result.tolerance) or most
    return needed + (needed - result.plays + 2) // 3


def _silence(rig: Rig, drive: Drive, point: str, played: Played) -> Silence:
    """How much a point moves that is to be silent.

    A laser that sees nothing shows silence too: whether it sees this point is measured, by what one patch
    moves.
    """
    target = targets_of(drive, played.rate_hz)[0]
    moved = error_spectra(played.accelerations[:, : len(target)], 0 * target, target)
    # Within the band: the laser's noise beyond it would hide what is silent.
    inside = lines_inside(drive.band, len(target), played.rate_hz)
    return Silence(
        point, shared_power(moved[:, inside]), played.overload or unseen(rig, drive.patches[0], point)
    )


def compare(drive: Drive, played: Played, rig: Rig, most: int = 0) -> Check:
    """Compare measured plays with the target of their drive.

    `most`, if larger than their number, is that of the plays there may be: see `resolved`.
    """
    rate_hz = played.rate_hz
    target = targets_of(drive, rate_hz)[0]
    accelerations = played.accelerations[:, : len(target)]
    in_band = lines_inside(drive.band, len(target), rate_hz)
    every = error_spectra(accelerations, target)
    f = np.arange(every.shape[1]) * rate_hz / len(target)
    top = _judged_to(every, f, drive, played.judged_hz, most)
    below = (f < top) | (top == played.judged_hz)
    inside = in_band[below]
    missed = every[:, below]
    still = error_spectra(np.zeros((1, len(target))), target)[:, below]
    moved = missed - still
    mean = accelerations.mean(axis=0)
    band_only = np.fft.irfft(np.where(in_band, np.fft.rfft(mean), 0.0), len(mean))
    result = Check(
        drive=drive,
        rate_hz=rate_hz,
        target=target,
        accelerations=accelerations,
        judged_hz=top,
        whole=shared_power(missed),
        within=shared_power(missed[:, inside]),
        outside=shared_power(moved[:, ~inside]),
        above=_above(every, f, top, played, drive, float(np.mean(target**2))),
        correlation=_correlation(moved.mean(axis=0), -still[0], shared_power(moved)),
        envelope_correlation=_pearson(envelope(band_only), envelope(target)),
        octaves=_octaves(target, accelerations, rate_hz, top),
        drift=trend(moved[:, inside]),
        tones=Tones(played.tones_hz, played.tones_rms / float(np.sqrt(np.mean(target**2)))),
        drive_measured_peak=played.peak,
        overload=played.overload is not None,
        tolerance=TOLERANCE,
        verdict="pass",
        reasons=(),
        notes=(),
        simulated=rig.simulated or drive.simulated,
        lab=lab_threshold(rig),
    )
    dependent = dependence(missed, inside)
    signs = Signs(
        followed=followed(every, target),
        odd=odd_play(moved[:, inside]),
        dependent=dependent,
        overload=played.overload,
        limit=rig.limits.peak,
        monitor_noise=played.monitor_noise,
        volts=tuple(
            (patch, got, float(np.abs(own).max()))
            for patch, got, own in zip(drive.patches, played.peaks, drive.volts, strict=True)
        ),
    )
    return judged(_without_errors(result) if dependent else result, signs)


def _without_errors(result: Check) -> Check:
    """The check without the numbers that are wrong when noise is not independent from play to play."""
    nothing = float("nan")
    return replace(
        result,
        whole=replace(result.whole, value=nothing),
        within=replace(result.within, value=nothing),
        outside=replace(result.outside, value=nothing),
        above=replace(result.above, octave=replace(result.above.octave, value=nothing)),
        correlation=nothing,
    )


def resolved(drive: Drive, top: float, told: Callable[[float], float]) -> float:
    """Highest frequency (Hz) up to which a drive's motion is judged: `top`, or where noise leaves less.

    `told` returns the error that all plays tell up to a frequency (Hz). Twice differentiated, the noise of a
    sensor up to the corner of its filter leaves nothing to be told in any number of plays. Motion is then
    judged to the highest edge at which they tell half of the tolerance, and above which the drive states a
    bound. Where that bound leaves no room for an error of half the tolerance, it is judged to the frequency
    that leaves most, if one leaves so much.
    """
    own = drive.above[:, (drive.above[0] > drive.band[1]) & (drive.above[0] < top)]
    beyond = float(np.interp(top, *drive.above)) if np.any(drive.above[0] > top) else 0.0
    bounds = dict(zip(own[0].tolist(), own[1].tolist(), strict=True)) | {top: beyond}
    errors = {edge: told(edge) for edge in bounds}
    judged = max((edge for edge in bounds if errors[edge] <= TOLERANCE / 2), default=top)
    amiss = {edge: float(np.hypot(errors[edge], bounds[edge])) for edge in bounds}
    widest = min(amiss, key=lambda edge: amiss[edge])
    return widest if amiss[widest] <= _ROOM < amiss[judged] else judged


def _judged_to(missed: ComplexArray, f: FloatArray, drive: Drive, top: float, most: int) -> float:
    """`resolved` by the plays' noise, in as many as there may be; what is too large up to `top` stays so."""
    own = np.sum(np.abs(missed - missed.mean(axis=0)) ** 2, axis=0) / (len(missed) - 1)
    plays = max(most, len(missed))
    if shared_power(missed).interval[0] > TOLERANCE:
        return top
    return resolved(drive, top, lambda edge: float(np.sqrt(told_by_noise(np.sum(own[f < edge] ** 2), plays))))


def _above(
    missed: ComplexArray, f: FloatArray, top: float, played: Played, drive: Drive, power: float
) -> Above:
    """Evidence of motion above the frequency `top` to which is judged; `missed` are all lines `f` (Hz).

    `power` is the target's mean square.
    """
    octave = shared_power(missed[:, (f >= top / 2) & (f < top)])
    beyond = (f >= top) & (f < played.judged_hz)
    hz = np.concatenate([f[beyond], played.above_hz])
    shown, above = missed[:, beyond], played.above / np.sqrt(power)
    if len(played.above_hz):
        shown = np.concatenate([shown, above], axis=1)
    bands = np.floor(3 * np.log2(np.maximum(hz, top) / top)).astype(int)
    found = []
    for number in np.unique(bands):
        motion = shared_power(shown[:, bands == number])
        found.append((float(top * 2 ** ((number + 0.5) / 3)), motion))
    clear = [(hz, motion) for hz, motion in found if motion.clear]
    bound = float(np.interp(top, *drive.above)) if top < played.judged_hz else None
    first = (played.above_hz >= played.judged_hz) & (played.above_hz < 2 ** (1 / 3) * played.judged_hz)
    near = shared_power(above[:, first]) if np.any(first) else None
    if not clear:
        return Above(octave, bound=bound, near=near)
    most_hz, motion = max(clear, key=lambda one: one[1].value / max(one[1].deviation, one[1].least))
    return Above(octave, most_hz, motion, bound, near)


def _octaves(target: FloatArray, accelerations: FloatArray, rate_hz: float, judged_hz: float) -> ThirdOctaves:
    """Levels of target, mean of the plays, and the noise left in it."""
    plays, mean = len(accelerations), accelerations.mean(axis=0)

    def levels(signal: FloatArray) -> tuple[FloatArray, FloatArray]:
        return third_octaves(signal, rate_hz, _LOWEST_OCTAVE, judged_hz)

    hz, target_db = levels(target)
    noise = np.sum([10 ** (levels(deviation)[1] / 10) for deviation in accelerations - mean], axis=0)
    floor_db = 10 * np.log10(np.maximum(noise / (plays * (plays - 1)), 1e-30))
    return ThirdOctaves(hz, target_db, levels(mean)[1], floor_db)


def _correlation(moved: ComplexArray, wanted: ComplexArray, motion: SharedPower) -> float:
    """Correlation of the mean motion with the target (power one), without noise; zero when nothing moved."""
    if not motion.value > 0:
        return 0.0
    return float(np.clip(np.vdot(wanted, moved).real / motion.root, -1.0, 1.0))


def _pearson(a: FloatArray, b: FloatArray) -> float:
    """Pearson's correlation; zero when a signal is constant."""
    a, b = a - a.mean(), b - b.mean()
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / size if size > 0 else 0.0
