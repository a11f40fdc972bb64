"""Measurement of a vibration map, point by point: aim, check the light, play, save.

The generator plays one linear sweep of a patch, or of all in parallel, as in the paper (`Sweeper`). A map is
fitted to spectra on the lines of a period (`PointMeasurement`), with the law of a patch. A sweep of one level
shows the patch as a gain, which is in the response that it measures; so the response, harmonics removed, is
written as if a chirp of one period had been played, at the level of the sweep, into a patch without
hysteresis. That each point is swept at its own time does not matter then.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from datetime import UTC, datetime
from math import ceil
from pathlib import Path

import numpy as np

from ...base.arrays import ComplexArray, FloatArray
from ...base.errors import ConfigurationError
from ...base.files import Room, room
from ...base.progress import Progress, silent
from ...instruments import Rig
from ..response import Channels, Spot, Swept, overloaded, play_sweep, refuse_silent_drive, without_harmonics
from .folder import MapFolder, MapPlan, PointMeasurement, Step

_RINGS, _LATER = 1.0, (2.0, 4.0)
"""Time (s) in which a surface answers a blow, and one in which there is noise alone."""
_ANSWERS = 4.0
"""Power of the answer over that of the noise, below which a point follows no patch."""
_MORE_HZ = 10.0
"""Band (Hz) beyond the map's that is computed, for what needs neighbouring lines."""


