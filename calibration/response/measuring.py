"""Measuring a response on a rig: an excitation into a patch, its volts and the surface's velocity."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ...base.arrays import FloatArray
from ...base.errors import ConfigurationError, DataError, InstrumentError
from ...base.progress import Progress, part_of, silent
from ..background import LONGEST_REST, Record, Tones, rests, tones_in, without_tones
from .excitation import Excitation, LinearSweep, Multisine
from .from_multisine import from_multisine
from .from_sweeps import LEAD, START_HZ, from_sweeps, ordered, play_sweeps
from .hysteresis import Hysteresis
from .response import Response
from .settling import full_level, refuse_silent_drive, settle
from .spot import Channels, Spot, refuse_overload, response_of, signals_of

if TYPE_CHECKING:
    from ...instruments import Capture, Rig

ABOVE_HZ = 600.0
"""Lowest frequency (Hz) of the response above the band: a little below the end of the usual excitations."""
_FAST, _SLOW_TO = 5e3, 10e3
"""Corner (Hz) of a pick-up from which its plays show what the surface does. Of a slower one the response is
measured to so many hertz, through the filter that it declares: a resonance stands out of noise there, where
it does not in the plays."""
_MARGIN = 0.99
"""Level of the excitation above the band over the limit: a player's own rate may overshoot a little."""
_SWEPT = 0.98
"""Level of the generator's sweep over the limit: its steps and its switching off are not the DAQ's."""
_WORTHWHILE = 1.2
"""Ratio of the highest to the lowest frequency from which the response above the band is measured."""
WITHIN = 0.01
"""Relative rms standard deviation of a response, above which a multisine is played again."""
_LONGEST = 8.2
"""Longest period (s) of a multisine that is played again."""
_HELPS = 0.8
"""Ratio of the deviation to that of half the period, up to which twice the period is tried next."""
_RINGS = 0.4
"""Share of a sweep's tail in which the surface may still ring."""
SWEEP = LinearSweep()
QUICK = Multisine()


def measure_response(
    rig: Rig,
    patch: str = "A",
    point: str = "button",
    progress: Progress = silent,
    *,
    excitation: Excitation = SWEEP,
    level: float | None = None,
    hysteresis: Hysteresis | None = None,
    within: float = WITHIN,
) -> Response:
    """Play an excitation into a patch, measure drive and velocity, and divide the spectra.

    The default is the paper's sweep, at several levels, which also shows the patch's hysteresis. `level` is
    the peak in volts at the patch; None takes what the rig's limits allow.

    A multisine takes 2.05 s or a few periods more. If its response is not known `within` a relative standard
    deviation, it is played again with twice the period, for as long as that helps and up to 8.2 s; the
    response's `excitation` states what was played. With the `hysteresis` of an earlier calibration, or with
    the one identified from the multisine, the response is computed from the linear volts of the measured
    drive, which removes the distortion: the result equals that of sweeps at `hysteresis.level`.

    Raises InstrumentError when the operator does not confirm, a signal leaves its range or the
    drive does not reach the patch; DataError when the point does not follow the patch;
    ConfigurationError for a rig that lacks an instrument.
    """
    peak = level
    if peak is None:
        peak = full_level(rig, lambda peak: excitation.volts(rig.table.rate_hz, peak))
    prepare(rig, point)
    spot = Spot(rig, patch, point)
    by_generator = rig.feeds_amplifier("generator")
    if isinstance(excitation, Multisine):
        if by_generator:
            raise ConfigurationError(
                f"The generator of the rig {rig.name!r} feeds its amplifier, and plays sweeps only: "
                "measure with one, or wire an output of the DAQ to the amplifier."
            )
        return plausible(_known(spot, Play(excitation, peak), hysteresis, within, progress))
    if hysteresis is not None:
        raise ConfigurationError("Sweeps measure the hysteresis themselves: only a multisine takes one.")
    return plausible((_generated if by_generator else _swept)(spot, excitation, peak, progress))


def measure_above(
    rig: Rig, patch: str, point: str, hysteresis: Hysteresis, progress: Progress = silent
) -> Response | None:
    """Measure the response above the band of the usual excitations, to the corner of the laser's filter.

    Of a slow pick-up, beyond it. To be called after a response was measured at the same point: nothing is
    asked of the operator. The level is what the limits of slew rate and current allow. Returns None where the
    sample rate leaves nothing above that band. Raises what `measure_response` raises.
    """
    corner = rig.vibrometer.bandwidth_hz
    top = min(corner if corner >= _FAST else _SLOW_TO, rig.table.rate_hz / 4)
    if top < _WORTHWHILE * ABOVE_HZ:
        return None
    excitation = Multisine(low=ABOVE_HZ, high=top * (1 - 1e-9))
    one = excitation.volts(rig.table.rate_hz, rig.limits.peak)
    peak = rig.limits.peak * min(1.0, _MARGIN * rig.limits.headroom(one, rig.table.rate_hz)[0])
    settle(rig, (patch,), progress)
    # The surface may move less than the laser's noise there: the deviation says so, and nothing is refused.
    return _played(Spot(rig, patch, point), Play(excitation, peak), hysteresis, progress, local_only=True)


