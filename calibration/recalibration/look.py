"""The look at a rig before any action: sensors at rest, and a quick response of each place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from ...base.errors import DataError, InstrumentError, LimitError
from ...base.progress import Progress, part_of
from ...instruments import Rig
from ..drive import Drive
from ..model import Calibration
from ..response import (
    QUICK,
    Hysteresis,
    Play,
    Response,
    Spot,
    excite,
    plausible,
    prepare,
    quick_level,
    response_from,
    settle,
)
from .drift import Kind, PlaceMetrics, Verdict, compare, together
from .overlay import told_touched
from .sensor_health import LaserAtRest, laser_at_rest, laser_or_patch, loose_accelerometer, without_spikes

Place = tuple[str, str]
"""Patch and point."""


@dataclass(frozen=True, eq=False)
class Look:
    """Findings before any action."""

    verdicts: tuple[Verdict, ...]
    measured: frozenset[Place]
    broken: tuple[str, ...]
    """Faults that belong to no place."""
    unmeasured: tuple[str, ...]
    laser: LaserAtRest | None
    spikes: float
    """Spikes of the laser per second while it measured."""

    @property
    def kind(self) -> Kind:
        """The worst finding."""
        kinds = {verdict.kind for verdict in self.verdicts}
        if self.broken or "broken" in kinds or not kinds:
            return "broken"
        return "drifted" if "drifted" in kinds else "unchanged"

    @property
    def touched(self) -> bool:
        """True when something seems to rest on the table."""
        return any(verdict.dampings.touched for verdict in self.verdicts)

    @property
    def sentences(self) -> tuple[str, ...]:
        """All findings, the worst first."""
        told = sorted(self.verdicts, key=lambda v: ("broken", "drifted", "unchanged").index(v.kind))
        return (*self.broken, *(s for verdict in told for s in verdict.sentences), *self.unmeasured)

    def disturbances(self, usual: float | None) -> tuple[str, ...]:
        """See `LaserAtRest.disturbances`."""
        return self.laser.disturbances(usual, self.spikes) if self.laser else ()


def look_at(
    rig: Rig,
    calibrations: Sequence[Calibration],
    drives: Mapping[Place, Mapping[str, Drive]],
    usual: float | None,
    progress: Progress,
) -> Look:
    """Look at sensors and places. `drives` are those of the buttons of each place, by name.

    `usual` is the laser's noise in healthy runs, None if none is on record. A place that the operator does
    not aim at is not measured; an instrument that fails ends the look. Raises InstrumentError only when the
    safe state could not be confirmed.
    """
    verdicts: list[Verdict] = []
    unmeasured: list[str] = []
    spikes = 0
    try:
        broken = [told for told in [loose_accelerometer(rig)] if told]
        laser = laser_at_rest(rig)
    except InstrumentError as error:
        rig.make_safe()
        return Look((), frozenset(), (str(error),), (), None, 0.0)
    for calibration in calibrations:
        patch, point = place = place_of(calibration)
        if not rig.operator.confirm(rig.aim(point)):
            unmeasured.append(
                f"Patch {patch} at the {point} point was not measured: the laser would need to be aimed."
            )
            continue
        try:
            response, seen = _measured(rig, place, laser, progress)
        except DataError as error:
            verdicts.append(_broken(calibration, f"{error} {laser_or_patch(laser.noise, usual)}"))
        except (InstrumentError, LimitError) as error:
            # Nothing more is played on a rig that failed. If it is not even safe, that is the message.
            rig.make_safe()
            verdicts.append(_broken(calibration, str(error)))
            break
        else:
            spikes += seen
            law = response.hysteresis if _known(calibration) else None
            found = compare(calibration, response, drives.get(place, {}), law, rig.file.recalibration)
            if found.now and found.now.coherence < rig.file.recalibration.coherence:
                told = f"{found.sentences[0]} {laser_or_patch(laser.noise, usual)}"
                found = replace(found, sentences=(told,))
            verdicts.append(found)
    measured = frozenset((v.patch, v.point) for v in verdicts if v.now)
    every = {name: drive for each in drives.values() for name, drive in each.items()}
    verdicts = together(verdicts, every, rig.file.recalibration)
    rate = spikes / (QUICK.duration * len(measured)) if measured else 0.0
    return Look(tuple(verdicts), measured, tuple(broken), tuple(unmeasured), laser, rate)


def places_of(drive: Drive) -> tuple[Place, ...]:
    """Patch and point of each patch of a drive, at its own point and at the others that it plans for."""
    return tuple((patch, point) for point in drive.points for patch in drive.patches)


def touched_since(rig: Rig, calibration: Calibration, progress: Progress) -> list[str]:
    """Sentences on what came to rest on the table since a calibration, or left it; empty if nothing did.

    Raises what a measurement raises.
    """
    response, _ = _measured(rig, place_of(calibration), laser_at_rest(rig), progress)
    found = compare(calibration, response, {}, response.hysteresis)
    came = list(told_touched([found]))
    if found.dampings.inverse.touched:
        patch, point = place_of(calibration)
        came.append(
            f"Something has left the table since patch {patch} was calibrated at the {point} point: its "
            "modes are damped less, as when a finger or a palm is taken away."
        )
    return came


def place_of(calibration: Calibration) -> Place:
    """Patch and point of a calibration."""
    return calibration.response.patch, calibration.response.point


def _measured(rig: Rig, place: Place, laser: LaserAtRest, progress: Progress) -> tuple[Response, int]:
    """The response of a multisine from rest, with its hysteresis, and the laser's spikes in it."""
    patch, point = place
    prepare(rig, point)
    try:
        settle(rig, (patch,), progress)
    except InstrumentError:
        # Spikes and hum hide that the surface has come to rest; the patch's memory is erased all the same.
        if not (laser.spikes or laser.hum or laser.tones_hz):
            raise
    peak = quick_level(rig)
    tell = part_of(progress, f"Measure patch {patch} at the {point} point", 0, QUICK.duration)
    capture, spikes = without_spikes(rig, excite(rig, QUICK, patch, peak, tell))
    return plausible(response_from(Spot(rig, patch, point), capture, Play(QUICK, peak))), spikes


def _known(calibration: Calibration) -> bool:
    """True when the calibration knows the patch's hysteresis: not if its response was imported."""
    law: Hysteresis = calibration.hysteresis
    return bool(len(calibration.response.levels) or law.weights[1:].any())


def _broken(calibration: Calibration, sentence: str) -> Verdict:
    return Verdict(*place_of(calibration), "broken", PlaceMetrics.of(calibration), None, (sentence,))