class Sweeper:
    """Plays the steps of a plan by the generator."""

    def __init__(self, rig: Rig, plan: MapPlan) -> None:
        self._rig, self._plan = rig, plan
        self._samples = plan.parallel.samples(plan.rate_hz)
        t = np.arange(self._samples) / plan.rate_hz
        pace = (plan.high - plan.low) / plan.period
        chirp = plan.level * np.sin(2 * np.pi * (plan.low + pace * t / 2) * t)
        lines = np.arange(self._samples // 2 + 1)
        f = lines * plan.rate_hz / self._samples
        self._lines = lines[(f >= plan.low) & (f <= plan.high)]
        self._chirp = np.asarray(np.fft.rfft(chirp)[self._lines])

    def play(self, step: Step, light: float) -> PointMeasurement | str:
        """Play a step: its measurement, or the reason to try it again."""
        rig, plan, begun = self._rig, self._plan, datetime.now(UTC)
        before = rig.clock.now()
        responses: list[ComplexArray] = []
        rows: list[tuple[int, str]] = []
        for number, name in enumerate(step.plays):
            patches = plan.patches if name == "all" else (name,)
            spot = Spot(rig, patches[0], step.point)
            swept = play_sweep(spot, plan.sweep, plan.level, beside=patches[1:])
            if swept.problem:
                return swept.problem
            refuse_silent_drive(swept.gain, name)
            found = self._response(swept)
            if found is None:
                return f"Point {step.point} does not follow {spot}: check the laser's focus and aim."
            responses.append(found)
            rows += [(number, patch) for patch in patches]
        return PointMeasurement(
            plan=plan.digest,
            step=step.name,
            point=step.point,
            plays=step.plays,
            rows=tuple(rows),
            drives=np.array([self._chirp] * len(rows)),
            velocity=np.array(responses) * self._chirp,
            light=light,
            seconds=rig.clock.now() - before,
            created=begun.isoformat(timespec="seconds"),
        )

    def _response(self, swept: Swept) -> ComplexArray | None:
        """(lines,) m/s per V at the patch; None where the point does not follow it."""
        plan = self._plan
        periods = ceil(len(swept.volts) / self._samples) + 1
        length = periods * self._samples
        first = round(periods * self._lines[0] - _MORE_HZ * length / plan.rate_hz)
        last = round(periods * self._lines[-1] + _MORE_HZ * length / plan.rate_hz)
        f = np.arange(first, last + 1) * plan.rate_hz / length

        def spectrum(signal: FloatArray) -> ComplexArray:
            return np.asarray(np.fft.rfft(signal - np.median(signal), length)[first : last + 1])

        volts = spectrum(swept.volts)
        volts = volts * swept.channels.drive(volts[None], volts, f)
        H = swept.channels.velocity(spectrum(swept.velocity), f) / volts
        answer = np.abs(np.fft.ifft(H)) ** 2
        step = 1 / (len(H) * (f[1] - f[0]))
        rings, early, late = (round(seconds / step) for seconds in (_RINGS, *_LATER))
        if not answer[:rings].mean() > _ANSWERS * answer[early:late].mean():
            return None
        H = without_harmonics(H, f, plan.sweep.stop_hz / plan.sweep.seconds)
        return np.asarray(H[periods * self._lines - first])


_ATTEMPTS = 3
"""Attempts at a point before it is skipped."""
_DIM = 0.1
"""Fraction of full light below which a point is not measured."""
_FOLLOWS = 4.0
"""Power at the excited lines over that at the silent ones, below which a point follows no patch."""
_NOTES = 1_000_000
"""Room (bytes) for notes on points that are skipped."""
_SHARE = 0.99
"""Default level over the largest level that the limits allow."""


def map_plan(
    rig: Rig,
    *,
    points: Collection[int] | None = None,
    patches: Sequence[str] | None = None,
    together: bool | None = None,
    level: float | None = None,
    period: float = 2.05,
    every: int = 20,
) -> MapPlan:
    """Plan a map of a rig's table: `points` x `patches`, all of them by default.

    `together` plays all patches at once: the default on a rig with an amplifier channel for each patch.
    `level` is the peak of each drive (V), by default 99 % of the limits. At three points all patches are
    also played in parallel. Raises ConfigurationError.

    For example:

        >>> plan = haploop.map_plan(rig, points=[0], patches=["A"])
        >>> plan.points, plan.patches
        (('0',), ('A',))
    """
    table = rig.table
    count = table.rows * table.columns
    chosen = list(range(count)) if points is None else list(dict.fromkeys(points))
    names = tuple(table.patches if patches is None else patches)
    wrong = [str(p) for p in chosen if not 0 <= p < count] + [p for p in names if p not in table.patches]
    if wrong or not chosen or not names:
        raise ConfigurationError(
            f"A map needs points from 0 to {count - 1} and patches among {', '.join(table.patches)}"
            + (f", and {wrong[0]!r} is none." if wrong else ".")
        )
    swept = rig.feeds_amplifier("generator")
    several = all(patch in rig.amplifier.inputs for patch in names) and len(names) > 1
    if together and not several:
        raise ConfigurationError(
            f"The amplifier of the rig {rig.name!r} has no channel for each patch: one patch at a time."
        )
    for name, value, unit in (("level", level, "V"), ("period", period, "s"), ("every", every, "points")):
        if value is not None and not 0 < value < np.inf:
            raise ConfigurationError(f"A map cannot have {name} = {value}: use a number of {unit} above 0.")
    parallel = rig.limits_for(1 if rig.amplifier.inputs else len(names))
    peak = min(rig.limits.peak, parallel.peak)
    if level is not None and level > peak:
        raise ConfigurationError(
            f"A map cannot have level = {level:g}: the limits of the rig {rig.name!r} allow {peak:.4g} V "
            "about zero."
        )
    tests = [chosen[round(k * (len(chosen) - 1) / 2)] for k in range(3)] if len(names) > 1 else []
    return MapPlan(
        rig=rig.name,
        rig_file=rig.file.model_dump_json(),
        simulated=rig.simulated,
        rows=table.rows,
        columns=table.columns,
        points=tuple(map(str, chosen)),
        patches=names,
        together=several if together is None else together,
        level=_SHARE * peak if level is None else level,
        rate_hz=table.rate_hz,
        low=15.0,
        high=625.0,
        period=period,
        tests=tuple(map(str, dict.fromkeys(tests))),
        every=every,
        swept=swept,
    )


def measure_map(rig: Rig, out: Path, plan: MapPlan | None = None, progress: Progress = silent) -> MapFolder:
    """Measure a map into the folder `out`, or continue the one there.

    Before each point the operator is asked to aim the laser, and the light is checked. A point without
    light, without confirmation, out of range or that follows no patch is tried again, up to three times,
    and then skipped with the reason; any other failure ends the run, and completed points are
    kept. The disk's room for all of it is held before the first play. Raises ConfigurationError, DataError,
    InstrumentError, LimitError.

    For example:

        >>> from pathlib import Path
        >>> plan = haploop.map_plan(rig, points=[0], patches=["A"])
        >>> haploop.measure_map(rig, Path("map"), plan).path.name
        'map'
    """
    plan = map_plan(rig) if plan is None else plan
    folder = MapFolder.create(out, plan)
    left = tuple(folder.left())
    with room(folder.path, sum(plan.size(step) for step in left) + _NOTES) as held:
        rig.confirm_settings()
        _measure(rig, folder, left, held, progress)
    return folder


def _measure(rig: Rig, folder: MapFolder, left: Sequence[Step], held: Room, progress: Progress) -> None:
    plan = folder.plan
    doing, total = f"Map {len(plan.points)} points", plan.duration
    done = total - plan.seconds * sum(len(step.plays) for step in left)
    player = Sweeper(rig, plan) if plan.swept else _Player(rig, plan)
    for step in left:
        progress(doing, done, total, "s")
        reason: str | None = None
        for _ in range(_ATTEMPTS):
            reason, light = _aimed(rig, step)
            if reason is None:
                found = player.play(step, light)
                if isinstance(found, PointMeasurement):
                    held.free(plan.size(step))
                    folder.write(step, found)
                    break
                reason = found
        if reason is not None:
            folder.skip(step, reason)
        done += plan.seconds * len(step.plays)
        progress(doing, done, total, "s")


def _aimed(rig: Rig, step: Step) -> tuple[str | None, float]:
    """Reason why a point cannot be measured (None if it can), and the signal level there (NaN: unknown)."""
    if not rig.operator.confirm(rig.aim(step.point)):
        return f"The operator did not confirm this: {rig.aim(step.point)}", np.nan
    level = rig.vibrometer.signal_level()
    if level is not None and level < _DIM:
        return (
            f"The vibrometer sees {level:.0%} of its light at point {step.point}: focus the laser, or put a "
            "piece of reflective tape there."
        ), level
    return None, np.nan if level is None else level


class _Player:
    """Plays the steps of a plan."""

    def __init__(self, rig: Rig, plan: MapPlan) -> None:
        self._rig, self._plan = rig, plan
        own = {patch: plan.multisine(patch) for patch in plan.patches}
        self._drives = {patch: m.volts(plan.rate_hz, plan.level) for patch, m in own.items()}
        self._excited = {patch: m.excited() for patch, m in own.items()}
        self._all = plan.parallel.volts(plan.rate_hz, plan.level)
        samples = plan.parallel.samples(plan.rate_hz)
        f = np.arange(samples // 2 + 1) * plan.rate_hz / samples
        self._lines = np.flatnonzero((f >= plan.low) & (f <= plan.high))
        self._f = f[self._lines]

    def play(self, step: Step, light: float) -> PointMeasurement | str:
        """Play a step: its measurement, or the reason to try it again."""
        rig, begun, spent = self._rig, datetime.now(UTC), 0.0
        velocities: list[ComplexArray] = []
        drives: list[ComplexArray] = []
        rows: list[tuple[int, str]] = []
        for number, name in enumerate(step.plays):
            if name == "each":
                drive = self._drives
            elif name == "all":
                drive = dict.fromkeys(self._plan.patches, self._all)
            else:
                drive = {name: self._drives[name]}
            monitors = {patch: rig.monitor(patch) for patch in drive}
            channels = (*dict.fromkeys(monitors.values()), rig.vibrometer.channel)
            before = rig.clock.now()
            if name == "each":
                capture = rig.excite_each(drive, channels)
            else:
                capture = rig.excite(next(iter(drive.values())), tuple(drive), channels)
            spent += rig.clock.now() - before
            problem = overloaded(rig, capture)
            if problem:
                return problem
            seen: dict[str, ComplexArray] = {}
            for patch, monitor in monitors.items():
                if monitor not in seen:
                    seen[monitor] = self._volts(
                        capture.volts, capture.channels, capture.delays, monitor, drive[patch]
                    )
                    _refuse_silent_drive(seen[monitor], np.fft.rfft(drive[patch])[self._lines], patch)
                drives.append(seen[monitor])
                rows.append((number, patch))
            laser = capture.channels.index(rig.vibrometer.channel)
            paths = Channels(capture.rate_hz, 0.0, float(capture.delays[laser]), rig.motion_response)
            speed = rig.vibrometer.to_si(capture.volts[laser])[: len(self._all)]
            velocity = paths.velocity(np.fft.rfft(speed)[self._lines], self._f)
            if not self._follows(velocity, name):
                source = f"patch {name}" if name in drive else "the patches"
                return f"Point {step.point} does not follow {source}: check the laser's focus and aim."
            velocities.append(velocity)
        return PointMeasurement(
            plan=self._plan.digest,
            step=step.name,
            point=step.point,
            plays=step.plays,
            rows=tuple(rows),
            drives=np.array(drives),
            velocity=np.array(velocities),
            light=light,
            seconds=spent,
            created=begun.isoformat(timespec="seconds"),
        )

    def _volts(
        self,
        volts: FloatArray,
        channels: tuple[str, ...],
        delays: FloatArray,
        monitor: str,
        commanded: FloatArray,
    ) -> ComplexArray:
        """(lines,) V at a patch at the clock's edges."""
        row, divider = channels.index(monitor), self._rig.sensors.drive
        assert divider is not None
        paths = Channels(self._plan.rate_hz, float(delays[row]), 0.0, self._rig.motion_response)
        sampled = np.fft.rfft(divider.to_si(volts[[row]])[0][: len(commanded)])[self._lines]
        order = np.fft.rfft(commanded)[self._lines]
        passed = self._rig.daq.response(monitor, self._f)
        return np.asarray(sampled * paths.drive(sampled[None], order, self._f) / passed)

    def _follows(self, velocity: ComplexArray, name: str) -> bool:
        """True when the surface moves more at the excited lines than at the others."""
        if name == "each":
            excited = np.concatenate(list(self._excited.values()))
        else:
            excited = self._plan.parallel.excited() if name == "all" else self._excited[name]
        own = np.isin(self._lines, excited)
        power = np.abs(velocity) ** 2
        # Between the lines there are noise and ringing; interleaved drives leave few lines silent.
        return bool(np.median(power[own]) > _FOLLOWS * np.median(power[~own]))


def _refuse_silent_drive(measured: ComplexArray, commanded: ComplexArray, patch: str) -> None:
    strong = np.abs(commanded) > 0.1 * np.abs(commanded).max()
    refuse_silent_drive(float(np.median(np.abs(measured[strong] / commanded[strong]))), patch)