@dataclass(frozen=True)
class Play:
    """A multisine and its largest volts at the patch."""

    multisine: Multisine
    peak: float


@dataclass(frozen=True, eq=False)
class BothSigns:
    """A multisine and its negative, each from rest: (2, samples) V at the patch, and what is shown."""

    volts: FloatArray
    velocity: FloatArray
    channels: Channels


def measure_both_signs(rig: Rig, patch: str, point: str, progress: Progress = silent) -> BothSigns:
    """Play the quick multisine and its negative at the largest level, for what does not change its sign.

    To be called as `measure_above`. Raises what `measure_response` raises.
    """
    captures: list[Capture] = []
    for number, sign in enumerate((1.0, -1.0)):
        settle(rig, (patch,), progress)
        tell = part_of(progress, _doing(Spot(rig, patch, point)), number * QUICK.duration, 2 * QUICK.duration)
        captures.append(excite(rig, QUICK, patch, sign * quick_level(rig), tell))
        refuse_overload(rig, captures[-1])
    volts, velocity, channels = zip(*(signals_of(rig, capture, patch) for capture in captures), strict=True)
    own = slice(QUICK.samples(rig.table.rate_hz))
    return BothSigns(np.array(volts)[:, own], np.array(velocity)[:, own], channels[0])


def quick_response(
    rig: Rig,
    patch: str = "A",
    point: str = "button",
    progress: Progress = silent,
    *,
    level: float | None = None,
    hysteresis: Hysteresis | None = None,
) -> Response:
    """Measure a response with one period of a multisine from rest, 2.05 s or longer if that does not suffice.

    See `measure_response`.
    """
    return measure_response(rig, patch, point, progress, excitation=QUICK, level=level, hysteresis=hysteresis)


def quick_level(rig: Rig) -> float:
    """Largest peak (V) of the quick multisine that the rig's limits allow."""
    return full_level(rig, lambda peak: QUICK.volts(rig.table.rate_hz, peak))


def excite(rig: Rig, multisine: Multisine, patch: str, peak: float, progress: Progress = silent) -> Capture:
    """Play a multisine of `peak` volts into a patch; returns the patch's volts and the laser's.

    Raises what `Rig.excite` raises.
    """
    volts = multisine.volts(rig.table.rate_hz, peak)
    return rig.excite(volts, (patch,), (rig.monitor(patch), rig.vibrometer.channel), 0.0, progress)


def response_from(
    spot: Spot,
    capture: Capture,
    played: Play,
    hysteresis: Hysteresis | None = None,
    *,
    local_only: bool = False,
) -> Response:
    """Estimate the response from a capture that `excite` made.

    With `local_only` nothing is fitted over all lines. Raises InstrumentError when a signal left its range.
    """
    rig, multisine = spot.rig, played.multisine
    refuse_overload(rig, capture)
    volts, velocity, channels = signals_of(rig, capture, spot.patch)
    commanded = multisine.volts(rig.table.rate_hz, played.peak)
    found, law = from_multisine(
        multisine, commanded, volts, velocity, channels, hysteresis, local_only=local_only
    )
    excitation = f"{multisine}; the patch's hysteresis taken out"
    response = response_of(spot, found, excitation, multisine.periods, played.peak)
    return replace(response, level=law.level, hysteresis=law)


def prepare(rig: Rig, point: str) -> None:
    """Have settings and aim at `point` confirmed, and check the light. Raises InstrumentError."""
    rig.confirm_settings()
    if not rig.operator.confirm(rig.aim(point)):
        raise InstrumentError(f"The operator did not confirm this, so nothing was measured: {rig.aim(point)}")
    level = rig.vibrometer.signal_level()
    if level is not None and level < 0.1:
        raise InstrumentError(
            f"The vibrometer sees {level:.0%} of its light at the {point} point: focus the laser, or "
            "put a piece of reflective tape there."
        )


def unseen(rig: Rig, patch: str, point: str) -> str:
    """Why the laser sees nothing at a point of what a patch moves, as a sentence; empty where it sees that.

    To be called as `measure_above`. Raises what `excite` raises.
    """
    settle(rig, (patch,))
    peak = quick_level(rig)
    capture = excite(rig, QUICK, patch, peak)
    try:
        plausible(response_from(Spot(rig, patch, point), capture, Play(QUICK, peak)))
    except (DataError, InstrumentError) as error:
        return str(error)
    return ""


def _known(
    spot: Spot, play: Play, hysteresis: Hysteresis | None, within: float, progress: Progress
) -> Response:
    """Play a multisine, again with twice the period as long as the response is not known and that helps."""
    before, said = np.inf, ""
    while True:
        settle(spot.rig, (spot.patch,), progress)
        response = _played(spot, play, hysteresis, progress)
        unsure, multisine = response.uncertainty, play.multisine
        longer = replace(multisine, period=2 * multisine.period)
        if unsure <= within or longer.period > _LONGEST or unsure > _HELPS * before:
            break
        said += f"; {multisine.duration:.2f} s left a standard deviation of {unsure:.2%}"
        play, before = replace(play, multisine=longer), unsure
    return replace(response, excitation=f"{response.excitation}; standard deviation {unsure:.2%}{said}")


def _played(
    spot: Spot, play: Play, hysteresis: Hysteresis | None, progress: Progress, *, local_only: bool = False
) -> Response:
    tell = part_of(progress, _doing(spot), 0, play.multisine.duration)
    capture = excite(spot.rig, play.multisine, spot.patch, play.peak, tell)
    return response_from(spot, capture, play, hysteresis, local_only=local_only)


def _swept(spot: Spot, sweep: LinearSweep, peak: float, progress: Progress) -> Response:
    rig, patch = spot.rig, spot.patch
    once = sweep.volts(rig.table.rate_hz, peak)
    recorded = (rig.monitor(patch), rig.vibrometer.channel)
    drives, records = [], []
    levels = (*(1.0,) * sweep.repeats, *sweep.shares)
    rate_hz = rig.table.rate_hz
    leads = rests(len(levels), rate_hz, 1, (rig.name, spot.point, patch))
    longest = round(LONGEST_REST * rate_hz)
    for number, (factor, lead) in enumerate(zip(levels, leads, strict=True)):
        before = sweep.duration * number / len(levels)
        tell = part_of(progress, _doing(spot), before, sweep.duration)
        # Zero volts first: a rest of a length that no tone of the background is in step with. The tail makes
        # all captures equally long.
        tail = sweep.tail + (longest - lead) / rate_hz
        capture = rig.excite(np.pad(factor * once, (lead, 0)), (patch,), recorded, tail, tell)
        refuse_overload(rig, capture)
        volts, velocity, channels = signals_of(rig, capture, patch)
        drives.append(volts[lead : lead + capture.volts.shape[1] - longest])
        still = lead + len(once) + round(_RINGS * sweep.tail * rate_hz)
        records.append(Record(velocity, (slice(0, lead), slice(still, len(velocity)))))
        del capture, volts, velocity  # each as large as all that is kept of a sweep
    progress(_doing(spot), sweep.duration, sweep.duration, "s")
    calm, tones = without_tones(records, rate_hz)
    velocities = [row[lead : lead + len(drives[0])] for row, lead in zip(calm, leads, strict=True)]
    found = from_sweeps(sweep, once, drives, velocities, channels)
    response = response_of(spot, found, str(sweep), sweep.repeats, peak)
    return replace(response, levels=response.level * np.array(sweep.shares), tones=tones)


def _generated(spot: Spot, sweep: LinearSweep, peak: float, progress: Progress) -> Response:
    rig, rate_hz = spot.rig, spot.rig.table.rate_hz
    plays = play_sweeps(spot, sweep, _SWEPT * peak, progress)
    drives, velocities = ([getattr(one, name) for one in plays] for name in ("volts", "velocity"))
    lead = round(LEAD * rate_hz)
    once = np.zeros(len(drives[0]))
    once[lead : lead + round(sweep.seconds * rate_hz)] = _SWEPT * peak * ordered(sweep, rate_hz)
    still = lead + round((sweep.seconds + _RINGS * sweep.tail) * rate_hz)
    # One rest a play tells which tones there are, and not their phases seconds before: they stay in.
    heard = tones_in([Record(row, (slice(still, len(row)),)) for row in velocities], rate_hz)
    found = from_sweeps(sweep, once, drives, velocities, plays[0].channels)
    said = f"{sweep}, by the {rig.generator.identity} from {START_HZ:g} Hz on, on its own clock"
    response = response_of(spot, found, said, sweep.repeats, _SWEPT * peak)
    tones = Tones(unsteady=heard, unsteady_share=np.zeros(len(heard)))
    return replace(response, levels=response.level * np.array(sweep.shares), tones=tones)


def _doing(spot: Spot) -> str:
    return f"Measure {spot}"


def _turns(response: Response) -> str:
    tones = np.sort(np.concatenate([response.tones.steady, response.tones.unsteady]))
    if not len(tones):
        return ""
    return (
        f" The background has tones at {', '.join(f'{hz:.1f}' for hz in tones[:5])} Hz: a machine runs there."
    )


def plausible(response: Response) -> Response:
    """Return a response whose drive reached the patch and whose surface followed; raise for any other."""
    refuse_silent_drive(float(np.median(np.abs(response.path))), response.patch)
    typical = float(np.median(response.coherence))
    if typical < 0.5:
        raise DataError(
            f"The {response.point} point does not follow patch {response.patch}: the coherence is "
            f"{typical:.2f} where 0.5 is the least that can be used and 0.99 is usual. Check the laser's "
            f"focus and aim, and that the patch is glued and connected.{_turns(response)}"
        )
    return response
